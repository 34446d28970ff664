// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/regressions.hpp"

#include <algorithm>

#include "base/rounding.hpp"
#include "tokid/linalg.hpp"

namespace tokid {

namespace {

// Are there fewer experiments than unknowns?
bool is_starved(const GtvArx& arx, bool nominal, Index k) {
  return arx.step[size_t(k)].rows - (nominal ? 1 : 0) < arx.regressors(k);
}

// Are the inputs of the steps k-p … k, or without feedthrough k-p … k-1, linearly dependent over the experiments?
// Inputs that are zero do not count.
bool inputs_dependent(const Ensemble& e, Index k, Index p, bool feedthrough) {
  const std::vector<Index> rows = e.complete_rows(k, p);
  Matrix inputs(static_cast<Index>(rows.size()), (p + 1) * e.inputs());
  Index used = 0;
  for (Index j = k - p; j < k + (feedthrough ? 1 : 0); ++j)
    for (Index i = 0; i < e.inputs(); ++i) {
      const Vector u = e.input(j).col(i)(rows);
      if (u.norm() > 0) inputs.col(used++) = u / u.norm();
    }
  if (inputs.rows() < used) return false;  // steps with too few experiments are in `starved`
  const Matrix zero = Matrix::Zero(inputs.rows(), 1);
  return linalg::minimum_norm(inputs.leftCols(used), zero, 1e-12).rank < used;
}

}  // namespace

RegressionSurvey survey_of(const GtvArx& arx, bool nominal, Index begin, Index end) {
  RegressionSurvey survey;
  for (Index k = std::max(begin, arx.k_begin); k < end; ++k) {
    const GtvArxStep& step = arx.step[size_t(k)];
    survey.condition_max = std::max(survey.condition_max, step.condition);
    if (step.rank < arx.regressors(k)) ++survey.rank_deficient;
    if (step.condition > ill_conditioned) survey.ill.push_back(k);
    if (is_starved(arx, nominal, k)) survey.starved.push_back(k);
    survey.freedom += step.freedom;
    survey.residual += arx.residual_cov(k).trace();
    survey.square += arx.output_rms(k).squaredNorm();
  }
  return survey;
}

std::vector<Index> unexcited_steps(const Ensemble& data, const GtvArx& arx, bool nominal, Index begin, Index end) {
  std::vector<Index> result;
  for (Index k = std::max(begin, arx.k_begin); k < end; ++k) {
    const GtvArxStep& step = arx.step[size_t(k)];
    if (!is_starved(arx, nominal, k) && step.rank < arx.regressors(k) &&
        inputs_dependent(data, k, step.lags, arx.feedthrough))
      result.push_back(k);
  }
  return result;
}

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

Findings findings_of(const RegressionSurvey& survey, const RegressionSizes& sizes, bool noisy) {
  const Index unknowns = minimum_experiments(sizes.inputs, sizes.outputs, sizes.lags, sizes.feedthrough);
  const double L = double(unknowns), experiments = double(sizes.experiments), lags = double(sizes.lags);
  Findings result;
  if (!survey.ill.empty())
    result.push_back(
        {.kind = Finding::Kind::ill_conditioned, .steps = survey.ill, .numbers = {{"condition", ill_conditioned}}});
  if (!survey.starved.empty())
    result.push_back({.kind = Finding::Kind::too_few_complete, .steps = survey.starved, .numbers = {{"unknowns", L}}});
  if (!survey.unexcited.empty()) result.push_back({.kind = Finding::Kind::inputs_unexcited, .steps = survey.unexcited});
  if (survey.freedom == 0)
    result.push_back({.kind = Finding::Kind::no_freedom,
                      .numbers = {{"experiments", experiments}, {"lags", lags}, {"sufficient", 2 * L}}});
  else if (noisy && sizes.effective_experiments < 2 * unknowns)
    result.push_back({.kind = Finding::Kind::few_experiments,
                      .numbers = {{"experiments", experiments},
                                  {"unknowns", L},
                                  {"lags", lags},
                                  {"sufficient", 3 * L},
                                  {"largest_lags", double(largest_lag_order(sizes.effective_experiments, sizes.inputs,
                                                                            sizes.outputs, sizes.feedthrough))}}});
  return result;
}

}  // namespace tokid
