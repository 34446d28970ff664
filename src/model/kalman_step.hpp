// One step of the Kalman filter. l (q) is the state of a step and whatever else of that step the next state depends on:
// inputs that are missing, or the innovations of the model. From its covariance P before the outputs y = H l + v of the
// step are known, to that of the next state x⁺ = F l + w:
//   S = H P Hᵀ + R,   K = P Hᵀ S⁻¹,   P' = (I - K H) P (I - K H)ᵀ + K R Kᵀ,   P⁺ = F P' Fᵀ + Q
// in two forms. By covariances it takes 0.7 µs for n = 4 and m = 2, 20 µs for n = 20 and m = 6; by roots 3.7 and 34 µs:
// EM, which repeats it for every pattern of missing samples in every iteration, has the covariances, from noise that
// its floors keep away from zero. By roots rounding errors take half as many digits: where outputs tell an unknown
// state to 10⁻⁸ of what it was, P is right to 10⁻⁸, and by covariances not at all (tests/kalman_step_test.cpp).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid::kalman {

// result = F P Fᵀ + Q (p × p), symmetric to the last bit, and fp = F P (p × q) on the way: P⁺ from P', and S from P.
void propagate(const Matrix& p, const Matrix& f, const ConstMatrixRef& q, Matrix& fp, Matrix& result);

struct Correction {
  Matrix gain;           // K (q × m)
  Matrix whitener;       // W (m × m) with W S Wᵀ = I; rows of zeros for what has no variance
  double log_det = 0.0;  // of S
  Matrix filtered;       // P' (q × q)
};

// What a correction is made of, kept for its memory.
struct Workspace {
  Matrix hp;          // H P (m × q)
  Matrix innovation;  // S (m × m)
  Matrix whp, left, product;
};

// P (q × q), H (m × q), R (m × m). Joseph's form of P', above: a sum of squares stays positive semidefinite.
void correct(const Matrix& p, const Matrix& h, const Matrix& r, Workspace& work, Correction& c);

// body(j) for every output that is not among those that are there.
template <class Body>
void each_missing(const std::vector<Index>& there, Index outputs, Body&& body) {
  auto next = there.begin();
  for (Index j = 0; j < outputs; ++j)
    if (next != there.end() && *next == j)
      ++next;
    else
      body(j);
}

// An output that is missing has an innovation of zero and of variance one that depends on nothing: sizes are the same
// for all patterns.
void leave_out_missing(const std::vector<Index>& there, Matrix& h, Matrix& r);

// The same in roots, P = rootᵀ·root, of which rounding errors take half as many digits. Rows are independent sources of
// variance 1: `seen` (rows × m) is what they do to the outputs, a root of S, and `rest` (rows × p) what they do to l,
// or to F l. \return K (p × m) of the best prediction of these by the outputs, min ‖seen·Kᵀ - rest‖, of smallest norm
// where outputs have no noise of their own; `rest` keeps what is left, a root of P', or of F P' Fᵀ.
Matrix prediction_gain(const Matrix& seen, Matrix& rest);

// The root of P⁺ (up to n rows), from what is left of F l and a root of Q (any rows × n).
Matrix next_root(const Matrix& rest, const Matrix& noise);

// rootᵀ·root, symmetric to the last bit.
Matrix covariance_of(const Matrix& root);

}  // namespace tokid::kalman
