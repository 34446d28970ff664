// Ensembles and models in files; the format follows the extension: .npz, .h5 / .hdf5, .mat, .csv (ensembles only).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/model.hpp"

namespace tokid {

// The error for a file that can't be read or written, or has the wrong content. The message names the file and the data
// set, the value found and the value needed.
class IoError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// The error for a file that the operating system can't write: no space left, a read-only target, no permission.
class WriteError : public IoError {
 public:
  // `error`: the errno, or 0 if it is not known
  WriteError(const std::string& text, int error) : IoError(text), error_(error) {}
  int error() const { return error_; }

 private:
  int error_;
};

struct ReadOptions {
  // Columns of a .csv that are inputs and outputs; empty: the columns whose names begin with u and y.
  std::vector<std::string> inputs = {}, outputs = {};
  bool outputs_required = true;  // false: the file may have inputs alone (m = 0), or outputs without a sample
  // The channels that the caller needs, for example the channels of a model, with all names set; see complete(). The
  // reader returns the channels with these names, in this order. In a .csv it takes the columns with these names,
  // unless `inputs` and `outputs` state other columns. Empty: all channels in the order of the file.
  Channels wanted = {};
};

enum class FileKind { ensemble, model, controller };

// Reading of files; docs/formats.md has the names and shapes. \throws IoError
FileKind file_kind(const std::filesystem::path& path);
Ensemble load_ensemble(const std::filesystem::path& path, const ReadOptions& options = {});
// Many .csv files: each experiment of each file is an experiment of the ensemble, named after its file. A path may be a
// file, a folder (all its .csv files) or a pattern (runs/*.csv). The files are sorted by name, run2 before run10.
// Channels are found by name, and lengths may differ. One path is read as by the function above, which also takes
// folders and patterns. \throws std::invalid_argument for an empty list
Ensemble load_ensemble(const std::vector<std::filesystem::path>& paths, const ReadOptions& options = {});
// The .csv files of a folder or of a pattern, sorted by name; the path itself, if it is that of a file.
std::vector<std::filesystem::path> data_files(const std::filesystem::path& path);
Model load_model(const std::filesystem::path& path);

// MATLAB version of .mat files: 7.3 if mat73, else 7.
struct WriteOptions {
  bool mat73 = false;
};

// Writing of files. The file appears as a whole or not at all: it is first written without a name, in the folder of the
// target, and gets its name at the end. \throws IoError if the name is not valid for writing, WriteError
void save_ensemble(const Ensemble& ensemble, const std::filesystem::path& path, const WriteOptions& options = {});
void save_model(const Model& model, const std::filesystem::path& path, const WriteOptions& options = {});
// Writes a text unchanged, for example a page. The name may have any extension.
void save_text(std::string_view text, const std::filesystem::path& path);

// Files that must appear together. While this object lives, the files that this thread saves are complete but have no
// name. commit() gives them their names, in the order of saving. Without commit(), nothing is written.
class FilesTogether {
 public:
  FilesTogether();
  ~FilesTogether();
  FilesTogether(const FilesTogether&) = delete;
  FilesTogether& operator=(const FilesTogether&) = delete;

  // \throws WriteError if a file can't get its name; files that already have their names keep them
  void commit();

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace tokid
