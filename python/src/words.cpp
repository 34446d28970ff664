// SPDX-License-Identifier: BSD-3-Clause
#include "words.hpp"

#include <array>
#include <regex>
#include <utility>

namespace tokid::python {

namespace {

struct Wording {
  std::regex tool;
  const char* python;
};

// The options of the tool that messages of the library name, longer phrases first.
const std::array<Wording, 12>& wordings() {
  static const std::array<Wording, 12> table{{
      {std::regex("--inputs 'A,B' --outputs 'C,D'"), "inputs=['A', 'B'], outputs=['C', 'D']"},
      {std::regex("--missing ('[^']*')"), "missing=$1"},
      {std::regex("--no-feedthrough"), "feedthrough=False"},
      {std::regex("--feedthrough"), "feedthrough=True"},
      {std::regex("--time-invariant"), "period='invariant'"},
      {std::regex("--period P"), "period=P"},
      {std::regex("--weighting one-step or many-steps"), "weighting='one-step' or 'many-steps'"},
      {std::regex("--(method|dates) ([a-z]+(-first)?)"), "$1='$2'"},
      {std::regex("(call|identify) with --block all"), "call tokid.identify"},
      {std::regex("(tokid )?identify --state"), "tokid.identify(keep_state=True)"},
      {std::regex("(tokid )?identify --resume"), "tokid.identify_file(resume=True)"},
      {std::regex("--(experiments|lags|trigger)"), "$1"},
  }};
  return table;
}

}  // namespace

std::string in_python(std::string text) {
  if (text.find("--") == std::string::npos) return text;
  for (const Wording& wording : wordings()) text = std::regex_replace(text, wording.tool, wording.python);
  return text;
}

std::vector<std::string> in_python(std::vector<std::string> texts) {
  for (std::string& text : texts) text = in_python(std::move(text));
  return texts;
}

}  // namespace tokid::python
