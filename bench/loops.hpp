// The regressions (19) step by step, as one writes them with a library: what tokid's are measured against. Plain
// pointers at the border, because one of the loops is compiled for another instruction set.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>

struct Windows {
  const double* samples;  // (N × T·d) by columns, as Ensemble::samples()
  std::ptrdiff_t experiments, inputs, outputs, lags;
};

// Steps begin … end-1, k ≥ p. Of each: M_kᵀ (L × m), and below it the residual sums of squares, by columns; the
// matrices (L+1 × m) of successive steps follow each other. Needs N > L and windows of full rank.
using Loop = void(const Windows& windows, std::ptrdiff_t begin, std::ptrdiff_t end, double* results);

[[gnu::visibility("default")]] Loop eigen_loop;         // HouseholderQR, compiled as tokid is
[[gnu::visibility("default")]] Loop eigen_native_loop;  // the same, compiled with -march=native
Loop dgels_loop;                                        // LAPACK's dgels
