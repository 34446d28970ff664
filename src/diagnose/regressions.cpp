// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/regressions.hpp"

#include <fmt/format.h>

#include <algorithm>

#include "base/rounding.hpp"
#include "base/words.hpp"
#include "tokid/gtv_arx.hpp"

namespace tokid {

bool RegressionSurvey::noisy() const { return residual > rounding_share * rounding_share * square; }

void RegressionSurvey::append(const RegressionSurvey& later, Index begin) {
  condition_max = std::max(condition_max, later.condition_max);
  rank_deficient += later.rank_deficient;
  for (auto list : {&RegressionSurvey::ill, &RegressionSurvey::starved, &RegressionSurvey::unexcited})
    for (const Index k : later.*list) (this->*list).push_back(begin + k);
  freedom += later.freedom;
  residual += later.residual;
  square += later.square;
}

std::vector<std::string> warnings_of(const RegressionSurvey& survey, const RegressionSizes& sizes, bool noisy) {
  std::vector<std::string> result;
  const auto warn = [&](std::string text) { result.push_back(std::move(text)); };
  if (!survey.ill.empty())
    warn(fmt::format("ill-conditioned windows (condition above {:.0e}) at {}: expect few digits there", ill_conditioned,
                     words::step_list(survey.ill)));
  if (!survey.starved.empty())
    warn(
        fmt::format("missing samples leave fewer experiments than the {} unknowns at {}: the solution of smallest "
                    "norm stands in there",
                    sizes.inputs + sizes.lags * (sizes.inputs + sizes.outputs), words::step_list(survey.starved)));
  if (!survey.unexcited.empty())
    warn(fmt::format(
        "the inputs of neighbouring steps and channels are linearly dependent over the experiments at {}: their "
        "effects there can't be told apart",
        words::step_list(survey.unexcited)));
  const Index unknowns = minimum_experiments(sizes.inputs, sizes.outputs, sizes.lags);
  if (survey.freedom == 0)
    warn(fmt::format(
        "{} experiments leave no degree of freedom at lag order {}: the regressions fit any data exactly, and "
        "nothing shows how noisy they are; {} or more would tell",
        sizes.experiments, sizes.lags, 2 * unknowns));
  else if (noisy && sizes.effective_experiments < 2 * unknowns)
    warn(
        fmt::format("{} experiments are few for the {} unknowns per output and step at lag order {}: noise enters the "
                    "coefficients almost undamped; {} or more would be better, and {} carry lag orders up to {} at all",
                    sizes.experiments, unknowns, sizes.lags, 3 * unknowns, sizes.experiments,
                    largest_lag_order(sizes.effective_experiments, sizes.inputs, sizes.outputs)));
  return result;
}

}  // namespace tokid
