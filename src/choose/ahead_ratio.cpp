// SPDX-License-Identifier: BSD-3-Clause
#include "choose/ahead_ratio.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace tokid {

namespace {

// Outputs whose variance is a smaller share of their squared size are exact, and their errors are rounding errors.
constexpr double least_share = 1e-12;

// The variances (m) of the errors of y_k, predicted from step `begin` on, at which the state is known.
Vector variances(const Model& model, Index begin, Index k) {
  Matrix p = Matrix::Zero(model.n(begin), model.n(begin));
  for (Index j = begin; j < k; ++j) {
    const Step& step = model.at(j);
    p = step.A() * p * step.A().transpose() + step.G() * step.innovation_cov() * step.G().transpose();
  }
  const Step& last = model.at(k);
  return (last.C() * p * last.C().transpose() + last.innovation_cov()).diagonal();
}

}  // namespace

AheadErrors& AheadErrors::operator+=(const AheadErrors& other) {
  if (square.size() == 0) return *this = other;
  square += other.square;
  expected += other.expected;
  return *this;
}

double AheadErrors::ratio() const {
  double sum = 0.0;
  Index count = 0;
  for (Index j = 0; j < square.size(); ++j)
    if (square(j) > 0 && expected(j) > 0) sum += std::log(square(j) / expected(j)) / 2, ++count;
  return count > 0 ? std::exp(sum / double(count)) : std::numeric_limits<double>::quiet_NaN();
}

AheadErrors ahead_errors(const Model& model, const Ensemble& predicted, const Ensemble& measured, Index horizon,
                         Index first) {
  AheadErrors result{Vector::Zero(model.outputs), Vector::Zero(model.outputs)};
  const Index end = std::min(model.k_end(), measured.steps());
  for (Index k = std::max(first, model.k_begin) + horizon; k < end; ++k) {
    const Vector variance = variances(model, k - horizon + 1, k);
    for (Index j = 0; j < model.outputs; ++j) {
      const Eigen::ArrayXd y = measured.output(k).col(j), e = y - predicted.output(k).col(j).array();
      const double size = y.isFinite().select(y.square(), 0.0).maxCoeff();
      if (!(variance(j) > least_share * size)) continue;
      result.square(j) += e.isFinite().select(e.square(), 0.0).sum();
      result.expected(j) += double(e.isFinite().count()) * variance(j);
    }
  }
  return result;
}

}  // namespace tokid
