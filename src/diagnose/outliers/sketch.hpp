// Regressions at some places of a record, by which experiments are judged that had no part in them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "diagnose/outliers.hpp"

namespace tokid {

// Multiples of the usual residuals: less than this is of no consequence.
inline constexpr double of_consequence = 3.0;

// Of experiments, those that tell who is right, and the steps that share a regression at most.
Index fewest_experiments(const OutlierOptions& options);
Index most_together(const OutlierOptions& options);
// Places that there have to be, regressors at most, and rows for each of them.
inline constexpr Index fewest_places = 4, most_regressors = 40;
inline constexpr double rows_each = 3.0;

// The mean without the largest quarter: what is wrong with few samples is not wrong with the experiment.
double trimmed_mean(std::vector<double> sizes);

class Sketch {
 public:
  // So many lags, at so many successive steps of a place.
  struct Layout {
    Index lags = 1, together = 1;
  };
  enum class Places { all, even, odd };

  Sketch(const Ensemble& ensemble, const OutlierOptions& options, const Layout& layout);

  bool usable() const { return Index(places_.size()) >= fewest_places; }

  // The models of all but `out`, (N) of 0 and 1, and the residuals of everyone.
  void judge(const std::vector<char>& out);

  // Geometric mean over the places of the usual residual over the size of the outputs.
  double error() const;
  // (m) the usual size of residuals.
  Vector usual_residual() const;

  bool judged(Index n) const;
  // The size of the residuals of experiment n over the usual one, as shares of what they scatter by, or plainly.
  double ratio(Index n) const { return score_[size_t(n)] / typical_; }
  double plain_ratio(Index n) const { return plain_[size_t(n)] / typical_plain_; }
  double threshold(Index n) const;
  // The output that has nearly all of it, if there is one.
  std::optional<Index> output(Index n) const;

  // The size of the residuals that the samples x (T·d) of an experiment would have at some of the places, over the
  // usual ones; NaN for none.
  double ratio_of(const Eigen::RowVectorXd& x, Places at = Places::all) const;
  // The same of their shares of the outputs: samples that are shrunk have small residuals of any model.
  double share_of(const Eigen::RowVectorXd& x) const;
  // a that makes the residuals of x + a·z smallest, as their squares over the usual ones have it; NaN for none.
  double best_share(const Eigen::RowVectorXd& x, const Eigen::RowVectorXd& z) const;

 private:
  // The rows [W Y] of one place, those of an experiment one below the other.
  struct Place {
    Index begin = 0;               // first step
    Matrix w, y;                   // scaled by weights
    std::vector<Index> owner;      // of each row
    Vector weight;                 // of each row
    Vector scale;                  // of the columns of w: medians of their sizes
    bool empty = false;            // no others are here: nothing is said of anyone
    Matrix coefficients, inverse;  // of the model of the others: x, R⁻¹
    Matrix residual, deviation;    // leave-one-out ones, unweighted, and what they scatter by in units of the noise
    Vector median, plain_median;   // (m) of their sizes over the others
    Vector size;                   // (m) median of the outputs' over the others
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
  double typical_ = 1.0, typical_plain_ = 1.0, variance_ = 0.0, quantile_ = 0.0, usual_count_ = 1.0;
};

}  // namespace tokid
