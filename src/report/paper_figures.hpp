// The data of the paper's seven figures and of two figures of the Kalman study. src/report/assets/paper.js draws them.
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
  std::string name;          // in the legend; empty: not in the legend
  std::vector<double> x, y;  // of the same size; NaN interrupts the curve
  Mark mark = Mark::line;
  int colour = 0;  // 0 … 7, a palette that colour-blind readers can distinguish, too
};

struct Axis {
  std::string label;
  bool log = false;                                 // logarithmic; values that are not positive are not drawn
  std::optional<std::array<double, 2>> range = {};  // least and largest value; empty: those of the data
};

// One pair of axes.
struct Panel {
  Axis x, y;  // the axis x is linear and has the range of the data
  std::vector<Series> series;
  bool complex_plane = false;  // draws points and the unit circle; both axes have the same scale
};

struct Figure {
  std::string id;             // id of the HTML element: letters, digits, hyphens
  std::string title;          // the subject of the figure
  std::string caption;        // what the figure shows, and how it was computed
  std::vector<Panel> panels;  // one below the other
};

// figure-1 … figure-7, kalman-error, kalman-gain
std::vector<Figure> paper_figures(const Paper& paper, const KalmanStudy& study);
std::string experiments_name(Index experiments);  // "N = 50", "N → ∞"

}  // namespace tokid::report
