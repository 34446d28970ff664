// SPDX-License-Identifier: BSD-3-Clause
#include "report/paper_figures.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace tokid::report {

namespace {

// A curve with the values y at the times x = k·dt, for k = begin, begin + 1, …
Series history(std::string name, const Vector& y, Index begin, double dt, int colour, Mark mark = Mark::line) {
  Series s{std::move(name), {}, {y.begin(), y.end()}, mark, colour};
  for (Index k = 0; k < y.size(); ++k) s.x.push_back(double(begin + k) * dt);
  return s;
}

const Axis time_axis{"time [s]"};

double largest(const Matrix& a) {
  double value = 0;
  for (const double entry : a.reshaped())
    if (std::isfinite(entry)) value = std::max(value, std::abs(entry));
  return value;
}

// The first step from which on every product of p closed-loop matrices is zero. The windows of earlier steps extend
// back to the start from rest, where the state is zero. Their data therefore do not determine the gain.
Index first_deadbeat(const Paper& paper) {
  constexpr double rounding = 1e-9;  // relative to closed-loop matrices with a norm of about ten
  size_t first = paper.products.size();
  while (first > 0 && paper.products[first - 1] < rounding) --first;
  return paper.framed.begin + static_cast<Index>(first);
}

Figure poles(const Paper& paper) {
  const Index begin = first_deadbeat(paper);
  Series open{"open loop A′", {}, {}, Mark::dot, 1}, closed{"closed loop A′ + G′C′", {}, {}, Mark::ring, 0};
  double least_open = std::numeric_limits<double>::infinity(), most_open = 0, most_closed = 0, most_zero = 0;
  const auto add = [](const std::vector<std::complex<double>>& values, Series& series) {
    for (const auto value : values) {
      series.x.push_back(value.real());
      series.y.push_back(value.imag());
    }
  };
  for (size_t i = size_t(begin - paper.framed.begin); i < paper.open.size(); ++i) {
    add(paper.open[i], open);
    add(paper.closed[i], closed);
    least_open = std::min(least_open, std::abs(paper.open[i].back()));
    most_open = std::max(most_open, std::abs(paper.open[i].front()));
    most_closed = std::max(most_closed, std::abs(paper.closed[i][0]));
    most_zero = std::max(most_zero, std::abs(paper.closed[i][2]));
  }
  return {"figure-1",
          "Case 1: poles of the plant and of the observer",
          fmt::format(
              "Eigenvalues of A′ and of A′ + G′C′ at the steps k = {} … {}, in the reference frame of step 0, with "
              "the unit circle. The plant's poles have moduli from {:.2f} to {:.2f}. Of the observer's four, two "
              "are zero at every step (at most {:.0e}); the other two move along the real axis, up to {:.2f} in "
              "modulus, and yet every error vanishes after p = {} steps: poles of single steps do not determine the "
              "stability of "
              "a time varying system.",
              begin, paper.framed.end - 2, least_open, most_open, most_zero, most_closed, paper.lags),
          {{{"real part"}, {"imaginary part"}, {std::move(open), std::move(closed)}, true}}};
}

Figure markov_error(const Paper& paper, const PaperCase& one, int number) {
  const double dt = paper.system.dt;
  // The figures of both cases have the same range of the axis.
  double least = std::numeric_limits<double>::infinity(), most = 0;
  for (const PaperCase* either : {&paper.minimum, &paper.more})
    for (const Vector* errors : {&either->direct_error, &either->recursive_error})
      for (const double value : *errors)
        if (value > 0) least = std::min(least, value), most = std::max(most, value);
  return {fmt::format("figure-{}", number),
          fmt::format("Case {}: error of the system Markov parameters, N = {}", number - 1, one.experiments),
          fmt::format(
              "Largest Frobenius norm of the error of h(k, k-γ) at each step. Up to γ = p = {} steps, the parameters "
              "follow from the regression of the step and its neighbours ({:.1e} at most); beyond, they come "
              "by recursion over the steps, and their errors add up ({:.1e} at most). Without noise "
              "these are rounding errors times the condition of the windows, here up to {:.2g}: {}.",
              paper.lags, largest(one.direct_error), largest(one.recursive_error), one.condition_max,
              number == 2 ? "as many experiments as unknowns just suffice"
                          : "more experiments than the minimum are better conditioned, and more exact"),
          {{time_axis,
            {"error", true, {{least, most}}},
            {history(fmt::format("direct, γ ≤ {}", paper.lags), one.direct_error, 0, dt, 0),
             history(fmt::format("by recursion, γ > {}", paper.lags), one.recursive_error, 0, dt, 1)}}}};
}

Figure output_error(const Paper& paper, const PaperCase& one, int number) {
  Panel panel{time_axis, {"output error"}, {}};
  for (Index j = 0; j < one.output_error.cols(); ++j)
    panel.series.push_back(
        history(fmt::format("output {}", j + 1), one.output_error.col(j), 0, paper.system.dt, int(j)));
  return {
      fmt::format("figure-{}", number),
      fmt::format("Case {}: output error for test inputs, N = {}", number - 3, one.experiments),
      fmt::format(
          "Response of the identified system minus that of the true system to u₁ = sin 3t and u₂ = cos 7t, which no "
          "experiment contained. At most {:.1e}: an output is a sum over many Markov parameters, whose errors reach "
          "{:.1e} each.",
          largest(one.output_error), std::max(largest(one.direct_error), largest(one.recursive_error))),
      {std::move(panel)}};
}

Figure state_error(const Paper& paper) {
  const double dt = paper.system.dt;
  const Index begin = paper.framed.begin;
  Panel components{time_axis, {"state error"}, {}}, norms{time_axis, {"norm of the state error", true}, {}};
  for (Index i = 0; i < paper.open_error.rows(); ++i)
    components.series.push_back(
        history(fmt::format("x′{} open loop", i + 1), paper.open_error.row(i), begin, dt, int(i)));
  for (Index i = 0; i < paper.closed_error.rows(); ++i)
    components.series.push_back(
        history(i == 0 ? "all, observer" : "", paper.closed_error.row(i), begin, dt, 7, Mark::dashed));
  // Smaller values are far below the rounding errors. They are drawn at this level.
  constexpr double floor = 1e-18;
  const Index deadbeat = first_deadbeat(paper), gone = std::min(deadbeat + paper.lags, paper.framed.end - 1);
  norms.series = {history("open loop", paper.open_error.colwise().norm(), begin, dt, 0),
                  history("observer", paper.closed_error.colwise().norm().cwiseMax(floor), begin, dt, 7, Mark::dashed)};
  return {
      "figure-6",
      "Case 1: state error from an initial condition",
      fmt::format(
          "The same initial error in the plant alone and with the observer in the loop. The windows of the first "
          "{} steps reach back to the start from rest, and do not determine their gains; p = {} steps later, at "
          "step {}, the error is gone but for rounding ({:.0e} of its initial norm), while the error of the open loop "
          "goes on. Norms below {:.0e} are drawn as that.",
          deadbeat - begin, paper.lags, gone,
          paper.closed_error.col(gone - begin).norm() / paper.closed_error.col(0).norm(), floor),
      {std::move(components), std::move(norms)}};
}

Figure gains(const Paper& paper) {
  const Model& model = paper.framed.model;
  const Index begin = paper.framed.begin, count = paper.framed.end - 1 - begin;
  Panel panel{time_axis, {"gain"}, {}};
  for (Index j = 0; j < model.outputs; ++j)
    for (Index i = 0; i < model.n(begin); ++i) {
      Vector y(count);
      for (Index k = 0; k < count; ++k) y(k) = model.at(begin + k).G()(i, j);
      panel.series.push_back(history(fmt::format("G′{}{}", i + 1, j + 1), y, begin, model.dt, int(i),
                                     j % 2 == 0 ? Mark::line : Mark::dashed));
    }
  return {"figure-7",
          "Case 1: gain history",
          "Entries of the observer gain G′ (row: state, column: output) in the reference frame of step 0, where the "
          "state of every step is measured by the same combination of the outputs that follow it. They repeat with "
          "the plant's stiffness, every 0.63 s, but for the first steps, whose gains the data do not determine.",
          {std::move(panel)}};
}

// One curve for each number of experiments, over the lag orders. `less` is subtracted from the values.
Panel over_lags(const KalmanStudy& study, const char* label, double KalmanStudyCell::*field, double less) {
  Panel panel{{"lag order p"}, {label, true}, {}};
  for (const Index count : study.options.experiments) {
    Series s{experiments_name(count), {}, {}, count > 0 ? Mark::line : Mark::dashed, int(panel.series.size())};
    for (const KalmanStudyCell& cell : study.cells)
      if (cell.experiments == count) {
        s.x.push_back(double(cell.lags));
        s.y.push_back(cell.*field - less);
      }
    panel.series.push_back(std::move(s));
  }
  return panel;
}

Figure kalman_error(const KalmanStudy& study) {
  return {
      "kalman-error",
      "Prediction error in excess of the Kalman filter's",
      "Root mean square one-step error of the identified observer on fresh experiments, over that of the Kalman "
      "filter of the true system, less one. A short window does not use older samples, which contain information; "
      "a long window has more "
      "unknowns, which few experiments determine less accurately. With enough experiments, every further lag helps.",
      {over_lags(study, "excess error", &KalmanStudyCell::error, 1.0)}};
}

Figure kalman_gain(const KalmanStudy& study) {
  return {"kalman-gain",
          "The gain tends to that of the Kalman filter",
          "Root mean square over the steps of ‖G + A K‖ over that of ‖A K‖, with the identified gain G in the "
          "coordinates of the true system and the Kalman gain K of the true system. The deadbeat gain of p = 2 is far "
          "from it. The difference falls with p, at a rate that the memory of the Kalman filter sets; with few "
          "experiments, noise limits the fall.",
          {over_lags(study, "difference of the gains", &KalmanStudyCell::gain, 0.0)}};
}

}  // namespace

const char* to_string(Mark mark) {
  static constexpr const char* names[] = {"line", "dashed", "dot", "ring"};
  return names[static_cast<size_t>(mark)];
}

std::string experiments_name(Index experiments) {
  return experiments > 0 ? fmt::format("N = {}", experiments) : "N → ∞";
}

std::vector<Figure> paper_figures(const Paper& paper, const KalmanStudy& study) {
  return {poles(paper),
          markov_error(paper, paper.minimum, 2),
          markov_error(paper, paper.more, 3),
          output_error(paper, paper.minimum, 4),
          output_error(paper, paper.more, 5),
          state_error(paper),
          gains(paper),
          kalman_error(study),
          kalman_gain(study)};
}

}  // namespace tokid::report
