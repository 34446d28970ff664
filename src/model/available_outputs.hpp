// What the available outputs of a step tell of the missing ones, by the innovation covariance S of the step.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/step.hpp"

namespace tokid::observer {

// The memory is allocated once. All functions that follow allocate nothing.
class AvailableOutputs {
 public:
  using Row = Eigen::Ref<Eigen::RowVectorXd, 0, Eigen::InnerStride<>>;
  explicit AvailableOutputs(Index outputs);

  // Considers the innovations of a step, with NaN for missing outputs. Without innovation_cov, the covariance is not
  // known. After `same_step`, the factor of the last pattern of missing outputs may serve again.
  void consider(const Step& step, const Row& innovations, bool same_step);

  // Estimates missing innovations from the available ones of the same step: E[ε_q | ε_o] = S_qo S_oo⁻¹ ε_o, with q
  // missing and o available. This is necessary, because the gain may use several outputs to cancel their common noise.
  // If no covariance is known, or no output is available, missing innovations become zero.
  void fill_in(const Step& step, Row innovations);

  Index count() const { return Index(seen_.size()); }  // number of available outputs
  // ε_oᵀ S_oo⁻¹ ε_o, after consider(). NaN if no covariance is known, or no output is available.
  double square(const Row& innovations);

 private:
  void factorise(const Step::View& covariance);
  void whiten(const Row& innovations);  // z = L⁻¹ ε_o

  std::vector<Index> seen_, missing_, before_;
  bool known_ = false;
  Matrix lower_;      // L (seen × seen) in the upper left corner: the scaled S_oo is L Lᵀ
  Vector scale_, z_;  // (m)
};

}  // namespace tokid::observer
