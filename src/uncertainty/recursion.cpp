// SPDX-License-Identifier: BSD-3-Clause
#include "uncertainty/recursion.hpp"

#include <algorithm>
#include <limits>

namespace tokid::uncertainty {

namespace {

// Rounding errors of simulated or stored outputs, relative to the outputs.
constexpr double rounding = 8 * std::numeric_limits<double>::epsilon();

}  // namespace

Index largest_lag_order(const GtvArx& arx) {
  Index lags = 0;
  for (const GtvArxStep& s : arx.step) lags = std::max(lags, s.lags);
  return lags;
}

Matrix innovation_cov(const GtvArx& arx, Index k) {
  Matrix cov = arx.residual_cov(k);
  cov.diagonal() = cov.diagonal().cwiseMax((rounding * arx.output_rms(k)).cwiseAbs2());
  return cov;
}

void run(const GtvArx& arx, Index begin, Index end, Rows& rows) {
  for (Index k = begin; k < end; ++k)
    output(arx, rows, k).noalias() = window(arx, rows, k) * arx.coefficients(k).transpose();
}

Vector leverages(const GtvArx& arx, Index k, const ConstMatrixRef& windows) {
  return (windows * arx.noise_shape(k)).rowwise().squaredNorm();
}

void run_backwards(const GtvArx& arx, Index begin, Index end, std::vector<Matrix>& weights) {
  const Index most = largest_lag_order(arx);
  for (Index s = end; s-- > begin;)
    for (Index j = 1; j <= std::min(most, end - 1 - s); ++j)
      if (j <= arx.step[size_t(s + j)].lags)
        weights[size_t(s - begin)].noalias() += arx.output_block(s + j, j).transpose() * weights[size_t(s + j - begin)];
}

}  // namespace tokid::uncertainty
