// The texts of the C code.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "deploy/tables.hpp"

namespace tokid::c_code {

// What the code needs besides the observer.
struct Features {
  bool nominal;     // departures from a nominal trajectory
  bool estimates;   // innovations of missing outputs from those of the others
  bool begins;      // steps before the model begins
  bool period;      // the model goes on after its last step
  bool start;       // a state at the first step that is not zero
  bool controller;  // NAME_control()
  bool held;        // the law uses the last input
  bool feedforward;
  bool control_later;  // the controller begins after step 0
};

std::string law_comment(bool feedforward, bool held);
std::string header_text(const Words& words, const Features& has);
std::string source_text(const Words& words, const Features& has);

}  // namespace tokid::c_code
