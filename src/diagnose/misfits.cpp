// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/misfits.hpp"

#include <algorithm>
#include <cmath>

#include "base/integers.hpp"
#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "data/rows.hpp"
#include "tokid/linalg.hpp"

namespace tokid {

namespace {

// Number of innovations that the usual size of a step needs, and that an experiment must have.
constexpr Index for_median = 40, fewest_innovations = 6;
// An outlier has innovations of at least this multiple of the median over the experiments.
constexpr double of_consequence = 3.0;
// The threshold is a quantile of Student's t: one ensemble without outliers in a thousand exceeds it. The scatter of
// the logarithmic sizes is computed from their median deviation. For Gaussian samples, this has the efficiency 0.37. A
// prior scatter with four degrees of freedom is added, which matters for few experiments.
constexpr double false_alarms = 1e-3, efficiency = 0.37, own_scatter = 0.2, own_freedom = 4.0;
// Most inputs of a window of successive steps in which directions are searched.
constexpr Index most_inputs = 40;

// The mean without the largest quarter: a few wrong samples do not make an experiment wrong.
double trimmed_mean(std::vector<double> sizes) {
  const auto kept = std::ptrdiff_t(sizes.size() - sizes.size() / 4);
  if (kept < std::ptrdiff_t(sizes.size())) std::nth_element(sizes.begin(), sizes.begin() + kept, sizes.end());
  double sum = 0.0;
  for (auto size = sizes.begin(); size != sizes.begin() + kept; ++size) sum += *size;
  return kept > 0 ? sum / double(kept) : nan;
}

// (T) median of |ε_k| of output j, over these rows and over as many neighbouring steps as give enough innovations.
Vector usual_sizes(const Innovations& innovations, Index j, const std::vector<Index>& rows) {
  const Index T = Index(innovations.size()), reach = ceil_div(for_median, std::max<Index>(1, Index(rows.size()))) / 2;
  Vector result(T);
  for (Index k = 0; k < T; ++k) {
    std::vector<double> sizes;
    for (Index i = std::max<Index>(0, k - reach); i <= std::min(T - 1, k + reach); ++i)
      for (const Index n : rows)
        if (const double e = innovations[size_t(i)](n, j); !std::isnan(e)) sizes.push_back(std::abs(e));
    result(k) = statistics::median(std::move(sizes));
  }
  return result;
}

// Fills the sizes of one output, of experiments whose innovations are those of models of the same data.
void add_sizes(const Innovations& innovations, Index j, const std::vector<Index>& rows, const std::vector<char>& out,
               Sizes& result) {
  std::vector<Index> of_models;
  for (const Index n : rows)
    if (!out[size_t(n)]) of_models.push_back(n);
  const Vector of_step = usual_sizes(innovations, j, of_models);
  std::vector<double> sizes_of_models;
  for (const Index n : rows) {
    std::vector<double> sizes;
    for (size_t k = 0; k < innovations.size(); ++k)
      if (const double size = std::abs(innovations[k](n, j)) / of_step(Index(k)); std::isfinite(size))
        sizes.push_back(size);
    const Index count = Index(sizes.size());
    result.count(n, j) = double(count);
    if (count < fewest_innovations) continue;
    result.ratio(n, j) = trimmed_mean(std::move(sizes));
    if (!out[size_t(n)]) sizes_of_models.push_back(result.ratio(n, j));
  }
  const double typical = statistics::median(std::move(sizes_of_models));
  for (const Index n : rows) result.ratio(n, j) /= typical;
}

}  // namespace

Sizes innovation_sizes(const Innovations& innovations, const std::vector<char>& out, Index folds) {
  const Index N = Index(out.size()), m = innovations.empty() ? 0 : innovations.front().cols(),
              groups = std::max<Index>(1, folds);
  Sizes result{Matrix::Constant(N, m, nan), Matrix::Zero(N, m)};
  for (Index g = 0; g < groups; ++g) {
    const std::vector<Index> rows = fold_rows(N, g, groups);
    for (Index j = 0; j < m; ++j) add_sizes(innovations, j, rows, out, result);
  }
  return result;
}

namespace {

// An experiment with larger outputs than the others may have larger innovations, up to this factor.
constexpr double most_allowed = 10.0;

// (N) Thresholds of the sizes of one output. They are higher for experiments with few innovations.
Vector size_thresholds(const Vector& ratio, const Vector& count, const std::vector<char>& out, double tests) {
  std::vector<double> deviations, counts;
  for (Index n = 0; n < ratio.size(); ++n)
    if (!out[size_t(n)] && !std::isnan(ratio(n))) {
      deviations.push_back(std::abs(std::log(ratio(n))));
      counts.push_back(count(n));
    }
  const double freedom = efficiency * double(Index(deviations.size()) - 1),
               scatter = 1.4826 * statistics::median(std::move(deviations)),
               variance =
                   (own_freedom * own_scatter * own_scatter + freedom * scatter * scatter) / (own_freedom + freedom),
               quantile = statistics::student_quantile(1 - false_alarms / tests, own_freedom + freedom),
               most = statistics::median(std::move(counts));
  // The logarithm of the mean size of n innovations has the variance 0.57 / n.
  const Eigen::ArrayXd of_few = 0.57 * (1.0 / count.array() - 1.0 / most).max(0.0);
  return (quantile * (variance + of_few).sqrt()).exp();
}

}  // namespace

Matrix misfit(const Sizes& sizes, const Matrix& response, const std::vector<char>& out) {
  const Index N = sizes.ratio.rows(), m = sizes.ratio.cols();
  Matrix result(N, m);
  for (Index j = 0; j < m; ++j) {
    const Vector threshold = size_thresholds(sizes.ratio.col(j), sizes.count.col(j), out, double(N * m));
    std::vector<double> responses;
    for (Index n = 0; n < N; ++n)
      if (!out[size_t(n)] && !std::isnan(response(n, j))) responses.push_back(response(n, j));
    const double typical = statistics::median(std::move(responses));
    for (Index n = 0; n < N; ++n) {
      const double relative = typical > 0 ? response(n, j) / typical : 1.0;
      const double allowed = std::isnan(relative) ? 1.0 : std::clamp(relative, 1.0, most_allowed);
      result(n, j) = sizes.ratio(n, j) / std::max(of_consequence, threshold(n) * allowed);
    }
  }
  return result;
}

bool excites_more(const Ensemble& e, Index n, Index lags, bool centred) {
  const Index r = e.inputs(), d = e.channels();
  const Index steps = std::min({lags + 1, e.steps(), std::max<Index>(1, most_inputs / r)});
  Matrix squares = Matrix::Zero(r * steps, r * steps), own(0, r * steps);
  for (Index k = 0; k + steps <= e.steps(); k += std::max<Index>(1, steps / 2)) {
    Matrix u(e.experiments(), r * steps);
    for (Index i = 0; i < steps; ++i) u.middleCols(i * r, r) = e.samples().middleCols((k + i) * d, r);
    std::vector<Index> others;
    for (Index i = 0; i < e.experiments(); ++i)
      if (i != n && u.row(i).allFinite()) others.push_back(i);
    if (others.empty() || !u.row(n).allFinite()) continue;
    Matrix x = u(others, Eigen::all);
    if (centred) {
      const Eigen::RowVectorXd mean = x.colwise().mean();
      x.rowwise() -= mean;
      u.row(n) -= mean;
    }
    squares += x.transpose() * x;
    own.conservativeResize(own.rows() + 1, Eigen::NoChange);
    own.row(own.rows() - 1) = u.row(n);
  }
  // Inputs are scaled by their sizes; an input may be zero in all other experiments.
  const Vector size = (squares.diagonal() + own.colwise().squaredNorm().transpose()).cwiseSqrt();
  const Vector unit = (size.array() > 0).select(size.cwiseInverse(), 0.0);
  const linalg::Svd found = linalg::svd(unit.asDiagonal() * squares * unit.asDiagonal());
  const Matrix along = own * unit.asDiagonal() * found.v;
  constexpr double nothing = 1e-13, something = 1e-10;  // of squares
  for (Index i = 0; i < found.s.size(); ++i)
    if (found.s(i) <= nothing * found.s(0) && along.col(i).squaredNorm() > something * along.squaredNorm()) return true;
  return false;
}

}  // namespace tokid
