// The windows of many steps as one triangular factor, for models that all steps share.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/windows.hpp"

namespace tokid {

// Upper triangular R (≤ w × w, w = (p+1)·d) with RᵀR = Σ_k V_kᵀV_k, for the windows V_k = [v_{k-p} … v_k] of the steps
// begin … end-1. The same bits for any number of threads.
// Products of successive windows share all but one of their samples, so that T steps take T·p·d² operations instead of
// T·p²·d². Sums of products have half the digits of a factorisation. They are used if no sample is missing, if windows
// are many, and if their noise is far above rounding errors; otherwise the windows are factorised.
Matrix pooled_window_factor(const Windows& windows, Index lags, Index begin, Index end, const Execution& execution);

// Do regressions of one model use this factor? Those of a shorter record take little time with each window.
inline bool pools_windows(const Windows& windows, Index groups) {
  constexpr Index long_record = 512;
  return groups == 1 && windows.steps() > long_record;
}

// The number of experiments in the windows of each step begin … end-1.
std::vector<Index> window_counts(const Windows& windows, Index lags, Index begin, Index end);

}  // namespace tokid
