// Experiments → the errors of coupled regressions on held-out experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "choose/held_out_error.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

class RegressionErrors {
 public:
  // Of the folds of the ensemble, `held_out` are held out. `horizons`: as in Ahead; those beyond half of the steps are
  // left out. `folds`: their number; 0: fold_count(). The options stay with the caller.
  RegressionErrors(const Ensemble& ensemble, const SmoothingOptions& options, Index held_out,
                   std::vector<Index> horizons, Index folds = 0);

  // Of the predictions of the experiments that the folds begin … end-1 hold out. `smoothing`: infinite for one model
  // for all steps
  std::vector<Squares> squares(Index begin, Index end, Index lags, double smoothing,
                               const std::vector<Index>& jumps = {}) const;
  HeldOutError error_of(const std::vector<Squares>& folds) const;
  HeldOutErrors at_horizons(const Squares& all) const { return errors_at_horizons(all, weights_); }

  struct Found {
    Index lags = 0;
    double smoothing = 0.0;
    std::vector<Index> jumps = {};
    Squares squares = {};  // of all folds
    HeldOutError error = {};
  };
  Found found(Index lags, double smoothing, const std::vector<Index>& jumps = {}) const;
  // `folds`: squares() of these
  Found found(const std::vector<Squares>& folds, Index lags, double smoothing,
              const std::vector<Index>& jumps = {}) const;

  Index folds() const { return Index(parts_.size()); }  // that are held out
  const Ahead& ahead() const { return ahead_; }

 private:
  const SmoothingOptions& options_;
  Ahead ahead_;
  Vector weights_;
  std::vector<Split> parts_;
};

}  // namespace tokid
