// The correlation of each innovation with each input, lag by lag: a look at what independence() tests as a whole.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/innovations.hpp"

namespace tokid {

// The inputs are taken as given numbers, so they may have any correlation in time. A missing input counts as the mean
// of the inputs that are present, as in independence().
struct InputCorrelation {
  Index first = 0;  // lag of the first entry
  // (last - first + 1) of (m × r): correlation over the experiments of the innovation of an output at step k with an
  // input at step k - lag, mean over the steps. NaN if the input does not vary between the experiments.
  std::vector<Matrix> correlation;
  // (last - first + 1 × r): if innovations and inputs are independent, 99 % of the correlations are smaller in size
  Matrix bound;
  Pooling over = Pooling::none;
};
// `over`: that of independence(), so that both have the same samples; Pooling::none gives no correlations.
// \throws std::invalid_argument for first > last or numbers of experiments or steps that disagree
InputCorrelation input_correlation(const Innovations& innovations, const Ensemble& data, Index first, Index last,
                                   Pooling over);

}  // namespace tokid
