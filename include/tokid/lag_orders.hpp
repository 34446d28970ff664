// Ensemble → the lag order p of noise-free data, by leave-one-out errors.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

// Exact leave-one-out one-step errors for the lag orders 1 … p_max. The columns of the regression are ordered from the
// newest lag to the oldest. The leading columns of one QR factorisation therefore give the results for all orders.
struct LagOrderErrors {
  std::vector<Index> steps;  // the examined steps: at most `LagOrderOptions::steps`, evenly spaced
  Matrix error;  // (steps × p_max): (weighted) mean over outputs of log( leave-one-out mean square / mean square of y )
  Vector mean;   // (p_max): column means of `error`
  Index best = 1;  // the smallest p whose mean is within one standard error of the smallest mean
};
struct LagOrderOptions {
  Index p_max = 8;
  Index p_min = 1;
  Index steps = 64;
  bool feedthrough = true;     // as in GtvArxOptions
  Vector output_weights = {};  // (m) weights of the outputs, 0 or more; empty: all outputs count alike
  // Relative errors below this value count as zero, so that noise-free data give the smallest p with zero error.
  double exact = 1e-10;
  Execution execution = {};
};
LagOrderErrors lag_order_errors(const Ensemble& ensemble, const LagOrderOptions& options = {});

}  // namespace tokid
