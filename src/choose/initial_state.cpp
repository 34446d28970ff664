// SPDX-License-Identifier: BSD-3-Clause
#include "choose/initial_state.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/rounding.hpp"
#include "base/statistics.hpp"
#include "tokid/smooth_arx.hpp"

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

StepErrors residuals_of(const GtvArx& arx) {
  StepErrors result{Matrix::Zero(arx.steps(), arx.outputs), {}, Vector::Zero(arx.outputs)};
  for (Index k = 0; k < arx.steps(); ++k) {
    result.output_square = result.output_square.cwiseMax(arx.output_rms(k).cwiseAbs2());
    result.variance.row(k) = arx.residual_cov(k).diagonal();
    result.freedom.push_back(arx.step[size_t(k)].freedom);
  }
  return result;
}

StepErrors held_out_errors(const Ensemble& data, const SmoothArxOptions& options, bool centred) {
  const Index folds = fold_count(data.experiments()), m = data.outputs(), d = data.channels();
  StepErrors result{Matrix::Zero(data.steps(), m), std::vector<Index>(size_t(data.steps())), Vector::Zero(m)};
  std::vector<StepErrors> of_folds(size_t(folds), result);
  SmoothArxOptions o = options;
  o.execution = {};
  parallel_for(0, folds, options.execution, [&](Index begin, Index end) {
    for (Index f = begin; f < end; ++f) {
      const Split parts = fold(data, f, folds, centred);
      const GtvArx arx = smooth_arx(parts.training, o);
      StepErrors& own = of_folds[size_t(f)];
      const Index groups = o.variation.groups(arx.steps()),
                  windows = parts.training.experiments() * (arx.steps() / groups);
      for (Index k = 0; k < arx.steps(); ++k) {
        // Regressions of about as many unknowns as windows have large errors for any initial state.
        if (k > 0 && k < o.lags && o.variation.smoothing < 1 && 2 * arx.regressors(k) > windows) continue;
        const Matrix samples =
                         parts.held_out.samples().middleCols((k - arx.step[size_t(k)].lags) * d, arx.regressors(k)),
                     errors = parts.held_out.output(k) - samples * arx.coefficients(k).transpose();
        for (Index n = 0; n < errors.rows(); ++n)
          if (errors.row(n).allFinite()) own.variance.row(k) += errors.row(n).cwiseAbs2(), ++own.freedom[size_t(k)];
      }
    }
  });
  for (const StepErrors& own : of_folds) {
    result.variance += own.variance;
    for (size_t k = 0; k < own.freedom.size(); ++k) result.freedom[k] += own.freedom[k];
  }
  for (Index k = 0; k < data.steps(); ++k) {
    result.variance.row(k) /= std::max(1.0, double(result.freedom[size_t(k)]));
    const Eigen::ArrayXXd y = data.output(k), present = y.isFinite().cast<double>();
    const Eigen::ArrayXXd squares = (present > 0).select(y.square(), 0.0);
    const Eigen::ArrayXd mean = squares.colwise().sum() / present.colwise().sum().max(1.0);
    result.output_square = result.output_square.cwiseMax(mean.matrix());
  }
  return result;
}

InitialStateTest test_initial_state(const StepErrors& errors, Index p) {
  const Index m = errors.variance.cols(), last = errors.variance.rows();
  // Variances of the later steps, but at least the variances of rounding errors.
  Vector later = Vector::Zero(m);
  Index later_freedom = 0;
  for (Index k = p; k < std::min(last, p + std::max<Index>(10, 3 * p)); ++k) {
    later_freedom += errors.freedom[size_t(k)];
    later += double(errors.freedom[size_t(k)]) * errors.variance.row(k).transpose();
  }
  if (later_freedom > 0) later /= double(later_freedom);
  later = later.cwiseMax(rounding_share * rounding_share * errors.output_square);

  InitialStateTest test;
  test.threshold = std::numeric_limits<double>::infinity();
  for (Index k = 0; k < std::min(p, last); ++k) {
    const Index own = errors.freedom[size_t(k)];
    if (own <= 0) continue;
    for (Index j = 0; j < m; ++j) {
      if (!(later(j) > 0)) continue;
      const double ratio = errors.variance(k, j) / later(j);
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
                "error variance of the steps before {} is {:.3g} times that of the later steps, threshold {:.3g}", p,
                test.statistic, test.threshold)
      : reached
          ? "the first steps leave residuals, and without a degree of freedom noise can't be separated from initial states"
          : "the first steps leave no residual";
  return test;
}

}  // namespace tokid
