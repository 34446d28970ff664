// Common parts of the subcommands: checks of files, and text and JSON for people and programs.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <functional>
#include <mutex>
#include <stop_token>
#include <string>
#include <string_view>
#include <thread>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/finding_json.hpp"
#include "text.hpp"
#include "tokid/tokid.hpp"

namespace tokid::app {

namespace fs = std::filesystem;

// Files

std::string extension_of(const fs::path& path);  // in lower case, with its dot

enum class Content { ensemble, model, bounds, state, controller, page, table, code };
// Checks before long work that the file can be written under this name, and that it is not one of the files in `kept`,
// whose paths may also be folders and patterns.
// \throws IoError for a wrong name, WriteError if the system does not permit writing
void check_output(const fs::path& path, Content content, const std::vector<fs::path>& kept = {});

// Loads the data for a model. Channels that have the names of the model's channels are found by name.
Ensemble load_data(const Model& model, const fs::path& path, ReadOptions options);
Ensemble load_data(const Model& model, const std::vector<fs::path>& paths, ReadOptions options);
Json json_of(const std::vector<fs::path>& paths);  // one text, or a list of several

// Loads the wanted outputs of a model, one experiment. \throws std::invalid_argument for another number of experiments
Ensemble load_reference(const Model& model, const fs::path& path, ReadOptions options);

// Locks a file that is read, changed and written. If another process has the lock, the function reports on stderr that
// it waits. \throws as FileLock
//
// A signal that ends the process would skip all destructors. While this object lives, such a signal therefore removes
// the lock file before the process ends. At most one object at a time.
class HeldFile : public FileLock {
 public:
  explicit HeldFile(const fs::path& path, double limit = LockOptions().limit);
  ~HeldFile();
  HeldFile(const HeldFile&) = delete;
  HeldFile& operator=(const HeldFile&) = delete;
};
bool same_file(const fs::path& a, const fs::path& b);  // also for names of files that do not exist

// Puts the name of the file in front of errors about an argument, because the library does not know the file.
template <class Work>
std::invoke_result_t<Work> about(const fs::path& file, Work&& work) {
  try {
    return work();
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(fmt::format("{}: {}", file.string(), error.what()));
  }
}

// As above, for arguments of several files: each file with the name of its argument, with which the message begins.
template <class Work>
std::invoke_result_t<Work> about(const std::vector<std::pair<std::string, fs::path>>& files, Work&& work) {
  try {
    return work();
  } catch (const std::invalid_argument& error) {
    for (const auto& [argument, file] : files)
      if (std::string_view(error.what()).starts_with(argument + ':'))
        throw std::invalid_argument(fmt::format("{}: {}", file.string(), error.what()));
    throw;
  }
}

std::string coverage(const Ensemble& computed);  // in words: the steps with computed outputs

// Numbers

Index rank_deficient_steps(const Model& model);
double median(std::vector<double> values);  // NaN for an empty list

// Text

std::string number(double value);       // three significant digits, a dash for NaN
std::string share(double value);        // in percent, or as a factor from 10 on; a dash for NaN
std::string percent(double fit);        // as words::percent()
std::string penalty(double smoothing);  // lambda, or "infinity"
std::string plural(Index count, const char* noun);
std::string describe(const Ensemble& ensemble);
std::string describe(Index experiments, Index steps, Index inputs, Index outputs, double dt);
std::string describe(const Model& model);
// "position [m]", or "y1" without a name
std::string output_label(const Channels& names, Index j);
std::string input_label(const Channels& names, Index i);

// Output

Json numbers(const Vector& values);
Json json_penalty(double smoothing);  // lambda, or "infinity", because JSON has no such number
void print(const std::string& text);  // on stdout. \throws std::system_error, but not if the reader has closed the pipe
void print(const Json& json);
void warn(const std::vector<std::string>& warnings);  // on stderr
void warn(const Findings& findings);
// Adds "findings", as values, and "warnings", the same findings as sentences.
void add_findings(Json& json, const Findings& findings);
Json json_of(const std::vector<OutlyingSamples>& outlying);

// A line on stderr: the finished share, the present stage and the time so far. The line appears only if stderr is a
// terminal and the work takes longer than 0.1 s. A thread draws it, so that the time goes on while there is no report.
// The destructor erases it.
class ProgressBar {
 public:
  explicit ProgressBar(bool wanted);
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  Progress callback();
  // Prints a line above the bar if the work goes on for `seconds` more. `text` makes the line, in another thread than
  // the work; empty: nothing is printed.
  void note_after(std::chrono::seconds seconds, std::function<std::string()> text);

 private:
  using Clock = std::chrono::steady_clock;
  void run(const std::stop_token& stop);
  std::string line(const ProgressReport& report) const;

  bool enabled_, drawn_ = false;
  Clock::time_point begin_ = Clock::now();
  std::mutex mutex_;  // of the members below
  ProgressReport report_;
  Clock::time_point note_at_;
  std::function<std::string()> note_;
  std::condition_variable_any wake_;
  std::jthread thread_;  // the last member: it uses the others
};

}  // namespace tokid::app
