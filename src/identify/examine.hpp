// Ensemble, model and plan → experiments that do not fit; and what is done about them and about single samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/corrections.hpp"
#include "tokid/outlier.hpp"
#include "tokid/plan.hpp"
#include "tokid/validate.hpp"

namespace tokid {

struct Examined {
  std::vector<Outlier> outliers;  // with their rows in `used`, the largest ratio first
  // Rows of further experiments with larger innovations than the others, if they are too many to be called outliers.
  std::vector<Index> unnamed = {};
};

// The experiments that do not fit, by the innovations of models that did not see them (misfits.hpp).
Examined examined(const Ensemble& used, const Model& model, const Plan& plan, const Execution& execution);

// What was found and corrected so far. Rows are those of all measured experiments.
struct Treatment {
  Corrections corrections;
  std::vector<Outlier> outliers;
  std::vector<OutlyingSamples> samples;

  // Is this experiment in `outliers`?
  bool knows(const Ensemble& measured, Index experiment) const;
};

// What an identification has found; `model` is its model.
struct Found {
  const Model& model;
  const std::vector<Outlier>& outliers;
  const std::vector<OutlyingSamples>& samples;
};

// Adds what is newly found, at most a quarter of the experiments in total. Returns false if there is nothing new.
// `choice`: drop or downweight.
bool treat(const Ensemble& measured, const Found& found, OutlierChoice choice, Treatment& treatment);

// `reported`: experiments that are already reported; they are left out, unless they were dropped or downweighted.
Findings findings_of(std::vector<Outlier> outliers, const std::vector<Index>& reported = {});
// The finding about experiments that `treat` does not correct because they are too many. Empty if there are none.
Findings findings_of_untreated(const std::vector<Outlier>& outliers, Index experiments);

}  // namespace tokid
