// Ensemble → experiments that do not fit the model of the others, and possible explanations. Leave-one-out residuals at
// some of the steps show them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"
#include "tokid/model.hpp"
#include "tokid/outlier.hpp"

namespace tokid {

struct OutlierOptions {
  Index lags = 1;           // p
  bool nominal = false;     // a mean motion is removed: the regressions have a constant
  bool zero_start = false;  // the states at the first step are zero
  int threads = 1;
  Index period = 0;              // P: 1 where one model serves all steps
  const Model* model = nullptr;  // of all experiments; it can overrule flags of regressions with one lag
};

// Returns outliers, the largest first. It returns none for fewer than five experiments, or three where one model serves
// all steps: so few cannot show which one is wrong.
std::vector<Outlier> outliers(const Ensemble& ensemble, const OutlierOptions& options);

// Finds one wrong experiment in data without noise. There, regressions with many lags also fit a wrong experiment,
// through states of its own. Without the one found, some lag order explains all others exactly, but not with it. If
// experiments begin at rest, windows from the first step are examined too. If several are wrong, none is found.
std::vector<Outlier> outliers_without_noise(const Ensemble& ensemble, const OutlierOptions& options);

// `reported`: experiments that are already reported; they are left out.
Findings findings_of(std::vector<Outlier> outliers, const std::vector<Index>& reported = {});

}  // namespace tokid
