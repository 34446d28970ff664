// SPDX-License-Identifier: BSD-3-Clause
#include "model/available_outputs.hpp"

#include <cmath>
#include <limits>

#include "base/nan.hpp"

namespace tokid::observer {

AvailableOutputs::AvailableOutputs(Index outputs) : lower_(outputs, outputs), scale_(outputs), z_(outputs) {
  for (std::vector<Index>* list : {&seen_, &missing_, &before_}) list->reserve(size_t(outputs));
}

void AvailableOutputs::consider(const Step& step, const Row& innovations, bool same_step) {
  seen_.clear();
  missing_.clear();
  for (Index j = 0; j < innovations.size(); ++j) (std::isnan(innovations(j)) ? missing_ : seen_).push_back(j);
  if (same_step && known_ && missing_ == before_) return;
  known_ = step.has_innovation_cov() && !seen_.empty();
  if (!known_) return;
  factorise(step.innovation_cov());
  before_ = missing_;
}

// As linalg::whitener: outputs are scaled to equal variance, and the size of rounding errors is added to the diagonal.
void AvailableOutputs::factorise(const Step::View& covariance) {
  constexpr double least = std::numeric_limits<double>::min();
  const Index size = count();
  for (Index i = 0; i < size; ++i) {
    const double variance = covariance(seen_[size_t(i)], seen_[size_t(i)]);
    scale_(i) = variance > least ? 1 / std::sqrt(variance) : 0.0;
  }
  auto lower = lower_.topLeftCorner(size, size);
  for (Index j = 0; j < size; ++j)
    for (Index i = j; i < size; ++i) {
      double sum = scale_(i) * covariance(seen_[size_t(i)], seen_[size_t(j)]) * scale_(j);
      if (i == j) sum += std::numeric_limits<double>::epsilon() * double(size);
      for (Index k = 0; k < j; ++k) sum -= lower(i, k) * lower(j, k);
      if (i == j && !(sum > 0)) {  // not a covariance: the outputs count as independent
        lower.setIdentity();
        return;
      }
      lower(i, j) = i == j ? std::sqrt(sum) : sum / lower(j, j);
    }
}

void AvailableOutputs::whiten(const Row& innovations) {
  for (Index i = 0; i < count(); ++i) {
    double sum = scale_(i) * innovations(seen_[size_t(i)]);
    for (Index k = 0; k < i; ++k) sum -= lower_(i, k) * z_(k);
    z_(i) = sum / lower_(i, i);
  }
}

void AvailableOutputs::fill_in(const Step& step, Row innovations) {
  if (!known_) {
    for (const Index j : missing_) innovations(j) = 0.0;
    return;
  }
  whiten(innovations);
  for (Index i = count(); i-- > 0;) {
    double sum = z_(i);
    for (Index k = i + 1; k < count(); ++k) sum -= lower_(k, i) * z_(k);
    z_(i) = sum / lower_(i, i);
  }
  const Step::View covariance = step.innovation_cov();
  for (const Index j : missing_) {
    double sum = 0.0;
    for (Index i = 0; i < count(); ++i) sum += covariance(j, seen_[size_t(i)]) * scale_(i) * z_(i);
    innovations(j) = sum;
  }
}

double AvailableOutputs::square(const Row& innovations) {
  if (!known_) return nan;
  whiten(innovations);
  return z_.head(count()).squaredNorm();
}

}  // namespace tokid::observer
