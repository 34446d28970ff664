// SPDX-License-Identifier: BSD-3-Clause
#include "choose/initial_state.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/rounding.hpp"
#include "base/statistics.hpp"

namespace tokid {

namespace {

constexpr double level = 0.001;  // false-alarm probability of the test, for all steps and outputs together

InitialStateTest stated(InitialState state, const char* reason) {
  InitialStateTest test;
  test.decision = state;
  test.reason = reason;
  return test;
}

}  // namespace

std::optional<InitialStateTest> stated_initial_state(const Ensemble& data, const IdentifyOptions& options) {
  if (options.initial_state) return stated(*options.initial_state, "as asked");
  if (data.initial_state) return stated(*data.initial_state, "as the data say");
  return std::nullopt;
}

InitialStateTest test_initial_state(const GtvArx& arx, Index p, const std::vector<Index>& freedom) {
  const Index m = arx.outputs, last = arx.steps();
  // Residual variances of the later steps, but at least the variances of rounding errors.
  Vector later = Vector::Zero(m), square = Vector::Zero(m);
  Index later_freedom = 0;
  for (Index k = p; k < std::min(last, p + std::max<Index>(10, 3 * p)); ++k) {
    later_freedom += freedom[size_t(k)];
    later += double(freedom[size_t(k)]) * arx.residual_cov(k).diagonal();
  }
  for (Index k = 0; k < last; ++k) square = square.cwiseMax(arx.output_rms(k).cwiseAbs2());
  if (later_freedom > 0) later /= double(later_freedom);
  later = later.cwiseMax(rounding_share * rounding_share * square);

  InitialStateTest test;
  test.threshold = std::numeric_limits<double>::infinity();
  for (Index k = 0; k < std::min(p, last); ++k) {
    const Index own = freedom[size_t(k)];
    if (own <= 0) continue;
    for (Index j = 0; j < m; ++j) {
      if (!(later(j) > 0)) continue;
      const double ratio = arx.residual_cov(k)(j, j) / later(j);
      const double threshold =
          later_freedom > 0 ? statistics::f_quantile(1 - level / double(p * m), double(own), double(later_freedom))
                            : 1.0;
      // The step and output with the largest ratio of statistic to threshold decide.
      if (std::isinf(test.threshold) || ratio / threshold > test.statistic / test.threshold) {
        test.statistic = ratio;
        test.threshold = threshold;
      }
    }
  }
  const bool reached = test.statistic > test.threshold;
  test.decision = reached ? InitialState::unknown : InitialState::zero;
  test.reason =
      later_freedom > 0
          ? fmt::format(
                "residual variance of the steps before {} is {:.3g} times that of the later steps, threshold {:.3g}", p,
                test.statistic, test.threshold)
      : reached
          ? "the first steps leave residuals, and without a degree of freedom noise can't be separated from initial states"
          : "the first steps leave no residual";
  return test;
}

}  // namespace tokid
