// The data of the plots of a report, reduced to a bounded size.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "report/evidence.hpp"

namespace tokid::report {

// Curves of `steps` samples on a common grid. Curves of few samples stay as they are. Otherwise every stretch of
// `stretch` steps has two points, its least and its largest value, in their order. No peak is lost; it moves by less
// than a stretch.
struct Grid {
  Index begin = 0, steps = 0, stretch = 1;
  std::vector<Index> x;  // steps k of the points

  std::vector<double> thin(const std::vector<double>& values) const;  // NaN if a stretch has no value
};
Grid make_grid(Index begin, Index steps, Index points);

// Eigenvalues of A_k and of A_k + G_k C_k need coordinates. This is the frame of the plots.
struct Framed {
  Model model;
  std::string name;          // "reference", "smooth"
  Index begin = 0, end = 0;  // A_k in the frame: begin ≤ k < end
  Index reference_step = -1;
};
Framed pole_frame(const Model& model);

// The plotted rows of the ensemble, with labels: the best, the median and the worst, and others spread evenly.
struct Shown {
  std::vector<Index> rows;
  std::vector<std::string> labels;
  size_t first = 0;  // index of the row that the page shows first: the median
};
Shown shown_experiments(const Evidence& found, Index most);

// The largest magnitudes of the eigenvalues of A_k and of A_k + G_k C_k.
struct Radius {
  Index k = 0;
  double open = 0.0, closed = 0.0;
};

struct Plots {
  std::string json;
  std::vector<std::string> omitted;  // parts that the page does not show, in words
  Framed frame;
  std::vector<Radius> radius;  // if finite, of steps in the frame with as many states before as after
};
Plots plot_data(const Model& model, const Ensemble& data, const Evidence& found, const ReportOptions& options);

}  // namespace tokid::report
