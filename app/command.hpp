// A subcommand: its arguments, its options, and its work after the command line has been parsed.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <filesystem>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <system_error>
#include <type_traits>
#include <utility>
#include <vector>

#include "tokid/io.hpp"

namespace CLI {
class App;  // known to command.cpp and tool.cpp only, because CLI11 takes longer to compile than the commands
}

namespace tokid::app {

namespace fs = std::filesystem;

// Reads the whole text as a number from `smallest` to `largest`. Empty if the text is not such a number.
template <class T>
std::optional<T> parse_number(const std::string& text, T smallest, T largest) {
  T value{};
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  return whole && value >= smallest && value <= largest ? std::optional<T>(value) : std::nullopt;
}

std::vector<std::string> split_at_commas(const std::string& text);
// "0,20,50"; empty if the text is not such a list
std::optional<std::vector<Index>> parse_steps(const std::string& text);

// How reports name the paths of data: "run1.csv and 24 more". This name is no path; see words_of().
fs::path shown(const std::vector<fs::path>& paths);

// A word of a command, in quotation marks if the shell needs them.
std::string word(const std::string& text);
// Words of a command that make it read the same data: the paths, and the options of Command::columns() that differ from
// their defaults. The options begin with a space; they are empty if none differs.
std::string words_of(const std::vector<fs::path>& paths);
std::string words_of(const ReadOptions& options);

template <class T>
using Choices = std::vector<std::pair<std::string, T>>;

template <class T>
inline constexpr bool is_optional = false;
template <class T>
inline constexpr bool is_optional<std::optional<T>> = true;

// Every target must live until the command line is parsed, because the parser writes to it. Names without a dash are
// required arguments. No argument or option accepts an empty text, because that would mean "not given".
class Command {
 public:
  // Adds the command with its help text and one example of its use.
  Command(CLI::App& tool, const char* name, const char* description, const char* example);

  void argument(const char* name, fs::path& file, const char* description);
  void argument(const char* name, std::vector<fs::path>& files, const char* description);  // one or more
  // One or more files, folders or patterns that make one ensemble. `shown` becomes their name in reports.
  void data(const char* name, std::vector<fs::path>& paths, fs::path& shown, const char* description);
  void file(const char* name, fs::path& target, const char* description);
  void files(const char* name, std::vector<fs::path>& targets, const char* description);  // one or more, also repeated
  void output(fs::path& target, const char* description, const char* type = "FILE");      // -o, required
  void name(const char* name, std::string& target, const char* type, const char* description);
  void columns(ReadOptions& options);  // --inputs, --outputs of a .csv
  void horizon(Index& target);
  void threads(int& target);
  void verbose(bool& target);
  void flag(const char* name, bool& target, const char* description);
  void flag(const char* name, std::function<void()> set, const char* description);
  // A positive whole number, or "auto", which is 0.
  void count_or_auto(const char* name, Index& target, const char* description);

  template <class T>
  void number(const char* name, T& target, const char* type, const char* description, T smallest,
              T largest = std::numeric_limits<T>::max()) {
    const std::string range = largest == std::numeric_limits<T>::max()
                                  ? fmt::format("from {} on", smallest)
                                  : fmt::format("from {} to {}", smallest, largest);
    value(
        name, target, type, description, [=](const std::string& text) { return parse_number(text, smallest, largest); },
        fmt::format("a {}number {} needed", std::is_integral_v<T> ? "whole " : "", range));
  }

  // One of several words. The message about a wrong word lists them.
  template <class T, class Meaning>
  void choice(const char* name, T& target, const Choices<Meaning>& choices, const char* description) {
    std::string words;
    for (const auto& [word, meaning] : choices) words += (words.empty() ? "" : "|") + word;
    const auto set = [&target, choices](const std::string& text) {
      const auto found =
          std::find_if(choices.begin(), choices.end(), [&](const auto& one) { return one.first == text; });
      if (found != choices.end()) target = found->second;
      return found != choices.end();
    };
    text(name, words.c_str(), description, set, fmt::format("one of {} needed", words));
  }

  // Sets the target to the value that `parse` returns for the text. If `parse` returns none, the error message contains
  // the text and `needed`.
  template <class T, class Parse>
  void value(const char* name, T& target, const char* type, const char* description, const Parse& parse,
             std::string needed) {
    using Parsed = std::invoke_result_t<Parse, const std::string&>;
    // std::optional(x) copies an optional x and does not wrap it. "No value" would then be a value.
    static_assert(!is_optional<typename Parsed::value_type>, "`parse` must return an optional of a plain value");
    const auto set = [&target, parse](const std::string& text) {
      Parsed parsed = parse(text);
      if (parsed) target = std::move(*parsed);
      return parsed.has_value();
    };
    text(name, type, description, set, std::move(needed));
  }

  // `set` returns whether it accepted the text.
  void text(const char* name, const char* type, const char* description, std::function<bool(const std::string&)> set,
            std::string needed);

  void excludes(const char* name, const char* other);  // the two options can't be given together
  void needs(const char* name, const char* other);     // the first option has no effect without the other one
  void runs(std::function<void()> work);

 private:
  CLI::App* parser_;
};

// One function per subcommand, in a file of its own.
void add_identify(CLI::App& tool);
void add_validate(CLI::App& tool);
void add_confidence(CLI::App& tool);
void add_modes(CLI::App& tool);
void add_simulate(CLI::App& tool);
void add_predict(CLI::App& tool);
void add_info(CLI::App& tool);
void add_plan(CLI::App& tool);
void add_lqr(CLI::App& tool);
void add_learn(CLI::App& tool);
void add_export(CLI::App& tool);
void add_example(CLI::App& tool);
void add_convert(CLI::App& tool);
void add_import(CLI::App& tool);
void add_refine(CLI::App& tool);
void add_update(CLI::App& tool);
void add_report(CLI::App& tool);
void add_paper(CLI::App& tool);

}  // namespace tokid::app
