// SPDX-License-Identifier: BSD-3-Clause
#include "choose/constant.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "base/statistics.hpp"
#include "data/channel_sizes.hpp"
#include "linalg/symmetric.hpp"
#include "tokid/innovations.hpp"

namespace tokid {

namespace {

constexpr Index regression_lags = 8, windows_of_each = 16, most_with_constant = 320;
constexpr double false_alarm = 1e-3;
// Most multiplications for the products of the windows, and the relative size of their rounding errors.
constexpr double most_multiplications = 5e8, gram_rounding = 1e-12;

Index unknowns_with_constant(const Ensemble& e, Index lags) { return lags * e.channels() + e.inputs() + 1; }

// Products of the rows [y_{k-1} … y_{k-p}, u_k … u_{k-p}, 1, y_k] that have no missing sample, and the number of
// rows.
struct WindowProducts {
  Matrix all;
  double rows = 0;
};

WindowProducts window_products(const Ensemble& e, Index lags) {
  const Index r = e.inputs(), m = e.outputs(), d = e.channels(), width = unknowns_with_constant(e, lags) + m;
  const double windows = double(e.experiments()) * double(e.steps() - lags);
  const Index stride = std::max<Index>(1, Index(windows * double(width) * double(width) / most_multiplications));
  WindowProducts result{Matrix::Zero(width, width)};
  Matrix rows(e.experiments(), width);
  for (Index k = lags; k < e.steps(); k += stride) {
    for (Index l = 1; l <= lags; ++l) rows.middleCols((l - 1) * m, m) = e.output(k - l);
    for (Index l = 0; l <= lags; ++l) rows.middleCols(lags * m + l * r, r) = e.input(k - l);
    rows.col(lags * d + r).setOnes();
    rows.rightCols(m) = e.output(k);
    for (Index n = 0; n < rows.rows(); ++n)
      if (rows.row(n).allFinite())
        ++result.rows;
      else
        rows.row(n).setZero();
    linalg::add_squares(rows, result.all);
  }
  result.all.triangularView<Eigen::StrictlyUpper>() = result.all.transpose();
  return result;
}

}  // namespace

Constant test_constant(const Ensemble& e) {
  const Index m = e.outputs();
  Index lags = regression_lags;
  while (lags > 0 && unknowns_with_constant(e, lags) > most_with_constant) --lags;
  while (lags > 0 && e.experiments() * (e.steps() - lags) < windows_of_each * unknowns_with_constant(e, lags)) --lags;
  if (lags == 0) return {};
  const WindowProducts products = window_products(e, lags);
  const Index unknowns = unknowns_with_constant(e, lags), last = unknowns - 1;
  if (products.rows < double(windows_of_each * unknowns)) return {};
  Matrix regressors = products.all.topLeftCorner(unknowns, unknowns);
  const Matrix responses = products.all.topRightCorner(unknowns, m), outputs = products.all.bottomRightCorner(m, m);
  regressors.diagonal().array() += gram_rounding * regressors.trace() / double(unknowns);
  const auto factors = regressors.ldlt();
  const Matrix theta = factors.solve(responses);
  const double freedom = products.rows - double(unknowns);
  Matrix covariance = (outputs - theta.transpose() * responses) / freedom;
  covariance.diagonal() += 100 * gram_rounding * outputs.diagonal() / products.rows;
  const double share = factors.solve(Matrix::Identity(unknowns, unknowns).col(last))(last);
  const Vector constant = theta.row(last).transpose();

  Matrix rest = Matrix::Identity(m, m);
  for (Index l = 0; l < lags; ++l) rest -= theta.middleRows(l * m, m).transpose();
  const Matrix inverse = rest.inverse();
  const Vector deviation = (share * (inverse * covariance * inverse.transpose()).diagonal()).cwiseSqrt();
  Constant result;
  result.at_rest = inverse * constant;
  const Vector sizes = channel_sizes(e, e.inputs(), m);
  if (!result.at_rest.allFinite() || !(deviation.array() <= sizes.array()).all()) return {};
  result.statistic = constant.dot(covariance.ldlt().solve(constant)) / (share * double(m));
  result.threshold = statistics::f_quantile(1 - false_alarm, double(m), freedom);
  return result;
}

std::optional<Vector> remaining_constant(const Model& model, const Ensemble& departures, InitialState initial) {
  const Index m = model.outputs, N = departures.experiments();
  const auto innovations = [&](const Ensemble& e) { return predict(model, e, {1, initial}).innovations; };
  const Innovations all = innovations(departures);
  // The innovations are linear in the samples. They differ by their derivatives if 1 is added to an output.
  std::vector<Innovations> of_constant;
  for (Index j = 0; j < m; ++j) {
    Ensemble higher = departures;
    for (Index k = 0; k < higher.steps(); ++k) higher.output(k).col(j).array() += 1.0;
    of_constant.push_back(innovations(higher));
    for (size_t k = 0; k < all.size(); ++k) of_constant.back()[k] -= all[k];
  }
  Matrix information = Matrix::Zero(m, m), derivative(m, m);
  Vector score = Vector::Zero(m);
  for (size_t k = size_t(model.k_begin); k < std::min(all.size(), size_t(model.k_end())); ++k) {
    const auto inverse = model.at(Index(k)).innovation_cov().ldlt();
    for (Index n = 0; n < N; ++n) {
      for (Index j = 0; j < m; ++j) derivative.col(j) = of_constant[size_t(j)][k].row(n).transpose();
      const Vector e = all[k].row(n).transpose();
      if (!e.allFinite() || !derivative.allFinite()) continue;
      const Matrix weighted = inverse.solve(derivative);
      information += derivative.transpose() * weighted;
      score += weighted.transpose() * e;
    }
  }
  const auto factors = information.ldlt();
  const Vector constant = factors.solve(score),
               deviation = factors.solve(Matrix::Identity(m, m)).diagonal().cwiseSqrt();
  const bool determined =
      constant.allFinite() && (deviation.array() <= channel_sizes(departures, departures.inputs(), m).array()).all();
  return determined ? std::optional(constant) : std::nullopt;
}

}  // namespace tokid
