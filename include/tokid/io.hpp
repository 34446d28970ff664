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

// How samples at uneven times become samples of a grid: by linear interpolation, as the last sample at or before each
// step, or as the mean of the samples within half a step.
enum class ResampleMethod { linear, previous, mean };

// The order of day and month in dates such as 03/04/2026. Automatic: the dates of the column decide, or it is refused.
enum class DateOrder { automatic, day_first, month_first };

struct ReadOptions {
  // Columns of a .csv that are inputs and outputs; empty: the columns whose names begin with u and y.
  std::vector<std::string> inputs = {}, outputs = {};
  bool outputs_required = true;  // false: the file may have inputs alone (m = 0), or outputs without a sample
  // The channels that the caller needs, for example the channels of a model, with all names set; see complete(). The
  // reader returns the channels with these names, in this order. In a .csv it takes the columns with these names,
  // unless `inputs` and `outputs` state other columns. Empty: all channels in the order of the file.
  Channels wanted = {};
  // Of .csv files alone:
  std::string time = {};                  // the column of times; empty: found by its name or its time stamps
  std::string experiment = {};            // the column that names the experiments; empty: the column `experiment`
  std::vector<std::string> missing = {};  // more words that stand for a missing sample, such as "-999"
  DateOrder dates = DateOrder::automatic;
  // Sample time [s]. Times that lie up to a tenth of a step beside their step are moved to it, and a remark states the
  // largest distance. Empty: the comments of the file or the times state it, and the times must be even.
  std::optional<double> dt = {};
  // "valve > 0.5": the first sample at which this holds becomes step 0 of its experiment. Any column, one of
  // > >= < <= == !=, and a number; with == and != also a text. Empty: no alignment.
  std::string trigger = {};
  std::int64_t before = 0;              // steps that are kept before the trigger, ≥ 0
  std::optional<double> resample = {};  // sample time of a new common grid [s]; empty: the samples stay
  ResampleMethod resample_method = ResampleMethod::linear;
  // Channels that hold their value between two samples, such as switched valves. They are resampled by the method
  // previous, whatever the method of the others.
  std::vector<std::string> held = {};
  // Steps: longer gaps are not filled by resampling, ≥ 1. Empty: 3, or no limit for held channels and the method
  // previous, because a channel that is logged at its changes holds its value until the next one.
  std::optional<std::int64_t> longest_gap = {};
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
