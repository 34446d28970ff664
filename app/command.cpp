// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <string_view>

#include "io/naming.hpp"

namespace tokid::app {

namespace {

CLI::Option* described(CLI::Option* option, const char* type) {
  const bool argument = option->get_lnames().empty() && option->get_snames().empty();
  option->required(argument)->type_name(type)->check([](const std::string& text) {
    return text.empty() ? std::string("'' found, a text that is not empty needed") : std::string();
  });
  return option;
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
  return plain ? text : io::in_quotes(text);
}

std::string words_of(const std::vector<fs::path>& paths) {
  std::vector<std::string> words;
  for (const fs::path& path : paths) words.push_back(word(path.string()));
  return fmt::format("{}", fmt::join(words, " "));
}

std::string words_of(const ReadOptions& options) {
  std::string text;
  const auto add = [&text](const char* name, const std::vector<std::string>& list) {
    if (!list.empty()) text += fmt::format(" {} {}", name, word(fmt::format("{}", fmt::join(list, ","))));
  };
  add("--inputs", options.inputs);
  add("--outputs", options.outputs);
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
  const auto add = [this](const char* name, std::vector<std::string>& target, const char* description) {
    const auto set = [&target, name](const std::string& text) {
      target = split_at_commas(text);
      for (const std::string& column : target)
        if (column.empty())
          throw CLI::ValidationError(
              name, fmt::format("'{}' contains an empty name of a column. Write one comma between two of them", text));
    };
    described(parser_->add_option_function<std::string>(name, set, description), "A,B,...");
  };
  add("--inputs", options.inputs, "Columns of a .csv that are inputs (default: names beginning with u)");
  add("--outputs", options.outputs, "Columns of a .csv that are outputs (default: names beginning with y)");
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
