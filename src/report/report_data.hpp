// The data of the plots of a report, reduced to a limited size.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "report/evidence.hpp"
#include "report/model_comparison.hpp"
#include "report/responses.hpp"

namespace tokid::report {

// A common grid for curves of `steps` samples. If the samples are few, the curve has all of them. Otherwise each
// stretch of `stretch` steps gets two points: its least and its largest value, in their order in time. So no peak is
// lost, but a peak can move by less than a stretch.
struct Grid {
  Index begin = 0, steps = 0, stretch = 1;
  std::vector<Index> x;  // steps k of the points

  std::vector<double> thin(const std::vector<double>& values) const;  // NaN if a stretch has no value
};
Grid make_grid(Index begin, Index steps, Index points);

// The model in the frame (coordinates) of the plots, because the eigenvalues of A_k and of A_k + G_k C_k depend on the
// coordinates.
struct Framed {
  Model model;
  std::string name;          // "reference", "smooth"
  Index begin = 0, end = 0;  // A_k is in this frame for begin ≤ k < end
  Index reference_step = -1;
};
Framed pole_frame(const Model& model);

// (N) the number of outlying samples of each tested experiment
std::vector<Index> outlying_samples(const Evidence& found);

// The rows of the ensemble that are plotted, and their labels. They have the smallest, median and largest error; other
// rows are spread evenly.
struct Shown {
  std::vector<Index> rows;
  std::vector<std::string> labels;
  size_t first = 0;  // index in `rows` of the row that the page shows first: the one with the median error
};
Shown shown_experiments(const Evidence& found, Index most);

// The largest magnitudes of the eigenvalues of A_k and of A_k + G_k C_k.
struct Radius {
  Index k = 0;
  double open = 0.0, closed = 0.0;
};

// The plots show at most as many other models of a comparison. The tables have all of them.
inline constexpr Index most_compared_models = 8;

struct Plots {
  std::string json;
  std::vector<std::string> omitted;  // sentences on what the page does not show
  Framed frame;
  std::optional<Modes> modes;  // modes_of_page()
  FrozenResponses frozen;
  std::vector<Radius> radius;  // if finite: of the steps in the frame with as many states before as after
};
Plots plot_data(const Model& model, const Ensemble& data, const Evidence& found, const Verdict& verdict,
                const ModelComparison& comparison, const ReportOptions& options);

}  // namespace tokid::report
