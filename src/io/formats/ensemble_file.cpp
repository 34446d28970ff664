// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <mutex>

#include "io/formats/data_files.hpp"
#include "io/formats/files.hpp"
#include "io/formats/formats.hpp"
#include "io/formats/hdf5_blocks.hpp"
#include "io/formats/sample_time.hpp"
#include "io/formats/schema.hpp"
#include "io/guard/descriptor.hpp"
#include "io/naming.hpp"
#include "linalg/transposition.hpp"
#include "tokid/ensemble_file.hpp"

namespace tokid {

namespace {

namespace fs = std::filesystem;
using io::fail;

io::Fields outlines(const fs::path& path) { return io::Fields(io::read_hdf5(path, io::ensemble_names(), {"u", "y"})); }

// Checks names, sizes and the sample time like load_ensemble(), with a small ensemble of one step.
void check(io::EnsembleOutline& outline) {
  Ensemble one(outline.experiments, 1, outline.inputs, outline.outputs, outline.dt);
  for (Index c = 0; c < one.inputs(); ++c) one.input(0).col(c).setZero();
  for (Index c = 0; c < one.outputs(); ++c) one.output(0).col(c).setZero();
  one.names = outline.names;
  one.free = outline.free;
  set_experiment_names(one, std::move(outline.experiment_names));
  one.check();
  outline.experiment_names = std::move(one.experiment_names);
}

// A part of a data set with the axes experiments, steps and channels. A data set of one experiment may lack the first
// axis.
io::Hyperslab slab(const io::Hdf5Source::Samples& samples, const std::array<Index, 3>& begin,
                   const std::array<Index, 3>& count) {
  const size_t axis = samples.rank() == 2 ? 1 : 0;
  return {{begin.begin() + axis, begin.end()}, {count.begin() + axis, count.end()}};
}

}  // namespace

struct EnsembleFile::Content {
  explicit Content(const fs::path& file)
      : path(file), whole(file), outline(outline_of(file)), source(file, whole), u(source, "u"), y(source, "y") {
    whole.check();
  }

  static io::EnsembleOutline outline_of(const fs::path& path) {
    const io::Fields fields = outlines(path);
    if (io::is_model(fields.names())) fail("a model found, an ensemble ('u', 'y') needed");
    if (fields.layout() == io::Layout::matlab)
      fail("MATLAB's order of the samples found, that of docs/formats.md needed to read them in blocks");
    io::EnsembleOutline outline = io::outline_of(fields, true);
    io::complete_sample_time(outline, outline.steps, fields.names(), [&](const io::Names& wanted) {
      // If each experiment has its own times, they are not read, because they are as many as the samples of a channel.
      const io::Contents shapes = io::read_hdf5(path, wanted, wanted);
      const bool is_small = std::all_of(shapes.arrays.begin(), shapes.arrays.end(), [&](const auto& entry) {
        return io::checked_product(entry.second.shape) <= size_t(outline.steps);
      });
      return is_small ? io::read_hdf5(path, wanted) : shapes;
    });
    check(outline);
    return outline;
  }

  void read(io::Hdf5Source::Samples& samples, Index channels, Index first_channel, Index begin, Ensemble& to) {
    // Reads as many experiments at a time as fit into the second cache level. From a chunked data set it reads whole
    // chunks.
    constexpr Index bytes = 1 << 19;
    const Index row = to.steps() * channels * Index(sizeof(double));
    const Index together = samples.stored_together();
    const Index least = std::max<Index>(1, bytes / row);
    const Index rows = std::min(to.experiments(), (least + together - 1) / together * together);
    buffer.resize(size_t(rows * to.steps() * channels));
    columns.clear();
    for (Index k = 0; k < to.steps(); ++k)
      for (Index c = 0; c < channels; ++c)
        columns.push_back(to.samples().col(k * to.channels() + first_channel + c).data());
    for (Index n = 0; n < to.experiments(); n += rows) {
      const Index count = std::min(rows, to.experiments() - n);
      samples.read(slab(samples, {n, begin, 0}, {count, to.steps(), channels}), buffer.data());
      linalg::transpose(buffer.data(), count, to.steps() * channels, columns);
      for (double*& column : columns) column += count;
    }
  }

  fs::path path;
  io::Unchanged whole;  // opened before anything is read
  io::EnsembleOutline outline;
  io::Hdf5Source source;
  io::Hdf5Source::Samples u, y;
  std::vector<double> buffer;
  std::vector<double*> columns;
  std::mutex mutex;  // the library reads for one thread at a time
};

EnsembleFile::EnsembleFile(const fs::path& path)
    : content_(io::naming(path, [&] {
        io::check_readable(path);
        return std::make_unique<Content>(path);
      })) {}

EnsembleFile::~EnsembleFile() = default;

Index EnsembleFile::experiments() const { return content_->outline.experiments; }
Index EnsembleFile::steps() const { return content_->outline.steps; }
Index EnsembleFile::inputs() const { return content_->outline.inputs; }
Index EnsembleFile::outputs() const { return content_->outline.outputs; }
Index EnsembleFile::free_responses() const { return content_->outline.free.experiments; }
double EnsembleFile::dt() const { return content_->outline.dt; }
bool EnsembleFile::dt_stated() const { return content_->outline.dt_stated; }
const Channels& EnsembleFile::names() const { return content_->outline.names; }
const std::optional<InitialState>& EnsembleFile::initial_state() const { return content_->outline.initial_state; }
const fs::path& EnsembleFile::path() const { return content_->path; }

Ensemble EnsembleFile::read(Index begin, Index end) const {
  const io::EnsembleOutline& all = content_->outline;
  if (begin < 0 || begin >= end || end > all.steps)
    throw std::invalid_argument(
        fmt::format("read: steps {} to {} asked for, the ensemble has {}", begin, end - 1, all.steps));
  Ensemble part(all.experiments, end - begin, all.inputs, all.outputs, all.dt, Ensemble::Samples::unset);
  io::naming(content_->path, [&] {
    const std::lock_guard lock(content_->mutex);
    content_->read(content_->u, all.inputs, 0, begin, part);
    content_->read(content_->y, all.outputs, all.inputs, begin, part);
  });
  part.dt_stated = all.dt_stated;
  part.remarks = all.remarks;
  part.names = all.names;
  part.experiment_names = all.experiment_names;
  part.initial_state = begin == 0 ? all.initial_state : InitialState::unknown;
  std::vector<Index> length = all.length;
  for (Index& own : length) own = std::clamp<Index>(own - begin, 0, end - begin);
  set_length(part, std::move(length));
  if (const Index known = std::min(end, all.free.steps); known > begin) {
    part.free = {all.free.experiments, known - begin, {}};
    part.free.y = all.free.y.middleCols(begin * all.outputs, (known - begin) * all.outputs);
  }
  return part;
}

void EnsembleFile::expect(Index begin, Index end) const {
  const io::EnsembleOutline& all = content_->outline;
  end = std::min(end, all.steps);
  if (begin >= end) return;
  for (const auto* samples : {&content_->u, &content_->y})
    samples->expect(slab(*samples, {0, begin, 0}, {all.experiments, end - begin, 0}));
}

std::optional<double> bytes_in_blocks(const fs::path& path) {
  if (io::stands_for_files(path)) return std::nullopt;
  return io::naming(path, [&]() -> std::optional<double> {
    if (!io::is_hdf5(path)) return std::nullopt;
    io::check_readable(path);
    const io::Fields fields = outlines(path);
    if (fields.layout() == io::Layout::matlab) return std::nullopt;
    const io::EnsembleOutline outline = io::outline_of(fields, true);
    return double(outline.experiments) * double(outline.steps) * double(outline.inputs + outline.outputs) *
           sizeof(double);
  });
}

}  // namespace tokid
