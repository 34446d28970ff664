// Ensembles and models in files; the format follows the extension: .npz, .h5 / .hdf5, .mat, .csv (ensembles only).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/model.hpp"

namespace tokid {

// A file that can't be read or written, or does not hold what it should: names the file, the data set, what was found
// and what is needed.
class IoError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

// A file that the system does not let be written: no space left, a read-only target, no permission.
class WriteError : public IoError {
 public:
  // `error`: the errno, or 0 where nobody has told
  WriteError(const std::string& text, int error) : IoError(text), error_(error) {}
  int error() const { return error_; }

 private:
  int error_;
};

struct ReadOptions {
  // Columns of a .csv that are inputs and outputs; empty: those whose names begin with u and y.
  std::vector<std::string> inputs = {}, outputs = {};
  bool outputs_required = true;  // false: inputs alone will do (m = 0), and outputs without a sample
  // The channels that the data are needed for, with all of their names: those of a model, see complete(). Channels with
  // these names are taken in this order; columns of a .csv too, unless they are stated above. Empty: as the file has
  // it.
  Channels wanted = {};
};

// Which file it is, and when it last changed: not even programs that set the time of a file can set that of its status.
struct FileState {
  std::uint64_t number = 0, bytes = 0;
  std::string modified, changed;  // in UTC
};

enum class FileKind { ensemble, model };

// docs/formats.md holds the names and shapes. \throws IoError
FileKind file_kind(const std::filesystem::path& path);
Ensemble load_ensemble(const std::filesystem::path& path, const ReadOptions& options = {});
Model load_model(const std::filesystem::path& path);

// MATLAB version of .mat files: 7 unless v7.3 is asked for.
struct WriteOptions {
  bool mat73 = false;
};

// The file appears whole or not at all: written beside its target without a name, which it gets at the end. \throws
// IoError where the name is none to write to, WriteError
void save_ensemble(const Ensemble& ensemble, const std::filesystem::path& path, const WriteOptions& options = {});
void save_model(const Model& model, const std::filesystem::path& path, const WriteOptions& options = {});
// Text as it stands, such as a page; any extension.
void save_text(std::string_view text, const std::filesystem::path& path);

// Results that belong together. While it lives, what this thread saves waits whole, but without its name; commit()
// gives the names, in the order of saving. Without it, nothing has been written.
class FilesTogether {
 public:
  FilesTogether();
  ~FilesTogether();
  FilesTogether(const FilesTogether&) = delete;
  FilesTogether& operator=(const FilesTogether&) = delete;

  // \throws WriteError where one can't have its name; those before it keep theirs
  void commit();

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace tokid
