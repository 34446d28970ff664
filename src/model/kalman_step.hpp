// One step of the Kalman filter. l (q) is the state of a step, with everything else of that step that affects the next
// state. That is missing inputs, or the innovations of the model. The step goes from the covariance P before the
// outputs y = H l + v are known to that of the next state x⁺ = F l + w:
//   S = H P Hᵀ + R,   K = P Hᵀ S⁻¹,   P' = (I - K H) P (I - K H)ᵀ + K R Kᵀ,   P⁺ = F P' Fᵀ + Q
// There are two forms. With covariances a step takes 0.7 µs for n = 4 and m = 2, and 20 µs for n = 20 and m = 6; with
// roots it takes 3.7 and 34 µs. EM uses covariances, because it repeats the step for every pattern of missing samples
// in every iteration. It can do so because its floors keep the noise away from zero. With roots, rounding errors cost
// half as many digits. Suppose that outputs determine an unknown state to 10⁻⁸ of its size: P is then accurate to 10⁻⁸
// with roots, and wrong with covariances (tests/kalman_step_test.cpp).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid::kalman {

// result = F P Fᵀ + Q (p × p), exactly symmetric, with fp = F P (p × q). It gives P⁺ from P', and S from P.
void propagate(const Matrix& p, const Matrix& f, const ConstMatrixRef& q, Matrix& fp, Matrix& result);

struct Correction {
  Matrix gain;           // K (q × m)
  Matrix whitener;       // W (m × m) with W S Wᵀ = I; rows without variance are zero
  double log_det = 0.0;  // of S
  Matrix filtered;       // P' (q × q)
};

// Intermediate results of a correction, kept to reuse their memory.
struct Workspace {
  Matrix hp;          // H P (m × q)
  Matrix innovation;  // S (m × m)
  Matrix whp, left, product;
};

// Computes a correction from P (q × q), H (m × q), R (m × m). P' has Joseph's form, above: a sum of squares stays
// positive semidefinite.
void correct(const Matrix& p, const Matrix& h, const Matrix& r, Workspace& work, Correction& c);

// Calls body(j) for every output that is not in `there`.
template <class Body>
void each_missing(const std::vector<Index>& there, Index outputs, Body&& body) {
  auto next = there.begin();
  for (Index j = 0; j < outputs; ++j)
    if (next != there.end() && *next == j)
      ++next;
    else
      body(j);
}

// Gives a missing output an independent innovation of zero with variance one. The sizes are then the same for all
// patterns.
void leave_out_missing(const std::vector<Index>& there, Matrix& h, Matrix& r);

// The same with roots, P = rootᵀ·root: rounding errors then cost half as many digits. Rows are independent sources of
// variance 1. `seen` (rows × m) is their effect on the outputs, a root of S. `rest` (rows × p) is their effect on l, or
// on F l. \return K (p × m) of the best prediction of l or F l by the outputs, min ‖seen·Kᵀ - rest‖, with the smallest
// norm if outputs have no noise of their own. `rest` becomes the remaining part, a root of P', or of F P' Fᵀ.
Matrix prediction_gain(const Matrix& seen, Matrix& rest);

// The root of P⁺ (up to n rows), from the remaining part of F l and a root of Q (any rows × n).
Matrix next_root(const Matrix& rest, const Matrix& noise);

// rootᵀ·root, exactly symmetric.
Matrix covariance_of(const Matrix& root);

}  // namespace tokid::kalman
