// Results of step-by-step regressions, over all steps or a stretch of them, and findings about them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/finding.hpp"
#include "tokid/gtv_arx.hpp"

namespace tokid {

struct RegressionSurvey {
  double condition_max = 0.0;
  Index rank_deficient = 0;
  std::vector<Index> ill, starved, unexcited;  // steps
  Index freedom = 0;
  double residual = 0.0, square = 0.0;  // sums over steps and outputs

  // Are the residuals larger than rounding errors?
  bool noisy() const;
  // Appends the survey of later steps. Step 0 of `later` is step `begin` of this survey.
  void append(const RegressionSurvey& later, Index begin);
};

// Surveys the steps begin … end-1. `nominal`: a mean motion was removed, which uses one degree of freedom at each step.
RegressionSurvey survey_of(const GtvArx& arx, bool nominal, Index begin, Index end);

// Steps whose regressions lack rank although they have enough experiments. The inputs of neighbouring steps and
// channels are linearly dependent there.
std::vector<Index> unexcited_steps(const Ensemble& data, const GtvArx& arx, bool nominal, Index begin, Index end);

// Sizes for the findings: N; N minus one if a mean motion is subtracted, because estimating it uses one degree of
// freedom; r, m, p.
struct RegressionSizes {
  Index experiments = 0, effective_experiments = 0, inputs = 0, outputs = 0, lags = 0;
  bool feedthrough = true;
};
Findings findings_of(const RegressionSurvey& survey, const RegressionSizes& sizes, bool noisy);

}  // namespace tokid
