// What the plots of a report draw, thinned out to a bounded size.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "report/evidence.hpp"

namespace tokid::report {

// Curves of `steps` samples on a grid that all of them share: as they are where they are few enough, else two points
// for every stretch of `stretch` steps, its least and largest value in the order in which they come. No peak is lost;
// it moves by less than a stretch.
struct Grid {
  Index begin = 0, steps = 0, stretch = 1;
  std::vector<Index> x;  // steps k of the points

  std::vector<double> thin(const std::vector<double>& values) const;  // NaN where a stretch has no value
};
Grid make_grid(Index begin, Index steps, Index points);

// Eigenvalues of A_k and of A_k + G_k C_k need coordinates; these are those of the plots.
struct Framed {
  Model model;
  std::string name;          // "reference", "smooth"
  Index begin = 0, end = 0;  // A_k in the frame: begin ≤ k < end
  Index reference_step = -1;
};
Framed pole_frame(const Model& model);

// Rows of the ensemble that are plotted: the best, the median and the worst, and others spread evenly; with labels.
struct Shown {
  std::vector<Index> rows;
  std::vector<std::string> labels;
  size_t first = 0;  // that the page begins with: the median
};
Shown shown_experiments(const Evidence& found, Index most);

// The largest magnitudes of the eigenvalues of A_k and of A_k + G_k C_k.
struct Radius {
  Index k = 0;
  double open = 0.0, closed = 0.0;
};

struct Plots {
  std::string json;
  std::vector<std::string> omitted;  // what the page does not show, in words
  Framed frame;
  std::vector<Radius> radius;  // where they are finite, of steps in the frame with as many states before as after them
};
Plots plot_data(const Model& model, const Ensemble& data, const Evidence& found, const ReportOptions& options);

}  // namespace tokid::report
