// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <string_view>

namespace tokid::app {

namespace {

CLI::Option* described(CLI::Option* option, const char* type) {
  const bool argument = option->get_lnames().empty() && option->get_snames().empty();
  option->required(argument)->type_name(type)->check([](const std::string& text) {
    return text.empty() ? std::string("'' found, a text that is not empty needed") : std::string();
  });
  return option;
}

Choices<DateOrder> date_orders() {
  return {{"day-first", DateOrder::day_first}, {"month-first", DateOrder::month_first}};
}

Choices<ResampleMethod> resample_methods() {
  return {{"linear", ResampleMethod::linear}, {"previous", ResampleMethod::previous}, {"mean", ResampleMethod::mean}};
}

// \pre one of the choices has this value
template <class T>
std::string word_for(const Choices<T>& choices, T value) {
  return std::find_if(choices.begin(), choices.end(), [value](const auto& choice) { return choice.second == value; })
      ->first;
}

}  // namespace

std::vector<std::string> split_at_commas(const std::string& text) { return CLI::detail::split(text, ','); }

std::optional<std::vector<Index>> parse_steps(const std::string& text) {
  std::vector<Index> result;
  for (const std::string& part : split_at_commas(text)) {
    const std::optional<Index> step = parse_number<Index>(part, 0, std::numeric_limits<Index>::max());
    if (!step) return std::nullopt;
    result.push_back(*step);
  }
  return result;
}

Command::Command(CLI::App& tool, const char* name, const char* description, const char* example)
    : parser_(tool.add_subcommand(name, description)) {
  parser_->group("Commands");
  parser_->footer(fmt::format("Example:\n  {}", example));
}

void Command::argument(const char* name, fs::path& file, const char* description) {
  described(parser_->add_option(name, file, description), "");
}

void Command::argument(const char* name, std::vector<fs::path>& files, const char* description) {
  described(parser_->add_option(name, files, description), "");
}

fs::path shown(const std::vector<fs::path>& paths) {
  if (paths.size() == 1) return paths.front();
  return fmt::format("{} and {} more", paths.front().string(), paths.size() - 1);
}

std::string word(const std::string& text) {
  const bool plain = !text.empty() && std::all_of(text.begin(), text.end(), [](char c) {
    return std::string_view(" \t\n\"'\\$`!*?[]{}()<>|&;#~").find(c) == std::string_view::npos;
  });
  if (plain) return text;
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

std::string words_of(const std::vector<fs::path>& paths) {
  std::vector<std::string> words;
  for (const fs::path& path : paths) words.push_back(word(path.string()));
  return fmt::format("{}", fmt::join(words, " "));
}

std::string words_of(const ReadOptions& options) {
  const ReadOptions defaults;
  // All fields, so that a new one is an error here. outputs_required and wanted have no option.
  const auto& [inputs, outputs, outputs_required, wanted, time, experiment, missing, dates, dt, trigger, before,
               resample, resample_method, held, longest_gap] = options;
  std::string text;
  const auto add = [&text](const char* name, const std::string& value) {
    text += fmt::format(" {} {}", name, word(value));
  };
  const auto add_list = [&add](const char* name, const std::vector<std::string>& list) {
    if (!list.empty()) add(name, fmt::format("{}", fmt::join(list, ",")));
  };
  add_list("--inputs", inputs);
  add_list("--outputs", outputs);
  if (!time.empty()) add("--time", time);
  if (!experiment.empty()) add("--experiment-column", experiment);
  add_list("--missing", missing);
  if (dates != defaults.dates) add("--dates", word_for(date_orders(), dates));
  if (dt) add("--dt", fmt::format("{}", *dt));
  if (!trigger.empty()) add("--trigger", trigger);
  if (before != defaults.before) add("--before", fmt::format("{}", before));
  if (resample) add("--resample", fmt::format("{}", *resample));
  if (resample_method != defaults.resample_method)
    add("--resample-method", word_for(resample_methods(), resample_method));
  add_list("--held", held);
  if (longest_gap) add("--longest-gap", fmt::format("{}", *longest_gap));
  return text;
}

void Command::data(const char* name, std::vector<fs::path>& paths, fs::path& shown, const char* description) {
  const auto set = [&paths, &shown](const std::vector<std::string>& texts) {
    paths.assign(texts.begin(), texts.end());
    shown = app::shown(paths);
  };
  described(parser_->add_option_function<std::vector<std::string>>(name, set, description), "");
}

void Command::file(const char* name, fs::path& target, const char* description) {
  described(parser_->add_option(name, target, description), "FILE");
}

void Command::files(const char* name, std::vector<fs::path>& targets, const char* description) {
  described(parser_->add_option(name, targets, description), "FILE ...");
}

void Command::output(fs::path& target, const char* description, const char* type) {
  described(parser_->add_option("-o,--output", target, description), type)->required();
}

void Command::name(const char* name, std::string& target, const char* type, const char* description) {
  described(parser_->add_option(name, target, description), type);
}

void Command::columns(ReadOptions& options) {
  const auto add = [this](const char* name, std::vector<std::string>& target, const char* type, const char* what,
                          const char* description) {
    const auto set = [&target, name, what](const std::string& text) {
      target = split_at_commas(text);
      for (const std::string& column : target)
        if (column.empty())
          throw CLI::ValidationError(
              name, fmt::format("'{}' contains an empty {}. Write one comma between two of them", text, what));
    };
    described(parser_->add_option_function<std::string>(name, set, description), type);
  };
  constexpr auto name_of_column = "name of a column", word = "word";
  add("--inputs", options.inputs, "A,B,...", name_of_column,
      "Columns of a .csv that are inputs (default: names beginning with u)");
  add("--outputs", options.outputs, "A,B,...", name_of_column,
      "Columns of a .csv that are outputs (default: names beginning with y)");
  name("--time", options.time, "NAME",
       "Column of a .csv with the times (default: by names such as time and t, or by time stamps)");
  name("--experiment-column", options.experiment, "NAME",
       "Column of a .csv that names the experiments (default: experiment)");
  add("--missing", options.missing, "WORD,...", word,
      "Words in a .csv that stand for a missing sample, besides Bad, ---, NaN, null and others");
  choice("--dates", options.dates, date_orders(),
         "Order of day and month in dates of a .csv such as 03/04/2026 (default: the order that its dates show)");
  name("--trigger", options.trigger, "CONDITION",
       "Condition on a column of a .csv, as 'valve>0.5': step 0 is the first sample at which it holds");
  number("--before", options.before, "STEPS", "Steps to keep before the trigger (default 0)", Index{0},
         Index{1'000'000'000});
  const auto seconds = [](const std::string& text) {
    return parse_number(text, std::numeric_limits<double>::min(), std::numeric_limits<double>::max());
  };
  value("--dt", options.dt, "SECONDS",
        "Sample time of a .csv: times are moved to its steps, by up to a tenth of a step", seconds,
        "a positive sample time in seconds needed");
  value("--resample", options.resample, "SECONDS", "Resample a .csv to a common time grid with this sample time",
        seconds, "a positive sample time in seconds needed");
  choice("--resample-method", options.resample_method, resample_methods(), "Method of --resample (default linear)");
  add("--held", options.held, "A,B,...", name_of_column,
      "Channels of a .csv that hold their value until the next sample: --resample repeats their last sample");
  value(
      "--longest-gap", options.longest_gap, "STEPS",
      "Longest gap that --resample fills (default 3; no limit for --held and the method previous)",
      [](const std::string& text) { return parse_number<std::int64_t>(text, 1, 1'000'000'000); },
      "a whole number from 1 to 1000000000 needed");
}

void Command::horizon(Index& target) {
  number<Index>("--horizon", target, "H", "Number of steps ahead of the predictions (default 1)", 1, 1'000'000);
}

void Command::threads(int& target) {
  number("--threads", target, "N", "Number of threads, 0 for all threads of the machine (default 1)", 0, 1024);
}

void Command::verbose(bool& target) { flag("--verbose", target, "Print the details: reasons, candidates, tests"); }

void Command::flag(const char* name, bool& target, const char* description) {
  parser_->add_flag(name, target, description)->disable_flag_override();
}

void Command::flag(const char* name, std::function<void()> set, const char* description) {
  parser_->add_flag_callback(name, std::move(set), description)->disable_flag_override();
}

void Command::count_or_auto(const char* name, Index& target, const char* description) {
  const auto parse = [](const std::string& text) {
    return text == "auto" ? 0 : parse_number<Index>(text, 1, std::numeric_limits<Index>::max());
  };
  value(name, target, "N|auto", description, parse, "a whole number from 1 on or auto needed");
}

void Command::excludes(const char* name, const char* other) {
  parser_->get_option(name)->excludes(parser_->get_option(other));
}

void Command::needs(const char* name, const char* other) {
  parser_->get_option(name)->needs(parser_->get_option(other));
}

void Command::runs(std::function<void()> work) { parser_->callback(std::move(work)); }

void Command::text(const char* name, const char* type, const char* description,
                   std::function<bool(const std::string&)> set, std::string needed) {
  const auto take = [name = std::string(name), set = std::move(set),
                     needed = std::move(needed)](const std::string& text) {
    if (!set(text)) throw CLI::ValidationError(name, fmt::format("'{}' found, {}", text, needed));
  };
  described(parser_->add_option_function<std::string>(name, take, description), type);
}

}  // namespace tokid::app
