// What the subcommands share: reading and checking files, options, text and JSON for people and programs.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <charconv>
#include <chrono>
#include <filesystem>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "tokid/tokid.hpp"

namespace tokid::app {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;  // keys stay in the order in which they were written

// The processes that share the work; a single one, unless tokid-mpi says otherwise.
Team& team();

// The whole tool: its exit status, and what is wrong where that is not zero.
struct Outcome {
  int status = 0;
  std::string complaint;
};
Outcome run_tool(int argc, char** argv);

void add_commands(CLI::App& tool);
// What is wrong with a command line that could not be parsed.
std::string complaint(const CLI::App& tool, const CLI::ParseError& error);

// One function per subcommand, in a file of its own; the work is done when the command line has been parsed.
void add_identify(CLI::App& tool);
void add_validate(CLI::App& tool);
void add_confidence(CLI::App& tool);
void add_simulate(CLI::App& tool);
void add_predict(CLI::App& tool);
void add_info(CLI::App& tool);
void add_plan(CLI::App& tool);
void add_example(CLI::App& tool);
void add_convert(CLI::App& tool);
void add_refine(CLI::App& tool);
void add_update(CLI::App& tool);
void add_report(CLI::App& tool);
void add_paper(CLI::App& tool);

// Options

// A subcommand with its help text and one example of its use.
CLI::App* add_command(CLI::App& tool, const char* name, const char* description, const char* example);
// --inputs and --outputs, the columns of a .csv
void add_column_options(CLI::App* command, ReadOptions& options);
void add_output_option(CLI::App* command, fs::path& path, const char* description);
void add_horizon_option(CLI::App* command, Index& horizon);
// A positive whole number, or "auto", which is 0.
void add_count_or_auto(CLI::App* command, const char* name, Index& target, const char* description);

// The whole text as a number from `smallest` to `largest`, or nothing.
template <class T>
std::optional<T> parse_number(const std::string& text, T smallest, T largest) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  return whole && value >= smallest && value <= largest ? std::optional<T>(value) : std::nullopt;
}

template <class T>
CLI::Option* add_number(CLI::App* command, const char* name, T& target, const char* type, const char* description,
                        T smallest, T largest = std::numeric_limits<T>::max()) {
  const auto set = [=, &target](const std::string& text) {
    const std::optional<T> value = parse_number(text, smallest, largest);
    if (!value)
      throw CLI::ValidationError(
          name,
          fmt::format("'{}' found, a {}number {} needed", text, std::is_integral_v<T> ? "whole " : "",
                      largest == std::numeric_limits<T>::max() ? fmt::format("from {} on", smallest)
                                                               : fmt::format("from {} to {}", smallest, largest)));
    target = *value;
  };
  return command->add_option_function<std::string>(name, set, description)->type_name(type);
}

template <class T>
using Choices = std::vector<std::pair<std::string, T>>;

// One of several words; a wrong one is answered with the list.
template <class T>
CLI::Option* add_choice(CLI::App* command, const std::string& name, T& target, const Choices<T>& choices,
                        const char* description) {
  std::string words;
  for (const auto& [word, value] : choices) words += (words.empty() ? "" : "|") + word;
  const auto choose = [&target, choices, name, words](const std::string& text) {
    for (const auto& [word, value] : choices)
      if (word == text) {
        target = value;
        return;
      }
    throw CLI::ValidationError(name, fmt::format("'{}' found, one of {} needed", text, words));
  };
  return command->add_option_function<std::string>(name, choose, description)->type_name(words);
}

// Files

std::string extension_of(const fs::path& path);  // in lower case, with its dot

enum class Content { ensemble, model, bounds, state, page };
// Before long work: will the file be writable under this name, and is it none of those that are to be kept?
// \throws IoError for a wrong name, WriteError where the system does not let it be written
void check_output(const fs::path& path, Content content, const std::vector<fs::path>& kept = {});

// The library's complaints about an argument can't know the file that it came from.
template <class Work>
std::invoke_result_t<Work> about(const fs::path& file, Work&& work) {
  try {
    return work();
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(fmt::format("{}: {}", file.string(), error.what()));
  }
}

std::string coverage(const Ensemble& computed);  // at which steps something could be computed

// Numbers

Index rank_deficient_steps(const Model& model);
double median(std::vector<double> values);  // NaN for none

// Text

std::string number(double value);  // four digits, "-" for NaN
std::string percent(double value);
std::string penalty(double smoothing);  // lambda, or "infinity"
std::string plural(Index count, const char* noun);
std::string describe(const Ensemble& ensemble);
std::string describe(Index experiments, Index steps, Index inputs, Index outputs, double dt);
std::string describe(const Model& model);
// "position [m]", or "y1" without a name
std::string output_label(const Channels& names, Index j);
std::string input_label(const Channels& names, Index i);

// A label on the left, what it says on the right; tables below.
class Page {
 public:
  void row(std::string_view label, std::string_view text);
  // First row: the heading. First column to the left, the others to the right.
  void table(const std::vector<std::vector<std::string>>& rows);
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

// Output

Json numbers(const Vector& values);
Json json_penalty(double smoothing);  // lambda, or "infinity", which JSON has no number for
void print(const std::string& text);  // on stdout. \throws std::system_error, but not where the reader has gone
void print(const Json& json);
void message(std::string_view text);                  // one line on stderr
void warn(const std::vector<std::string>& warnings);  // on stderr

// Drawn on stderr where that is a terminal, once the work has taken a moment; erased at the end.
class ProgressBar {
 public:
  explicit ProgressBar(bool wanted);
  ~ProgressBar();
  ProgressBar(const ProgressBar&) = delete;
  ProgressBar& operator=(const ProgressBar&) = delete;
  Progress callback();

 private:
  void draw(double share);

  using Clock = std::chrono::steady_clock;
  bool enabled_, drawn_ = false;
  Clock::time_point next_;
};

}  // namespace tokid::app
