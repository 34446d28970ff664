// Innovations of models that did not see the experiments → experiments with innovations that are too large.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/innovations.hpp"

namespace tokid {

// (N × m) The size of the innovations of each output of each experiment, as a multiple of the median over the
// experiments without 1 in `out` (N). The size is the mean of |ε| over the usual |ε| of its step, without the largest
// quarter, so that single wrong samples do not count. NaN with too few innovations. `folds`: > 0: the experiments n,
// n + folds, … are compared with each other only, because their innovations are those of another model.
struct Sizes {
  Matrix ratio;
  Matrix count;  // innovations of each output of each experiment
};
Sizes innovation_sizes(const Innovations& innovations, const std::vector<char>& out, Index folds = 0);

// (N × m) Sizes over their thresholds: an experiment with an entry above 1 does not fit. Among healthy experiments, one
// is above 1 in one ensemble of a thousand. `response`: (N × m) RMS of the simulated outputs. An experiment with larger
// outputs than the others may have larger innovations, because no model is exact.
Matrix misfit(const Sizes& sizes, const Matrix& response, const std::vector<char>& out);

// Does experiment n move the inputs of `lags` + 1 successive steps in a direction that no other experiment uses? If so,
// experiment n may reach states that the other experiments do not reach. `centred`: relative to the mean of the others.
bool excites_more(const Ensemble& ensemble, Index n, Index lags, bool centred);

}  // namespace tokid
