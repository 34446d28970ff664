// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/gtv_arx.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <stdexcept>

namespace tokid {

void GtvArx::resize(Index T, Index r, Index m, Index lags_max, bool noise_shape, Index experiments) {
  inputs = r;
  outputs = m;
  k_begin = 0;
  step.assign(size_t(T), GtvArxStep{});
  slot_ = lags_max * (r + m) + r;
  shape_rows_ = noise_shape ? slot_ : 0;
  coefficients_.setZero(m, T * slot_);
  residual_cov_.setZero(m, T * m);
  noise_shape_.setZero(shape_rows_, T * shape_rows_);
  output_rms_.setZero(m, T);
  leverages_.setZero(experiments, T);
}

void GtvArx::begin_at(Index k) {
  k_begin = k;
  std::fill_n(step.begin(), k, GtvArxStep{});
  residual_cov_.leftCols(k * outputs).setZero();
  output_rms_.leftCols(k).setZero();
}

void GtvArx::require_noise_shape() const {
  if (!has_noise_shape())
    throw std::invalid_argument("noise_shape: not stored with the regressions, needed for variances");
}

namespace {

// Inverse norms of the columns; 1 for columns of zeros, which stay zero.
Vector column_scales(const ConstMatrixRef& a) {
  Vector scales = a.colwise().norm();
  for (double& s : scales) s = s > 0 ? 1 / s : 1.0;
  return scales;
}

// Diagonal of W W⁺ for W with scaled columns and triangular factor `r_ww`.
Vector leverages(const Matrix& w, const ConstMatrixRef& r_ww, Index rank) {
  if (rank >= w.rows()) return Vector::Ones(w.rows());
  if (rank == w.cols()) return linalg::orthonormal_factor(w).rowwise().squaredNorm();
  if (w.rows() < w.cols()) return linalg::svd(w).u.leftCols(rank).rowwise().squaredNorm();
  const Matrix range = linalg::svd(r_ww).u.leftCols(rank);
  return (linalg::orthonormal_factor(w) * range).rowwise().squaredNorm();
}

// The least-squares problem Y_k = W_k M_kᵀ (19) from its triangular factor, columns of W_k divided by 1 / `scales`.
void solve(const ConstMatrixRef& r, const Vector& scales, const GtvArxOptions& options, Index k, GtvArx& arx) {
  // r = [R_WW R_Wy; 0 R_yy]
  GtvArxStep& step = arx.step[size_t(k)];
  const Index outputs = arx.outputs, regressors = scales.size(), lead = std::min(r.rows(), regressors);
  const auto r_ww = r.topLeftCorner(lead, regressors);
  const auto r_wy = r.topRightCorner(lead, outputs);
  const auto r_yy = r.bottomRightCorner(r.rows() - lead, outputs);
  const linalg::MinimumNorm solution =
      linalg::triangular_minimum_norm(r_ww, r_wy, options.tolerance * std::sqrt(double(regressors)));
  step.rank = solution.rank;
  step.condition = solution.condition;
  arx.coefficients(k) = (scales.asDiagonal() * solution.x).transpose();
  if (options.noise_shape) arx.noise_shape(k) = scales.asDiagonal() * solution.inverse_t;

  step.freedom = std::max<Index>(0, step.rows - step.rank - options.spent);
  if (step.freedom == 0) return;
  const Matrix unexplained = r_wy - r_ww * solution.x;  // beyond the numerical rank
  arx.residual_cov(k) = (r_yy.transpose() * r_yy + unexplained.transpose() * unexplained) / double(step.freedom);
}

// One step by itself, over the experiments without a gap.
void regress(const Ensemble& ensemble, Index k, Index lags, bool every_row, const GtvArxOptions& options,
             Matrix& workspace, GtvArx& arx) {
  GtvArxStep& step = arx.step[size_t(k)];
  step.lags = lags;
  const Index outputs = ensemble.outputs();
  const Index regressors = lags * ensemble.channels() + ensemble.inputs();
  const auto block = ensemble.window_and_output(k, lags);
  if (every_row)
    workspace = block;
  else
    workspace = block(ensemble.complete_rows(k, lags), Eigen::all);
  step.rows = workspace.rows();

  // Columns of norm 1: the rank and the smallest norm then do not depend on the units of the channels.
  const Vector scales = column_scales(workspace.leftCols(regressors));
  workspace.leftCols(regressors) *= scales.asDiagonal();
  Matrix scaled;
  if (options.leverages) scaled = workspace.leftCols(regressors);
  arx.output_rms(k) = (workspace.rightCols(outputs).colwise().squaredNorm() / double(std::max<Index>(1, step.rows)))
                          .cwiseSqrt()
                          .transpose();
  const Matrix r = linalg::triangular_factor(workspace);
  solve(r, scales, options, k, arx);
  if (options.leverages)
    arx.leverages(k) = leverages(scaled, r.topLeftCorner(std::min(r.rows(), regressors), regressors), step.rank);
}

// The steps begin … end-1 from one factorisation of all their samples. A step has the oldest samples of its window
// before all others but those of the steps before it; once these are dropped, their rows of the triangular factor are
// absorbed by the rest of it.
void regress_block(const Ensemble& ensemble, Index begin, Index end, Index lags, const GtvArxOptions& options,
                   GtvArx& arx) {
  const Index d = ensemble.channels(), m = ensemble.outputs(), r = ensemble.inputs(), rows = ensemble.experiments();
  Index oldest = std::max<Index>(0, begin - lags);
  Matrix window = ensemble.samples().middleCols(oldest * d, (end - oldest) * d);
  const Vector norms = window.colwise().norm(), scales = column_scales(window);
  window *= scales.asDiagonal();
  const Index width = window.cols(), origin = oldest * d;
  Matrix factor = Matrix::Zero(width, width);
  {
    const Matrix top = linalg::triangular_factor(window);
    factor.topRows(top.rows()) = top;
  }
  Matrix dropped;
  for (Index k = begin; k < end; ++k) {
    for (; oldest < k - lags; ++oldest) {
      const Index from = oldest * d - origin, rest = width - from - d;
      dropped = factor.block(from, from + d, d, rest);
      linalg::absorb_rows(factor.bottomRightCorner(rest, rest), dropped);
    }
    const Index from = oldest * d - origin, size = (k + 1 - oldest) * d;
    GtvArxStep& step = arx.step[size_t(k)];
    step.lags = k - oldest;
    step.rows = rows;
    arx.output_rms(k) = norms.segment(from + size - m, m) / std::sqrt(double(rows));
    Matrix own = factor.block(from, from, size, size);
    // Outputs in their own units.
    for (Index j = 0; j < m; ++j) own.col(size - m + j) /= scales(from + size - m + j);
    solve(own, scales.segment(from, step.lags * d + r), options, k, arx);
  }
}

// b with the fewest operations per step: the factorisation of p+b steps, shared by b of them, and what it takes to drop
// samples, whose operations are slower by about the factor `slow`.
Index best_block(Index experiments, Index channels, Index lags) {
  constexpr double slow = 4.0, worth_it = 0.8;
  const auto cost = [&](Index b) {
    const double n = double(experiments), width = double((lags + b) * channels), k = std::min(n, width);
    const double factorisation = 2 * k * k * (std::max(n, width) - k / 3) / double(b);
    const double rest = (double(lags) + double(b) / 2) * double(channels);
    return factorisation + (b > 1 ? slow * 2 * double(channels) * rest * rest : 0.0);
  };
  Index best = 1;
  for (Index b = 2; b <= 2 * lags; ++b)
    if (cost(b) < cost(best)) best = b;
  return cost(best) < worth_it * cost(1) ? best : 1;
}

void check_ensemble(const Ensemble& ensemble) {
  if (ensemble.experiments() == 0 || ensemble.steps() == 0 || ensemble.inputs() == 0 || ensemble.outputs() == 0)
    throw std::invalid_argument(fmt::format(
        "ensemble: {} experiments of {} steps with {} inputs and {} outputs found, at least one of each needed",
        ensemble.experiments(), ensemble.steps(), ensemble.inputs(), ensemble.outputs()));
}

}  // namespace

GtvArx gtv_arx(const Ensemble& ensemble, const GtvArxOptions& options) {
  check_ensemble(ensemble);
  const Index steps = ensemble.steps();
  if (options.lags.size() != 1 && static_cast<Index>(options.lags.size()) != steps)
    throw std::invalid_argument(
        fmt::format("lags: {} lag orders found, one or {} (one for each step) needed", options.lags.size(), steps));
  for (const Index p : options.lags)
    if (p < 1) throw std::invalid_argument(fmt::format("lags: lag order {} found, at least 1 needed", p));
  const auto lag_order = [&](Index k) { return options.lags[options.lags.size() == 1 ? 0 : static_cast<size_t>(k)]; };

  GtvArx arx;
  Index lags_max = 0;
  for (Index k = 0; k < steps; ++k) lags_max = std::max(lags_max, std::min(lag_order(k), k));
  arx.resize(steps, ensemble.inputs(), ensemble.outputs(), lags_max, options.noise_shape,
             options.leverages ? ensemble.experiments() : 0);
  const bool zero = options.initial_state == InitialState::zero;
  if (!zero) {
    // The regressions begin where every later step has its lags within the data.
    for (Index k = steps; k-- > 0;)
      if (lag_order(k) > k) {
        arx.k_begin = k + 1;
        break;
      }
  }
  const bool every_row = ensemble.missing() == 0;
  if (options.block < 0)
    throw std::invalid_argument(fmt::format("block: {} found, 0 (automatic) or more needed", options.block));
  const bool shared = every_row && !options.leverages && options.lags.size() == 1 && options.block != 1;
  if (const Index block = !shared             ? 1
                          : options.block > 0 ? options.block
                                              : best_block(ensemble.experiments(), ensemble.channels(), lag_order(0));
      block > 1) {
    const Index blocks = (steps - arx.k_begin + block - 1) / block;
    parallel_for(0, blocks, options.execution, [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i) {
        const Index from = arx.k_begin + i * block;
        regress_block(ensemble, from, std::min(steps, from + block), lag_order(0), options, arx);
      }
    });
    return arx;
  }
  parallel_for(arx.k_begin, steps, options.execution, [&](Index begin, Index end) {
    Matrix workspace;
    for (Index k = begin; k < end; ++k)
      regress(ensemble, k, std::min(lag_order(k), k), every_row, options, workspace, arx);
  });
  return arx;
}

Index minimum_experiments(Index inputs, Index outputs, Index lags) { return inputs + lags * (inputs + outputs); }

Index largest_lag_order(Index experiments, Index inputs, Index outputs) {
  return std::max<Index>(0, (experiments - inputs) / (inputs + outputs));
}

namespace {

constexpr double inf = std::numeric_limits<double>::infinity();

// Leave-one-out errors of one step for the lag orders 1 … p_max, as log of the share of the mean square of y.
Vector step_errors(const Ensemble& ensemble, Index k, Index p_max, double exact) {
  const Index d = ensemble.channels(), r = ensemble.inputs(), m = ensemble.outputs();
  const std::vector<Index> rows = ensemble.complete_rows(k, p_max);
  const Index count = static_cast<Index>(rows.size());
  Vector error = Vector::Constant(p_max, inf);
  const Index p_judged = std::min(p_max, largest_lag_order(count - 1, r, m));  // at least one degree of freedom
  if (p_judged < 1) return error;

  Matrix w(count, r + p_judged * d);  // newest lag first
  w.leftCols(r) = ensemble.input(k)(rows, Eigen::all);
  for (Index j = 1; j <= p_judged; ++j)
    w.middleCols(r + (j - 1) * d, d) = ensemble.samples().middleCols((k - j) * d, d)(rows, Eigen::all);
  w *= column_scales(w).asDiagonal();
  const Matrix y = ensemble.output(k)(rows, Eigen::all);
  const Matrix q = linalg::orthonormal_factor(w);

  Matrix residual = y;
  Vector left = Vector::Ones(count);  // 1 - leverage
  Index used = 0;
  const auto use = [&](Index columns) {
    const auto part = q.middleCols(used, columns);
    residual -= part * (part.transpose() * residual);
    left -= part.rowwise().squaredNorm();
    used += columns;
  };
  use(r);
  for (Index p = 1; p <= p_judged; ++p) {
    use(d);
    double sum = 0.0;
    for (Index j = 0; j < m; ++j) {
      const double scale = y.col(j).squaredNorm();
      // An experiment that alone determines a coefficient (leverage 1) can't be predicted from the others.
      const double loo = (residual.col(j).array() / left.array().max(1e-12)).square().sum();
      sum += scale > 0 ? std::log(std::max(loo / scale, exact * exact)) : 0.0;
    }
    error(p - 1) = sum / double(m);
  }
  return error;
}

}  // namespace

LagOrderErrors lag_order_errors(const Ensemble& ensemble, const LagOrderOptions& options) {
  check_ensemble(ensemble);
  const Index p_max = std::min(options.p_max, ensemble.steps() - 1);
  LagOrderErrors result;
  result.best = std::max<Index>(1, options.p_min);
  if (p_max < 1) return result;

  const Index available = ensemble.steps() - p_max;
  const Index count = std::min(available, std::max<Index>(1, options.steps));
  for (Index s = 0; s < count; ++s) result.steps.push_back(p_max + (2 * s + 1) * available / (2 * count));
  result.error.resize(count, p_max);
  parallel_for(0, count, options.execution, [&](Index begin, Index end) {
    for (Index s = begin; s < end; ++s)
      result.error.row(s) =
          step_errors(ensemble, result.steps[static_cast<size_t>(s)], p_max, options.exact).transpose();
  });
  // Missing samples may leave some steps too few experiments: orders are compared at the steps that can judge all of
  // them, up to the largest order that at least half of the steps can judge.
  const auto judging = [&](Index p) { return (result.error.col(p - 1).array() < inf).count(); };
  Index judged = p_max;
  while (judged > 1 && 2 * judging(judged) < count) --judged;
  std::vector<Index> rows;
  for (Index s = 0; s < count; ++s)
    if (result.error(s, judged - 1) < inf) rows.push_back(s);
  const Matrix error = result.error(rows, Eigen::all);
  result.mean.setConstant(p_max, inf);
  if (!rows.empty()) result.mean.head(judged) = error.leftCols(judged).colwise().mean().transpose();

  // One standard error of the paired difference over steps decides against needless lags.
  const Index first = std::clamp<Index>(options.p_min, 1, p_max);
  Index smallest = first;
  for (Index p = first; p <= p_max; ++p)
    if (result.mean(p - 1) < result.mean(smallest - 1)) smallest = p;
  result.best = std::max(options.p_min, smallest);
  if (!std::isfinite(result.mean(smallest - 1))) return result;
  for (Index p = first; p < smallest; ++p) {
    const Vector difference = error.col(p - 1) - error.col(smallest - 1);
    const double mean = difference.mean(), steps = double(difference.size());
    const double variance = (difference.array() - mean).square().sum() / std::max(1.0, steps - 1);
    if (mean <= std::sqrt(variance / steps)) {
      result.best = p;
      break;
    }
  }
  return result;
}

}  // namespace tokid
