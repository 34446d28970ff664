// SPDX-License-Identifier: BSD-3-Clause
#include "model/input_correlation.hpp"

#include <fmt/format.h>

#include <cmath>
#include <stdexcept>

#include "base/nan.hpp"
#include "model/innovation_checks.hpp"

namespace tokid {

namespace {

// Sums of correlations of one lag. With ν degrees of freedom, a correlation has the variance 1/ν if the innovation is
// independent of the input. Innovations of different steps are uncorrelated, so the variances add up.
struct LagSums {
  Matrix correlation, variance, terms;  // (m × r), (1 × r), (1 × r)

  LagSums(Index outputs, Index inputs)
      : correlation(Matrix::Zero(outputs, inputs)), variance(Matrix::Zero(1, inputs)), terms(Matrix::Zero(1, inputs)) {}

  // Innovations and inputs of the same experiments, as columns of norm 1. An input that does not vary is a zero column.
  void add(const Matrix& e, const Matrix& u) {
    correlation += e.transpose() * u;
    for (Index i = 0; i < u.cols(); ++i)
      if (!u.col(i).isZero(0.0)) terms(i) += 1, variance(i) += 1 / double(e.rows() - 1);
  }
};

Matrix unit_inputs(Matrix u) {
  fill_missing_inputs(u);
  return unit_columns(std::move(u));
}

InputCorrelation result_of(const std::vector<LagSums>& sums, Index first, Pooling over) {
  constexpr double two_sided_99 = 2.5758293035489;  // quantile of the normal distribution
  InputCorrelation result;
  result.first = first;
  result.over = over;
  const Index inputs = sums.front().terms.size();
  result.bound = Matrix::Constant(Index(sums.size()), inputs, nan);
  for (size_t j = 0; j < sums.size(); ++j) {
    const LagSums& lag = sums[j];
    Matrix correlation = Matrix::Constant(lag.correlation.rows(), inputs, nan);
    for (Index i = 0; i < inputs; ++i) {
      if (lag.terms(i) == 0) continue;
      correlation.col(i) = lag.correlation.col(i) / lag.terms(i);
      result.bound(Index(j), i) = two_sided_99 * std::sqrt(lag.variance(i)) / lag.terms(i);
    }
    result.correlation.push_back(std::move(correlation));
  }
  return result;
}

// Experiments with all innovations of a step.
std::vector<Index> complete_rows(const Matrix& e) {
  std::vector<Index> rows;
  for (Index n = 0; n < e.rows(); ++n)
    if (e.row(n).allFinite()) rows.push_back(n);
  return rows;
}

}  // namespace

InputCorrelation input_correlation(const Innovations& innovations, const Ensemble& data, Index first, Index last,
                                   Pooling over) {
  if (first > last)
    throw std::invalid_argument(
        fmt::format("lags: {} to {} found, a last lag that is not below the first needed", first, last));
  check_innovations(innovations, data);
  const Index m = data.outputs(), r = data.inputs(), steps = data.steps();
  std::vector<LagSums> sums(size_t(last - first + 1), LagSums(m, r));
  std::vector<std::vector<Index>> rows;
  Index all = 0;
  for (const Matrix& e : innovations) {
    rows.push_back(complete_rows(e));
    all += Index(rows.back().size());
  }
  for (Index lag = first; lag <= last && over == Pooling::experiments; ++lag)
    for (Index k = std::max<Index>(0, lag); k < std::min(steps, steps + lag); ++k) {
      const std::vector<Index>& now = rows[size_t(k)];
      if (Index(now.size()) <= too_few(innovations)) continue;
      sums[size_t(lag - first)].add(unit_columns(innovations[size_t(k)](now, Eigen::all)),
                                    unit_inputs(data.input(k - lag)(now, Eigen::all)));
    }
  // All steps as one: the samples of all experiments below each other.
  for (Index lag = first; lag <= last && over == Pooling::time; ++lag) {
    Matrix e(all, m), u(all, r);
    Index at = 0;
    for (Index k = std::max<Index>(0, lag); k < std::min(steps, steps + lag); ++k)
      for (const Index n : rows[size_t(k)]) {
        e.row(at) = innovations[size_t(k)].row(n);
        u.row(at++) = data.input(k - lag).row(n);
      }
    if (at > too_few(innovations))
      sums[size_t(lag - first)].add(unit_columns(e.topRows(at)), unit_inputs(u.topRows(at)));
  }
  return result_of(sums, first, over);
}

}  // namespace tokid
