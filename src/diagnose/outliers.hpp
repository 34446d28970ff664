// Ensemble → experiments that do not fit the model of the others, and possible explanations. Outliers are found by
// their leave-one-out residuals at some of the steps.
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
  const Model* model = nullptr;  // model of all experiments; can clear outliers that only regressions with one lag find
};

// Least number of experiments that show which one is wrong: five, or three if one model serves all steps.
Index fewest_experiments(const OutlierOptions& options);

// Returns outliers, the largest first. Returns none for fewer than fewest_experiments().
std::vector<Outlier> outliers(const Ensemble& ensemble, const OutlierOptions& options);

// Finds one wrong experiment in data without noise. At some lag order, a regression fits all other experiments exactly,
// but not together with the wrong experiment. Regressions with more lags would also fit the wrong experiment, by
// additional states. If experiments begin at rest, windows from the first step are examined too. If several experiments
// are wrong, none is found.
std::vector<Outlier> outliers_without_noise(const Ensemble& ensemble, const OutlierOptions& options);

// Searches for explanations of these outliers. `wrong`: all experiments that do not fit (rows).
void explain(std::vector<Outlier>& outliers, const Ensemble& ensemble, const OutlierOptions& options,
             const std::vector<Index>& wrong);

// `reported`: experiments that are already reported; they are left out, unless they were dropped or downweighted.
Findings findings_of(std::vector<Outlier> outliers, const std::vector<Index>& reported = {});

}  // namespace tokid
