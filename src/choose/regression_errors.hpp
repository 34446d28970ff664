// Experiments → the errors of coupled regressions on held-out experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "choose/held_out_error.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

class RegressionErrors {
 public:
  // Of the folds of the ensemble, `held_out` are held out. `horizons`: ascending, the first is 1. The options stay with
  // the caller.
  RegressionErrors(const Ensemble& ensemble, const SmoothingOptions& options, Index held_out,
                   std::vector<Index> horizons);

  struct Found {
    Index lags = 0;
    double smoothing = 0.0;  // infinite: one model for all steps
    Squares squares;         // of the predictions of the held-out experiments, joined()
    HeldOutError error;
  };
  Found found(Index lags, double smoothing, const std::vector<Index>& jumps = {}) const;

  const std::vector<Index>& horizons() const { return horizons_; }
  Index from() const { return from_; }  // first step of the predictions

 private:
  const SmoothingOptions& options_;
  Index from_;
  std::vector<Index> horizons_;
  Vector weights_;
  std::vector<Split> parts_;
};

}  // namespace tokid
