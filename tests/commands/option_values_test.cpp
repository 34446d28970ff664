// Each option of each command of the tool, with values that mean something and with values that mean nothing.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cctype>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "tool.hpp"

namespace tokid::app {
namespace {

using Words = std::set<std::string>;

// Each text is tried with each option.
const Words tried = {"0",      "1",    "5",    "0.5", "1e3", "-1", "-0.5", "0,5",      "abc",  "1e400",
                     "-1e400", "5s",   "0x10", "+5",  " 5",  "5 ", "nan",  "inf",      "-inf", "1;5",
                     "1:",     "true", "NaN",  "١",   "5.",  "1e", "--",   "infinity", "auto", "none"};

const Words whole = {"0", "1", "5"}, count = {"1", "5"}, choice = {};
const Words positive = {"0.5", "1", "5", "5.", "1e3"};

Words with(Words words, const Words& more) {
  words.insert(more.begin(), more.end());
  return words;
}

Words without(Words words, const Words& less) {
  for (const std::string& word : less) words.erase(word);
  return words;
}

const Words real = with(positive, {"0"});

// By the name of the type in the help, and by the name of the option where options of one type differ. A choice of
// words accepts none of the texts but its words.
const std::map<std::string, Words> meaningful = {
    {"--end", count},
    {"--level", {"0.5"}},
    {"--wait", real},
    {"--cross-validate", {"5"}},
    {"confidence --seed", count},
    {"modes --seed", count},
    {"--period", {"1", "5"}},
    {"identify --period", whole},
    {"--threads", whole},
    {"identify --reference-step", with(whole, {"auto"})},
    {"1[,H...]", {"1"}},
    {"A,...", positive},
    {"B", {"5"}},
    {"FRACTION", {"0", "0.5"}},
    {"H", count},
    {"K", whole},
    {"D[,D...]|none|auto", with(whole, {"0,5", " 5", "5 ", "none", "auto"})},
    {"K,...", with(whole, {"0,5"})},
    {"K[,K...]|none|auto", with(count, {" 5", "5 ", "none", "auto"})},
    {"L|auto", with(real, {"infinity", "auto", "inf"})},
    {"LAMBDA|auto", with(real, {"infinity", "auto"})},
    {"N", count},
    {"N|auto", with(count, {"auto"})},
    {"NF", whole},
    {"ROW", whole},
    {"S", whole},
    {"s", whole},
    {"SD", real},
    {"SD:SD", {}},
    {"SECONDS", positive},
    {"STEP", whole},
    {"STEPS", count},
    {"STEPS|auto|all", with(count, {"auto"})},
    {"T", count},
    {"U,...", with(real, {"-1", "-0.5", "0,5"})},
    {"V", real},
    {"W,...", with(real, {"0,5"})},
    {"W,W[,W...]|equal", with(positive, {"0,5", " 5", "5 "})},
    {"m", count},
    {"n", count},
    {"r", count},
};
// A number is probably meant for --states.
const Words state_files = without(tried, real);
// Any other text may be a name.
const Words names = {"A,B,...", "CONDITION", "DIR", "FILE", "FILE ...", "NAME", "WORD,..."};

const Words& accepted_by(const std::string& command, const std::string& option, const std::string& type) {
  for (const std::string& key : {command + ' ' + option, option, type})
    if (const auto found = meaningful.find(key); found != meaningful.end()) return found->second;
  if (command + ' ' + option == "identify --state") return state_files;
  if (names.contains(type)) return tried;
  const bool words =
      std::all_of(type.begin(), type.end(), [](char c) { return std::islower(c) || c == '|' || c == '-'; });
  EXPECT_TRUE(words && type.find('|') != std::string::npos) << command << ' ' << option << ": unknown type " << type;
  return choice;
}

class OptionValues : public testing::Test {
 protected:
  OptionValues() {
    add_commands(tool_);
    tool_.parse_complete_callback([] { throw Parsed{}; });  // no command runs
  }

  // The parser reports a value that an option refuses before it reports that arguments are missing.
  bool accepts(std::vector<std::string> words, const std::string& name, const std::string& value) {
    std::reverse(words.begin(), words.end());  // as CLI11 needs them
    try {
      tool_.parse(std::move(words));
    } catch (const Parsed&) {
    } catch (const CLI::ParseError& error) {
      return !std::string(error.what()).starts_with(name + ": '" + value + "' found");
    }
    return true;
  }

  template <class Work>
  void for_each_option(bool positional, const Work& work) {
    for (const CLI::App* command : tool_.get_subcommands({}))
      for (const CLI::Option* option : command->get_options())
        if (option->get_positional() == positional && option->get_items_expected_max() > 0)
          work(command->get_name(), option->get_name(), option->get_type_name());
  }

 private:
  struct Parsed {};
  CLI::App tool_;
};

TEST_F(OptionValues, AreAcceptedOnlyWhereTheyMeanSomething) {
  int options = 0;
  for_each_option(false, [&](const std::string& command, const std::string& name, const std::string& type) {
    ++options;
    const Words& meant = accepted_by(command, name, type);
    for (const std::string& value : tried) {
      const bool word = ('|' + type + '|').find('|' + value + '|') != std::string::npos;
      EXPECT_EQ(accepts({command, name + '=' + value}, name, value), meant.contains(value) || word)
          << command << ' ' << name << "='" << value << "' (" << type << ')';
    }
    EXPECT_FALSE(accepts({command, name, ""}, name, "")) << command << ' ' << name;
  });
  EXPECT_GT(options, 120);
}

TEST_F(OptionValues, OfArgumentsAreNotEmpty) {
  std::map<std::string, std::vector<std::string>> before;
  for_each_option(true, [&](const std::string& command, const std::string& name, const std::string&) {
    std::vector<std::string>& words = before.try_emplace(command, std::vector<std::string>{command}).first->second;
    words.emplace_back();
    EXPECT_FALSE(accepts(words, name, "")) << command << ' ' << name;
    words.back() = "oscillator";
  });
  EXPECT_GE(before.size(), 15);
}

}  // namespace
}  // namespace tokid::app
