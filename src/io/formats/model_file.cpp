// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>

#include <algorithm>
#include <cerrno>

#include "io/formats/files.hpp"
#include "io/formats/model_pieces.hpp"
#include "io/formats/schema.hpp"
#include "io/guard/atomic_file.hpp"
#include "io/naming.hpp"
#include "io/text.hpp"
#include "model/archived.hpp"
#include "tokid/model_file.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

namespace fs = std::filesystem;
using io::fail;

// Stores records one after the other in a temporary file, which vanishes when the process ends.
class Spool {
 public:
  explicit Spool(const fs::path& beside)
      : file_(open(io::AtomicFile(beside).path().c_str(), O_RDWR | O_CLOEXEC)) {  // never committed
    if (file_ < 0) io::fail_to_write(errno);
  }

  void add(std::string_view record) {
    sizes_.push_back(record.size());
    io::write_all(file_, record);
  }

  template <class Use>
  void for_each(Use&& use) const {
    off_t at = 0;
    std::string record;
    for (const size_t size : sizes_) {
      checkpoint();
      record.resize(size);
      if (!io::read_all(file_, record, at)) io::fail_to_write("what was written so far can't be read back");
      at += off_t(size);
      use(record);
    }
  }

 private:
  io::Descriptor file_;
  std::vector<size_t> sizes_;
};

}  // namespace

struct ModelFile::Content {
  explicit Content(const fs::path& file) : path(file), spool(file) {}

  void append(const Model& steps) {
    if (outline.step.empty()) {
      outline = steps;
      outline.step.clear();
      outline.u_nominal.resize(0, 0);
      outline.y_nominal.resize(0, 0);
    }
    for (const Step& step : steps.step) outline.step.push_back(step.outline());
    singular_values = std::max(singular_values, io::singular_value_count(steps));
    nominal_rows += steps.u_nominal.rows();
    spool.add(archive::packed(steps));
  }

  // The arrays of the steps in one record, padded to the widths of the arrays of the whole model. row_count(): their
  // number of rows in the whole model.
  io::Arrays rows_of(const std::string& record) const {
    return io::step_arrays_of(archive::unpacked<Model>(record), outline.states(), singular_values, io::Layout::plain);
  }
  size_t row_count(const std::string& name) const {
    return size_t(name == "u_nominal" || name == "y_nominal" ? nominal_rows : outline.steps());
  }

  io::ModelPieces pieces() const {
    io::ModelPieces result{io::small_arrays_of(outline), {}, [this](const auto& use) {
                             spool.for_each([&](const std::string& record) { use(rows_of(record)); });
                           }};
    spool.for_each([&](const std::string& record) {
      if (!result.shapes.empty()) return;
      result.shapes = rows_of(record);
      for (auto& [name, array] : result.shapes) array = {array.shape, {}}, array.shape.front() = row_count(name);
    });
    return result;
  }

  void commit() {
    const io::ModelPieces all = pieces();
    io::AtomicFile file(path);
    io::write_hdf5(all, file.path());
    file.commit();
  }

  fs::path path;
  Spool spool;
  Model outline;
  Index singular_values = 0, nominal_rows = 0;
};

ModelFile::ModelFile(const fs::path& path)
    : content_(io::naming_write(path, [&] {
        if (!io::is_hdf5(path))
          fail(
              "extension '{}' found, .h5 or .hdf5 needed to write a model in blocks; tokid convert can convert "
              "this file to other formats",
              path.extension().string());
        return std::make_unique<Content>(path);
      })) {}

ModelFile::~ModelFile() = default;

void ModelFile::append(const Model& steps) {
  steps.check();
  const Model& known = content_->outline;
  if (!known.step.empty() && (steps.k_begin != known.k_end() || steps.n(steps.k_begin) != known.n(known.k_end())))
    throw std::invalid_argument(fmt::format("model: steps from {} with {} states found, from {} with {} needed",
                                            steps.k_begin, steps.n(steps.k_begin), known.k_end(),
                                            known.n(known.k_end())));
  if (!known.step.empty() && !steps.step.empty()) {
    if (steps.inputs != known.inputs || steps.outputs != known.outputs)
      throw std::invalid_argument(fmt::format("model: steps with {} inputs and {} outputs found, {} and {} needed",
                                              steps.inputs, steps.outputs, known.inputs, known.outputs));
    for (const auto has : {&Step::has_condition, &Step::has_rank, &Step::has_lags})
      if (steps.has(has) != known.has(has))
        throw std::invalid_argument(
            "model: condition, rank or lags found at some steps only; each of them needed at all steps or at none");
  }
  io::naming_write(content_->path, [&] { content_->append(steps); });
}

const Model& ModelFile::outline() const { return content_->outline; }

void ModelFile::commit(Provenance provenance) {
  content_->outline.provenance = std::move(provenance);
  io::naming_write(content_->path, [&] { content_->commit(); });
}

}  // namespace tokid
