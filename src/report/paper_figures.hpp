// The paper's seven figures and two of the Kalman study, as data. src/report/assets/paper.js draws them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "tokid/paper.hpp"

namespace tokid::report {

enum class Mark { line, dashed, dot, ring };
const char* to_string(Mark mark);  // "line", …

struct Series {
  std::string name;          // in the legend; empty: not listed
  std::vector<double> x, y;  // same number; NaN leaves a gap
  Mark mark = Mark::line;
  int colour = 0;  // 0 … 7, distinct for readers of any colour vision
};

struct Axis {
  std::string label;
  bool log = false;                                 // values that are not positive are not drawn
  std::optional<std::array<double, 2>> range = {};  // least and largest value, to compare figures; else of the data
};

// One pair of axes.
struct Panel {
  Axis x, y;  // x is linear and has the range of the data
  std::vector<Series> series;
  bool complex_plane = false;  // points, with both axes to the same scale, and the unit circle
};

struct Figure {
  std::string id;             // of the element: letters, digits, hyphens
  std::string title;          // its subject
  std::string caption;        // its content, and how it was made
  std::vector<Panel> panels;  // one below the other
};

// figure-1 … figure-7, kalman-error, kalman-gain
std::vector<Figure> paper_figures(const Paper& paper, const KalmanStudy& study);
std::string experiments_name(Index experiments);  // "N = 50", "N → ∞"

}  // namespace tokid::report
