// SPDX-License-Identifier: BSD-3-Clause
#include "words.hpp"

#include <regex>
#include <string>
#include <utility>
#include <vector>

namespace tokid::python {

namespace {

struct Wording {
  std::regex tool;
  const char* python;
};

// Words of the tool between blanks or in brackets. They are not part of the name of a file or a column, such as
// 'run--lags.csv'.
std::regex of_tool(const std::string& words) { return std::regex("(^|[ (])" + words + "(?![\\w/-]|\\.\\w)"); }

// The options of the tool that messages of the library name, longer phrases first. $1 is what stands before them.
const std::vector<Wording>& wordings() {
  static const std::vector<Wording> table{
      {of_tool("--inputs 'A,B' --outputs 'C,D'"), "$1inputs=['A', 'B'], outputs=['C', 'D']"},
      {of_tool("--no-feedthrough"), "$1feedthrough=False"},
      {of_tool("--feedthrough"), "$1feedthrough=True"},
      {of_tool("--time-invariant"), "$1period='invariant'"},
      {of_tool("--period P"), "$1period=P"},
      {of_tool("--weighting one-step or many-steps"), "$1weighting='one-step' or 'many-steps'"},
      {of_tool("--method ([a-z]+)"), "$1method='$2'"},
      {of_tool("(call|identify) with --block all"), "$1call tokid.identify"},
      {of_tool("(tokid )?identify --state"), "$1tokid.identify(keep_state=True)"},
      {of_tool("tokid update reads state files"), "$1tokid.UpdateState.load reads state files"},
      {of_tool("--(experiments|lags)"), "$1$2"},
      {std::regex("tokid import ('[^']*') data\\.npz$"), "tokid.read($1)"},
  };
  return table;
}

}  // namespace

std::string in_python(std::string text) {
  if (text.find("--") == std::string::npos && text.find("tokid import") == std::string::npos) return text;
  for (const Wording& wording : wordings()) text = std::regex_replace(text, wording.tool, wording.python);
  return text;
}

std::vector<std::string> in_python(std::vector<std::string> texts) {
  for (std::string& text : texts) text = in_python(std::move(text));
  return texts;
}

}  // namespace tokid::python
