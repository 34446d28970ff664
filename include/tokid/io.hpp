// Ensembles and models in files; the format follows the extension: .npz, .h5 / .hdf5, .mat, .csv (ensembles only).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
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

struct ReadOptions {
  // Columns of a .csv that are inputs and outputs; empty: those whose names begin with u and y.
  std::vector<std::string> inputs = {}, outputs = {};
  bool outputs_required = true;  // false: inputs alone will do (m = 0), and outputs without a sample
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

// The file appears whole or not at all: written beside its target, then renamed. \throws IoError
void save_ensemble(const Ensemble& ensemble, const std::filesystem::path& path, const WriteOptions& options = {});
void save_model(const Model& model, const std::filesystem::path& path, const WriteOptions& options = {});
// Text as it stands, such as a page; any extension.
void save_text(std::string_view text, const std::filesystem::path& path);

// Text from a file or a name, as one line for people: control characters and line separators, which a terminal would
// obey, become spaces, marks that turn the direction of the text are left out, and what is not UTF-8 becomes U+FFFD.
std::string printable(std::string_view text);

}  // namespace tokid
