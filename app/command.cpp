// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"

#include <CLI/CLI.hpp>

namespace tokid::app {

namespace {

CLI::Option* described(CLI::Option* option, const char* type) {
  const bool argument = option->get_lnames().empty() && option->get_snames().empty();
  return option->required(argument)->type_name(type);
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

void Command::file(const char* name, fs::path& target, const char* description) {
  described(parser_->add_option(name, target, description), "FILE");
}

void Command::files(const char* name, std::vector<fs::path>& targets, const char* description) {
  described(parser_->add_option(name, targets, description), "FILE ...");
}

void Command::output(fs::path& target, const char* description, const char* type) {
  described(parser_->add_option("-o,--output", target, description), type)->required();
}

void Command::columns(ReadOptions& options) {
  const auto add = [this](const char* name, std::vector<std::string>& target, const char* description) {
    const auto set = [&target, name](const std::string& text) {
      target = split_at_commas(text);
      for (const std::string& column : target)
        if (column.empty())
          throw CLI::ValidationError(
              name, fmt::format("'{}' contains an empty name of a column. Write one comma between two names", text));
    };
    described(parser_->add_option_function<std::string>(name, set, description), "A,B,...");
  };
  add("--inputs", options.inputs, "Input columns of a .csv (default: names beginning with u)");
  add("--outputs", options.outputs, "Output columns of a .csv (default: names beginning with y)");
}

void Command::horizon(Index& target) {
  number<Index>("--horizon", target, "H", "Steps ahead that outputs are predicted (default 1)", 1, 1'000'000);
}

void Command::threads(int& target) {
  number("--threads", target, "N", "Threads, 0 for all of the machine (default 1)", 0, 1024);
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
