// Ensemble → experiments that do not obey the model of the others, by leave-one-out residuals at some of the steps, and
// what would explain them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"
#include "tokid/model.hpp"
#include "tokid/outlier.hpp"

namespace tokid {

struct OutlierOptions {
  Index lags = 1;        // p
  bool nominal = false;  // a mean motion is removed: the regressions have a constant
  bool at_rest = false;  // at the first step
  int threads = 1;
  Index period = 0;              // P: 1 where one model serves all steps
  const Model* model = nullptr;  // of all experiments, which acquits whom regressions of one lag alone accuse
};

// Those that stand out, the largest first. None of fewer than five experiments, three where one model serves all steps:
// they do not tell who is right.
std::vector<Outlier> outliers(const Ensemble& ensemble, const OutlierOptions& options);

// Without noise a wrong experiment obeys the regressions of so many lags as all others do: by states of its own. The
// one without which so many lags or fewer, or windows from rest where experiments begin there, explain all others to
// their last digits, but not with it; none of several.
std::vector<Outlier> outliers_without_noise(const Ensemble& ensemble, const OutlierOptions& options);

// Without the experiments of which enough is said already.
Findings findings_of(std::vector<Outlier> outliers, const std::vector<Index>& told = {});

}  // namespace tokid
