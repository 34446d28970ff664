// Regressions at some places of a record. They evaluate each experiment by a fit without this experiment.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "diagnose/outliers.hpp"

namespace tokid {

// An outlier has residuals of at least this multiple of the median over the experiments.
inline constexpr double of_consequence = 3.0;

// Most steps that share a regression.
Index most_together(const OutlierOptions& options);
// Least number of places, most regressors, and rows for each regressor.
inline constexpr Index fewest_places = 4, most_regressors = 40;
inline constexpr double rows_each = 3.0;

// The mean without the largest quarter: a few wrong samples do not make an experiment wrong.
double trimmed_mean(std::vector<double> sizes);

// The scatter of healthy experiments: the variance of the logarithms of their sizes, and the number of standard
// deviations that one of `tests` sizes exceeds in one ensemble of a thousand. `deviations`: sizes of the logarithms,
// relative to their median. `quantile` is that of Student's t.
struct LogScatter {
  double variance = 0.0, quantile = 0.0;
};
LogScatter log_scatter(std::vector<double> deviations, double tests);
// Variance of the logarithm of the mean size of `count` residuals, beyond that of `usual` residuals.
double variance_of_few(double count, double usual);

class Sketch {
 public:
  // Number of lags, and of successive steps at each place.
  struct Layout {
    Index lags = 1, together = 1;
  };
  enum class Places { all, even, odd };

  Sketch(const Ensemble& ensemble, const OutlierOptions& options, const Layout& layout);

  bool usable() const { return Index(places_.size()) >= fewest_places; }

  // Fits the models to all experiments except those with 1 in `out` (N). Computes the residuals of all experiments.
  void evaluate(const std::vector<char>& out);

  // Geometric mean, over places and outputs, of the median residual divided by the root mean square of the output.
  double error() const;
  // (m) median size of the residuals.
  Vector usual_residual() const;

  bool is_evaluated(Index n) const;
  // The size of the residuals of experiment n, divided by the median over the experiments. `ratio` divides residuals by
  // their expected scatter before, `plain_ratio` does not.
  double ratio(Index n) const { return score_[size_t(n)] / typical_; }
  double plain_ratio(Index n) const { return plain_[size_t(n)] / typical_plain_; }
  double threshold(Index n) const;
  // The output that has nearly all of the residual, if there is one.
  std::optional<Index> output(Index n) const;

  // The ratio() that samples x (T·d) would have at these places; NaN if too few residuals can be computed.
  double ratio_of(const Eigen::RowVectorXd& x, Places at = Places::all) const;
  // The same for residuals divided by the outputs, because samples of small amplitude have small residuals with any
  // model. The largest ratio of all outputs.
  double share_of(const Eigen::RowVectorXd& x) const;
  // The factor a that minimises the squared residuals of samples x + a·z, in units of the median residuals; NaN if
  // there is none.
  double best_share(const Eigen::RowVectorXd& x, const Eigen::RowVectorXd& z) const;

 private:
  // The rows [W Y] of one place. The rows of one experiment are adjacent.
  struct Place {
    Index begin = 0;               // first step
    Matrix w, y;                   // scaled by weights
    std::vector<Index> owner;      // of each row
    Vector weight;                 // of each row
    Vector scale;                  // of the columns of w: medians of their sizes
    bool empty = false;            // no experiment here can be used for the fit, so this place is not used
    Matrix coefficients, inverse;  // of the fitted model: coefficients, inverse of the triangular factor R
    Matrix residual, deviation;    // leave-one-out residuals, unweighted; their expected scatter in units of the noise
    Vector median, plain_median;   // (m) medians of the sizes over the experiments not in `out`
    Vector size;                   // (m) median size of the outputs of these experiments
  };

  double allowance(const ConstMatrixRef& row) const;
  Index regressors() const;
  std::vector<Index> begins() const;
  bool fill(Place& p) const;
  void regress(Place& p, const std::vector<char>& out) const;
  template <class Use>
  void for_each_row(const Eigen::RowVectorXd& x, Places at, Use&& use) const;

  const Ensemble& e_;
  const OutlierOptions& o_;
  Layout layout_;
  std::vector<Place> places_;
  std::vector<double> score_, plain_;
  std::vector<Index> count_;
  Matrix share_;
  double typical_ = 1.0, typical_plain_ = 1.0, usual_count_ = 1.0;
  LogScatter scatter_;
};

}  // namespace tokid
