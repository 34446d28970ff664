// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/gtv_arx.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

#include "base/large_pages.hpp"
#include "data/check.hpp"
#include "linalg/lane_regression.hpp"
#include "linalg/orthonormal.hpp"
#include "linalg/row_absorption.hpp"

namespace tokid {

void GtvArx::resize(Index T, Index r, Index m, Index lags_max, bool noise_shape, Index experiments, Index period) {
  inputs = r;
  outputs = m;
  k_begin = 0;
  step.assign(size_t(T), GtvArxStep{});
  slot_ = lags_max * (r + m) + r;
  shape_rows_ = noise_shape ? slot_ : 0;
  const bool shared = period > 0 && lags_max + period < T;
  single_ = shared ? lags_max : T;
  period_ = shared ? period : 0;
  const Index slots = single_ + period_;
  coefficients_.resize(m, slots * slot_);
  noise_shape_.resize(shape_rows_, T * shape_rows_);
  for (const Matrix* a : {&coefficients_, &noise_shape_})
    prefer_large_pages(a->data(), size_t(a->size()) * sizeof(double));
  if (!feedthrough) coefficients_.setZero();
  residual_cov_.setZero(m, slots * m);
  output_rms_.setZero(m, slots);
  leverages_.setZero(experiments, T);
}

void GtvArx::forget_noise_shapes() {
  noise_shape_.resize(0, 0);
  shape_rows_ = 0;
}

void GtvArx::begin_at(Index k) {
  k_begin = k = std::clamp(k, k_begin, steps());
  std::fill_n(step.begin(), k, GtvArxStep{});
  const Index own = std::min(k, single_);  // slots that no later step shares
  coefficients_.leftCols(own * slot_).setZero();
  residual_cov_.leftCols(own * outputs).setZero();
  output_rms_.leftCols(own).setZero();
}

void GtvArx::require_noise_shape() const {
  if (!has_noise_shape())
    throw std::invalid_argument(
        "noise_shape: not found, but variances need it. Use the option noise_shape of the regressions");
}

namespace {

// The leverages: the diagonal of W W⁺. W has scaled columns.
Vector leverages(const Matrix& w, Index rank) {
  if (rank >= w.rows()) return Vector::Ones(w.rows());
  if (rank == w.cols()) return linalg::orthonormal_factor(w).rowwise().squaredNorm();
  return linalg::svd(w).u.leftCols(rank).rowwise().squaredNorm();
}

// The regression of one step from the triangular factor of its window.
class StepRegression {
 public:
  StepRegression(Index inputs, Index outputs, const GtvArxOptions& options, GtvArx& arx)
      : inputs_(inputs), outputs_(outputs), options_(options), arx_(arx) {}

  // R (w × w, upper) is the factor of step k with these lags; factor(i, j), i ≤ j, returns its entries. `rows` is the
  // number of experiments. At most `rows` rows of R have a nonzero diagonal entry. Further rows are rounding errors.
  template <class Factor>
  void run(Index k, Index lags, Index rows, Factor&& factor) {
    const Index first_y = lags * (inputs_ + outputs_) + inputs_, left = first_y - (options_.feedthrough ? 0 : inputs_);
    GtvArxStep& step = arx_.step[size_t(k)];
    step.lags = lags;
    step.rows = rows;
    // r = [R_WW R_Wy; 0 R_yy]. Without feedthrough, the rows of u_k are part of the residual.
    r_.setZero(left, linalg::whole_vectors(left));
    r_y_.setZero(left, linalg::whole_vectors(outputs_));
    r_yy_.setZero(first_y + outputs_ - left, outputs_);
    for (Index i = 0, used = 0; i < first_y + outputs_ && used < rows; ++i) {
      if (factor(i, i) == 0) continue;
      ++used;
      for (Index j = i; j < left; ++j) r_(i, j) = factor(i, j);
      for (Index j = std::max(i, first_y); j < first_y + outputs_; ++j)
        (i < left ? r_y_(i, j - first_y) : r_yy_(i - left, j - first_y)) = factor(i, j);
    }
    arx_.output_rms(k) = ((r_y_.leftCols(outputs_).colwise().squaredNorm() + r_yy_.colwise().squaredNorm()) /
                          double(std::max<Index>(1, rows)))
                             .cwiseSqrt()
                             .transpose();
    solve(k);
  }

 private:
  // Solves the least-squares problem Y_k = W_k M_kᵀ (19). The columns are scaled to norm 1, so that the rank and the
  // solution of minimum norm do not depend on the units of the channels.
  void solve(Index k) {
    const Index left = r_.rows();
    GtvArxStep& step = arx_.step[size_t(k)];
    scales_.resize(left);
    for (Index j = 0; j < left; ++j) {
      double norm = r_.col(j).norm();
      if (!(norm > 1e-140 && norm < 1e140)) norm = r_.col(j).stableNorm();
      scales_(j) = norm > 0 ? 1 / norm : 1.0;
    }
    r_.leftCols(left) *= scales_.asDiagonal();
    Matrix unexplained;  // part of r_y_ that the solution of lower rank does not explain
    const double size = r_.norm();
    // Without feedthrough, step 0 has no regressor.
    bool is_clear = left == 0 || r_.diagonal().cwiseAbs().minCoeff() * linalg::certain_rank > size;
    if (is_clear) {
      inverse_.setIdentity(left, r_.cols());
      linalg::back_substitute(r_, inverse_, true);
      step.condition = size * inverse_.norm();
      is_clear = step.condition < linalg::certain_rank;
    }
    if (is_clear) {  // M_kᵀ = S R_WW⁻¹ R_Wy, with the scales S
      step.rank = left;
      x_ = r_y_;
      linalg::back_substitute(r_, x_, false);
      arx_.coefficients(k) = (scales_.asDiagonal() * x_.leftCols(outputs_)).transpose();
      if (options_.noise_shape) arx_.noise_shape(k) = scales_.asDiagonal() * inverse_.leftCols(left);
    } else {  // M_kᵀ = S R_WW⁺ R_Wy
      const Matrix a = r_.leftCols(left), b = r_y_.leftCols(outputs_);
      const linalg::MinimumNorm solution = linalg::minimum_norm(a, b, options_.tolerance * std::sqrt(double(left)));
      step.rank = solution.rank;
      step.condition = solution.condition;
      arx_.coefficients(k) = (scales_.asDiagonal() * solution.x).transpose();
      if (options_.noise_shape) arx_.noise_shape(k) = scales_.asDiagonal() * solution.inverse_t;
      unexplained = b - a * solution.x;
    }
    step.freedom = std::max<Index>(0, step.rows - step.rank - options_.spent);
    if (step.freedom == 0) return;
    auto covariance = arx_.residual_cov(k);
    covariance.noalias() = r_yy_.transpose() * r_yy_;
    if (unexplained.size() > 0) covariance += unexplained.transpose() * unexplained;
    covariance /= double(step.freedom);
  }

  const Index inputs_, outputs_;
  const GtvArxOptions& options_;
  GtvArx& arx_;
  linalg::RowMatrix r_, r_y_, r_yy_, inverse_, x_;
  Vector scales_;
};

// Regresses steps one by one. A step uses the experiments without a missing sample in its window.
class AloneRoute {
 public:
  AloneRoute(const Windows& windows, const GtvArxOptions& options, GtvArx& arx)
      : windows_(windows), options_(options), arx_(arx), step_(windows.inputs(), windows.outputs(), options, arx) {}

  void run(Index k, Index lags) {
    const Index count = windows_.rows(k, lags, rows_);
    factor_.reset(rows_.cols());
    factor_.absorb(rows_);
    step_.run(k, lags, count, factor_);
    if (!options_.leverages) return;
    Matrix scaled = rows_.leftCols(arx_.regressors(k));
    scaled *= linalg::inverse_norms(scaled).asDiagonal();
    arx_.leverages(k) = leverages(scaled, arx_.step[size_t(k)].rank);
  }

 private:
  const Windows& windows_;
  const GtvArxOptions& options_;
  GtvArx& arx_;
  StepRegression step_;
  linalg::RowAbsorption factor_;
  Matrix rows_;
};

// Regresses the steps begin … end-1 from one factorisation of all their samples. The oldest samples of a step's window
// must be the first columns of the factor. Columns of older samples are therefore dropped, and the remaining columns
// absorb the rows of the dropped ones.
class SharedRoute {
 public:
  SharedRoute(const Windows& windows, const GtvArxOptions& options, GtvArx& arx)
      : ensemble_(*windows.ensemble()),
        step_(ensemble_.inputs(), ensemble_.outputs(), options, arx),
        alone_(windows, options, arx) {}

  void run(Index begin, Index end, Index lags) {
    const Index d = ensemble_.channels(), first = std::max<Index>(0, begin - lags);
    const auto window = ensemble_.samples().middleCols(first * d, (end - first) * d);
    if (std::isnan(window.sum())) {  // a missing sample makes the sum NaN
      for (Index k = begin; k < end; ++k) alone_.run(k, std::min(k, lags));
      return;
    }
    factor_.reset(window.cols());
    factor_.absorb(window);
    Index oldest = first;
    for (Index k = begin; k < end; ++k) {
      for (; oldest < k - lags; ++oldest) factor_.drop((oldest - first) * d, d);
      const Index from = (oldest - first) * d;
      step_.run(k, k - oldest, ensemble_.experiments(), [&](Index i, Index j) { return factor_(from + i, from + j); });
    }
  }

 private:
  const Ensemble& ensemble_;
  StepRegression step_;
  AloneRoute alone_;
  linalg::RowAbsorption factor_;
};

// Regresses successive steps k ≥ p together, one step in each lane of a vector. A step with a missing sample, or with
// an uncertain rank, is regressed alone.
class LaneRoute {
 public:
  LaneRoute(const Windows& windows, Index lags, const GtvArxOptions& options, GtvArx& arx)
      : ensemble_(*windows.ensemble()),
        options_(options),
        arx_(arx),
        lags_(lags),
        first_y_(lags * ensemble_.channels() + ensemble_.inputs()),
        left_(first_y_ - (options.feedthrough ? 0 : ensemble_.inputs())),
        batch_(ensemble_.experiments(), left_, first_y_ + ensemble_.outputs() - left_),
        alone_(windows, options, arx) {}

  // Regresses the steps k … k+lanes-1 and keeps those from `first` on.
  void run(Index k, Index first) {
    const Index rows = ensemble_.experiments(), offset = rows * ensemble_.channels();
    batch_.run(ensemble_.samples().data() + (k - lags_) * offset, rows, offset);
    for (Index l = first - k; l < batch_.lanes(); ++l) take(k + l, l);
  }

 private:
  void take(Index k, Index l) {
    const auto factor = [&](Index i, Index j) { return batch_.factor(l, i, j); };
    const Index rows = ensemble_.experiments(), m = ensemble_.outputs(), before = first_y_ - left_;
    GtvArxStep& step = arx_.step[size_t(k)];
    step.condition = batch_.condition(l);
    auto rms = arx_.output_rms(k);
    bool sound = step.condition < linalg::certain_rank;
    for (Index j = 0; j < m; ++j) {  // squares are NaN if a sample is missing, and inaccurate if very large or small
      double square = 0.0;
      for (Index i = 0; i <= first_y_ + j; ++i) square += factor(i, first_y_ + j) * factor(i, first_y_ + j);
      rms(j) = std::sqrt(square / double(rows));
      sound = sound && (square == 0 || (square > 1e-200 && square < 1e200));
    }
    if (!sound) return alone_.run(k, lags_);
    step.lags = lags_;
    step.rows = rows;
    step.rank = left_;
    step.freedom = std::max<Index>(0, rows - left_ - options_.spent);
    auto coefficients = arx_.coefficients(k);
    auto covariance = arx_.residual_cov(k);
    for (Index j = 0; j < left_; ++j)
      for (Index i = 0; i < m; ++i) coefficients(i, j) = batch_.x(l, j, before + i);
    for (Index j = 0; j < m; ++j)
      for (Index i = 0; i <= j && step.freedom > 0; ++i) {
        double product = 0.0;
        for (Index h = left_; h <= first_y_ + i; ++h) product += factor(h, first_y_ + i) * factor(h, first_y_ + j);
        covariance(i, j) = covariance(j, i) = product / double(step.freedom);
      }
    if (!options_.noise_shape) return;
    auto shape = arx_.noise_shape(k);
    for (Index j = 0; j < left_; ++j) {
      for (Index i = 0; i <= j; ++i) shape(i, j) = batch_.inverse(l, i, j);
      shape.col(j).tail(left_ - j - 1).setZero();
    }
  }

  const Ensemble& ensemble_;
  const GtvArxOptions& options_;
  GtvArx& arx_;
  const Index lags_, first_y_, left_;  // p, the first column of y_k, number of regressors
  linalg::LaneRegression batch_;
  AloneRoute alone_;
};

// The number b of steps in a block that needs the fewest operations per step. The b steps share one factorisation of
// the samples of p+b steps. Operations that drop samples are slower by about the factor `slow`.
Index best_block(Index experiments, Index channels, Index lags) {
  constexpr double slow = 2.5, worth_it = 0.8;
  const auto cost = [&](Index b) {
    const double n = double(experiments), width = double((lags + b) * channels);
    const double rest = (double(lags) + double(b) / 2) * double(channels);
    return 2 * n * width * width / double(b) + (b > 1 ? slow * 2 * double(channels) * rest * rest : 0.0);
  };
  Index best = 1;
  for (Index b = 2; b <= 2 * lags; ++b)
    if (cost(b) < cost(best)) best = b;
  return cost(best) < worth_it * cost(1) ? best : 1;
}

void check(const Windows& w) {
  if (w.experiments() == 0 || w.steps() == 0 || w.inputs() == 0 || w.outputs() == 0)
    throw std::invalid_argument(
        fmt::format("ensemble: {} experiments of {} steps with {} inputs and {} outputs found, at least one of each "
                    "needed",
                    w.experiments(), w.steps(), w.inputs(), w.outputs()));
}

// Allocates an ARX model for all regressions and sets the first step that is regressed.
GtvArx prepared(const Windows& windows, const GtvArxOptions& options) {
  check(windows);
  const Index steps = windows.steps();
  if (options.lags.size() != 1 && static_cast<Index>(options.lags.size()) != steps)
    throw std::invalid_argument(
        fmt::format("lags: {} lag orders found, one or {} (one for each step) needed", options.lags.size(), steps));
  for (const Index p : options.lags)
    if (p < 1) throw std::invalid_argument(fmt::format("lags: lag order {} found, at least 1 needed", p));
  if (options.block < 0)
    throw std::invalid_argument(fmt::format("block: {} found, 0 (automatic) or more needed", options.block));

  GtvArx arx;
  arx.feedthrough = options.feedthrough;
  Index lags_max = 0;
  for (Index k = 0; k < steps; ++k) lags_max = std::max(lags_max, std::min(options.lags_of(k), k));
  arx.resize(steps, windows.inputs(), windows.outputs(), lags_max, options.noise_shape,
             options.leverages ? windows.experiments() : 0);
  if (options.initial_state == InitialState::zero) return arx;
  // With an unknown initial state, the regressions begin at the first step from which on all lagged samples are in the
  // data.
  Index begin = steps;
  while (begin > 0 && options.lags_of(begin - 1) < begin) --begin;
  arx.begin_at(begin);
  return arx;
}

void regress_alone(const Windows& windows, Index begin, Index end, const Execution& execution,
                   const GtvArxOptions& options, GtvArx& arx) {
  parallel_for(begin, end, execution, [&](Index from, Index to) {
    AloneRoute route(windows, options, arx);
    for (Index k = from; k < to; ++k) route.run(k, std::min(options.lags_of(k), k));
  });
}

}  // namespace

GtvArx gtv_arx(const Windows& windows, const GtvArxOptions& options) {
  GtvArx arx = prepared(windows, options);
  regress_alone(windows, arx.k_begin, arx.steps(), options.execution, options, arx);
  return arx;
}

GtvArx gtv_arx(const Ensemble& ensemble, const GtvArxOptions& options) {
  check_samples(ensemble);
  const Windows windows(ensemble);
  const bool alike = options.lags.size() == 1 && !options.leverages;
  if (!alike || options.block == 1) return gtv_arx(windows, options);

  GtvArx arx = prepared(windows, options);
  const Index steps = arx.steps(), p = options.lags.front(), first = std::max(p, arx.k_begin);
  const Index lanes = linalg::LaneRegression::lanes();
  if (options.block == 0 && (p + 1) * ensemble.channels() <= linalg::LaneRegression::most_columns() &&
      ensemble.experiments() > minimum_experiments(ensemble.inputs(), ensemble.outputs(), p, options.feedthrough) &&
      steps - first >= linalg::LaneRegression::most_lanes) {  // not lanes: the same route with every instruction set
    regress_alone(windows, arx.k_begin, first, {options.execution.threads, {}}, options, arx);
    parallel_for(0, (steps - first + lanes - 1) / lanes, options.execution, [&](Index begin, Index end) {
      LaneRoute route(windows, p, options, arx);
      for (Index i = begin; i < end; ++i) route.run(std::min(first + i * lanes, steps - lanes), first + i * lanes);
    });
    return arx;
  }
  const Index block = options.block > 0 ? options.block : best_block(ensemble.experiments(), ensemble.channels(), p);
  parallel_for(0, (steps - arx.k_begin + block - 1) / block, options.execution, [&](Index begin, Index end) {
    SharedRoute route(windows, options, arx);
    for (Index i = begin; i < end; ++i) {
      const Index from = arx.k_begin + i * block;
      route.run(from, std::min(steps, from + block), p);
    }
  });
  return arx;
}

Index minimum_experiments(Index inputs, Index outputs, Index lags, bool feedthrough) {
  return (feedthrough ? inputs : 0) + lags * (inputs + outputs);
}

Index largest_lag_order(Index experiments, Index inputs, Index outputs, bool feedthrough) {
  return std::max<Index>(0, (experiments - (feedthrough ? inputs : 0)) / (inputs + outputs));
}

}  // namespace tokid
