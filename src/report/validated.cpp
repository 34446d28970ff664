// SPDX-License-Identifier: BSD-3-Clause
#include "report/validated.hpp"

#include <utility>

#include "model/comparison.hpp"
#include "model/outlying_samples.hpp"
#include "report/evidence.hpp"
#include "report/origin.hpp"
#include "tokid/copies.hpp"

namespace tokid::report {

Validated validated(const Model& model, const Ensemble& data, Index horizon, const ReportOptions& options) {
  data.check(false);  // messages then name the caller's rows, not those of the part
  const UsedExperiments used = used_experiments(data);
  const Tested tested = report::tested(model, data, used, options);
  const ValidateOptions deciding = validate_options(tested);
  ValidateOptions asked = deciding;
  asked.horizon = horizon;

  Validated result;
  result.rows = used.rows;
  result.seen = tested.options.evaluation == Evaluation::training;
  const auto take = [&](const Comparison& compared, const Tested& distinct) {
    result.validation = compared.validation;
    result.validation.outlying = distinct.in_given_data(std::move(result.validation.outlying));
    Findings findings = findings_of(used, data);
    append(findings, std::move(result.validation.findings));
    append(findings, findings_of(result.validation.outlying, data.names));
    result.validation.findings = std::move(findings);
    result.fits = compared.experiments;
  };
  Comparison compared;
  if (tested.distinct) {
    compared = compare(model, tested.data, asked);
    take(compared, tested);
    if (horizon != deciding.horizon) compared.validation.horizon = horizon_fit(model, tested.data, deciding);
  } else {
    const Tested distinct = tested_part(data, data.subset(used.rows), used.rows, options);
    take(compare(model, distinct.data, asked), distinct);
    compared = compare(model, tested.data, deciding);
  }
  result.verdict = verdict_of(model, evidence(model, tested, std::move(compared)), tested.options);
  return result;
}

}  // namespace tokid::report
