// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/files.hpp"

#include <algorithm>
#include <fstream>
#include <map>

#include "io/formats/data_files.hpp"
#include "io/formats/formats.hpp"
#include "io/formats/model_pieces.hpp"
#include "io/formats/sample_time.hpp"
#include "io/formats/schema.hpp"
#include "io/guard/atomic_file.hpp"
#include "io/guard/descriptor.hpp"
#include "io/naming.hpp"
#include "io/text.hpp"

namespace tokid {

namespace {

namespace fs = std::filesystem;
using io::check_readable;
using io::fail;
using io::in_lower_case;
using io::naming;
using io::naming_write;

enum class Format { npz, hdf5, mat, csv };

Format format_of(const fs::path& path) {
  const std::string extension = in_lower_case(path.extension().string());
  if (extension == ".npz") return Format::npz;
  if (extension == ".h5" || extension == ".hdf5") return Format::hdf5;
  if (extension == ".mat") return Format::mat;
  if (extension == ".csv") return Format::csv;
  fail(
      "extension '{}' found; .npz, .h5, .hdf5, .mat or (ensembles only) .csv needed. tokid import reads tables and logs",
      extension);
}

io::Contents read(const fs::path& path, Format format, const io::Names& wanted) {
  switch (format) {
    case Format::npz:
      return io::read_npz(path, wanted);
    case Format::hdf5:
      return io::read_hdf5(path, wanted);
    case Format::mat:
      return io::read_mat(path, wanted);
    default:
      fail("a .csv file found, which holds an ensemble; a model in .npz, .h5 or .mat needed");
  }
}

void write(const io::Arrays& arrays, const fs::path& path, Format format, const WriteOptions& options) {
  for (const auto& [name, array] : arrays)
    if (const auto* texts = std::get_if<std::vector<std::string>>(&array.values)) io::check_texts(name, *texts);
  switch (format) {
    case Format::npz:
      return io::write_npz(arrays, path);
    case Format::hdf5:
      return io::write_hdf5(arrays, path);
    case Format::mat:
      return options.mat73 ? io::write_mat73(arrays, path) : io::write_mat(arrays, path);
    default:
      fail("models and bounds don't fit into .csv; .npz, .h5 or .mat needed");
  }
}

// Reads the content of a file. Errors name the file.
template <class Read>
auto loaded(const fs::path& path, Read&& content) {
  return naming(path, [&] {
    const Format format = format_of(path);
    check_readable(path);
    const io::Unchanged file(path);
    auto result = content(format);
    file.check();
    return result;
  });
}

io::Layout layout_of(Format format) { return format == Format::mat ? io::Layout::matlab : io::Layout::plain; }

}  // namespace

void io::check_readable(const fs::path& path) {
  const auto status = fs::status(path);
  if (!fs::exists(status)) fail("no such file");
  if (fs::is_directory(status)) fail("a directory found, a file needed");
  if (!fs::is_regular_file(status)) fail("a device or pipe found, a file needed");
  if (!std::ifstream(path, std::ios::binary)) fail("can't be read: {}", std::generic_category().message(errno));
  if (fs::file_size(path) == 0) fail("an empty file found, data needed");
}

bool io::is_hdf5(const fs::path& path) { return format_of(path) == Format::hdf5; }

FileKind file_kind(const fs::path& path) {
  if (io::stands_for_files(path)) {
    const std::vector<fs::path> files = data_files(path);
    return files.size() == 1 ? file_kind(files.front()) : FileKind::ensemble;
  }
  return naming(path, [&] {
    const Format format = format_of(path);
    check_readable(path);
    if (format == Format::csv) return FileKind::ensemble;
    const io::Names found = read(path, format, {}).names;
    if (io::is_model(found)) return FileKind::model;
    if (io::is_ensemble(found)) return FileKind::ensemble;
    if (io::is_update_state(found))
      fail(
          "a state file of identify --state found, an ensemble or a model needed; only tokid update reads state files");
    if (io::is_controller(found)) return FileKind::controller;
    fail("neither an ensemble ('u', 'y') nor a model ('A', 'state_dim') found among {}", io::quoted(found));
  });
}

namespace {

Ensemble in_wanted_order(Ensemble found, const ReadOptions& options) {
  const bool chosen = !options.inputs.empty() || !options.outputs.empty();
  std::optional<Ensemble> ordered = chosen ? std::nullopt : in_order(found, options.wanted);
  return ordered ? *std::move(ordered) : std::move(found);
}

// Reads one or several .csv. Errors end with the command that reads the tables of other programs.
template <class Files>
Ensemble read_tables(const Files& files, const std::vector<fs::path>& given, const ReadOptions& options) {
  try {
    return io::read_csv(files, options);
  } catch (const IoError& error) {
    std::string text = fmt::format("{}. To read a table of another program: tokid import", error.what());
    for (const fs::path& path : given) text += " " + io::in_quotes(path.string());
    throw IoError(text + " data.npz");
  }
}

Ensemble load_one(const fs::path& path, const ReadOptions& options) {
  Ensemble found = loaded(path, [&](Format format) {
    if (format == Format::csv) return read_tables(path, {path}, options);
    if (!options.inputs.empty() || !options.outputs.empty())
      fail("columns can be chosen in .csv files only; here 'u' are the inputs and 'y' the outputs");
    const io::Fields fields(read(path, format, io::ensemble_names()));
    if (io::is_model(fields.names())) fail("a model found, an ensemble ('u', 'y') needed");
    if (io::is_controller(fields.names())) fail("a controller of tokid lqr found, an ensemble ('u', 'y') needed");
    Ensemble e = io::ensemble_of(fields, options.outputs_required);
    io::complete_sample_time(e, e.steps(), fields.names(),
                             [&](const io::Names& wanted) { return read(path, format, wanted); });
    return e;
  });
  return in_wanted_order(std::move(found), options);
}

// Removes further names of a file. A remark names them if they differ.
void keep_once(std::vector<fs::path>& files, io::Names& remarks) {
  std::vector<fs::path> kept;
  std::map<fs::path, fs::path> names;  // by the canonical path
  for (fs::path& file : files) {
    std::error_code error;
    const fs::path canonical = fs::canonical(file, error);
    const auto [at, is_new] = names.try_emplace(error ? file : canonical, file);
    if (is_new)
      kept.push_back(std::move(file));
    else if (at->second != file)
      remarks.push_back(
          fmt::format("'{}' and '{}' are the same file, which was read only once", at->second.string(), file.string()));
  }
  files = std::move(kept);
}

io::Names remarks_on_subfolders(const std::vector<fs::path>& paths) {
  io::Names remarks;
  for (const fs::path& path : paths)
    if (const io::Names skipped = io::subfolders_with_csv(path); !skipped.empty())
      remarks.push_back(fmt::format(
          "the folder '{}' has .csv files in {} {}, which were not read. To read them, name these folders, too",
          path.string(), skipped.size() == 1 ? "the subfolder" : "the subfolders", io::quoted(skipped)));
  return remarks;
}

// How messages name several files.
fs::path name_of(const std::vector<fs::path>& paths, const std::vector<fs::path>& files) {
  if (paths.size() == 1) return paths.front();
  return fmt::format("{} and {} more", files.front().string(), files.size() - 1);
}

}  // namespace

Ensemble load_ensemble(const fs::path& path, const ReadOptions& options) {
  return load_ensemble(std::vector<fs::path>{path}, options);
}

Ensemble load_ensemble(const std::vector<fs::path>& paths, const ReadOptions& options) {
  if (paths.empty()) throw std::invalid_argument("paths: no path found, one or more needed");
  if (paths.size() == 1 && !io::stands_for_files(paths.front())) return load_one(paths.front(), options);
  std::vector<fs::path> files;
  for (const fs::path& path : paths)
    for (fs::path& file : data_files(path)) files.push_back(std::move(file));
  std::sort(files.begin(), files.end(),
            [](const fs::path& a, const fs::path& b) { return io::is_before(a.string(), b.string()); });
  io::Names remarks = remarks_on_subfolders(paths);
  keep_once(files, remarks);
  for (const fs::path& file : files)
    naming(file, [&] {
      if (files.size() > 1 && format_of(file) != Format::csv)
        fail("{} files found, from '{}' to '{}', but several files must all be .csv", files.size(),
             files.front().string(), files.back().string());
      check_readable(file);
      return 0;
    });
  if (files.size() == 1 && format_of(files.front()) != Format::csv) return load_one(files.front(), options);
  Ensemble found = naming(name_of(paths, files), [&] { return read_tables(files, paths, options); });
  found.remarks.insert(found.remarks.begin(), remarks.begin(), remarks.end());
  return in_wanted_order(std::move(found), options);
}

void io::load_arrays(const fs::path& path, const Names& wanted, const std::function<void(const Fields&)>& use) {
  loaded(path, [&](Format format) {
    use(Fields(read(path, format, wanted)));
    return 0;
  });
}

Model load_model(const fs::path& path) {
  Model model;
  io::load_arrays(path, io::model_names(), [&](const io::Fields& fields) {
    if (io::is_ensemble(fields.names())) fail("an ensemble found, a model ('A', 'B', 'C', 'D', 'state_dim') needed");
    if (io::is_controller(fields.names()))
      fail("a controller of tokid lqr found, a model ('A', 'B', 'C', 'D', 'state_dim') needed");
    model = io::model_of(fields);
  });
  return model;
}

void save_ensemble(const Ensemble& ensemble, const fs::path& path, const WriteOptions& options) {
  naming_write(path, [&] {
    const Format format = format_of(path);
    io::check_sizes(ensemble);
    io::AtomicFile file(path);
    if (format == Format::csv)
      io::write_csv(ensemble, file.path());
    else
      write(io::arrays_of(ensemble, layout_of(format)), file.path(), format, options);
    file.commit();
  });
}

void io::save_arrays(const fs::path& path, const WriteOptions& options, const std::function<Arrays(Layout)>& arrays) {
  naming_write(path, [&] {
    const Format format = format_of(path);
    AtomicFile file(path);
    write(arrays(layout_of(format)), file.path(), format, options);
    file.commit();
  });
}

void save_model(const Model& model, const fs::path& path, const WriteOptions& options) {
  model.check();
  naming_write(path, [&] {
    const Format format = format_of(path);
    io::AtomicFile file(path);
    if (format == Format::hdf5)
      io::write_hdf5(io::pieces_of(model), file.path());
    else
      write(io::arrays_of(model, layout_of(format)), file.path(), format, options);
    file.commit();
  });
}

void save_text(std::string_view text, const fs::path& path) {
  naming_write(path, [&] {
    io::AtomicFile file(path);
    io::ByteWriter(file.path()).write(text);
    file.commit();
  });
}

}  // namespace tokid
