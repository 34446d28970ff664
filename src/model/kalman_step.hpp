// One step of the Kalman filter. The vector l (q entries) contains the state of a step, and everything else of this
// step that affects the next state: missing inputs, or the innovations of the model. P is the covariance of l before
// the outputs y = H l + v are known. P⁺ is the covariance of the next state x⁺ = F l + w. R and Q are the covariances
// of v and w.
// S = H P Hᵀ + R, K = P Hᵀ S⁻¹, P' = (I - K H) P (I - K H)ᵀ + K R Kᵀ, P⁺ = F P' Fᵀ + Q
// A step can use covariances, or their roots. With covariances it takes 0.7 µs for n = 4 and m = 2, and 20 µs for n =
// 20 and m = 6. With roots it takes 3.7 and 34 µs. EM uses covariances, because it repeats the step for every pattern
// of missing samples in every iteration. This is safe, because the floors of EM keep the noise away from zero. With
// roots, rounding errors cost half as many digits. For example, let outputs determine an unknown state to 10⁻⁸ of its
// size. With roots, P is then accurate to 10⁻⁸. With covariances, P is wrong (tests/kalman_step_test.cpp).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid::kalman {

// result = F P Fᵀ + Q (p × p), exactly symmetric, with fp = F P (p × q). This computes P⁺ from P', and S from P.
void propagate(const Matrix& p, const Matrix& f, const ConstMatrixRef& q, Matrix& fp, Matrix& result);

struct Correction {
  Matrix gain;           // K (q × m)
  Matrix whitener;       // W (m × m) with W S Wᵀ = I; zero rows for directions without variance
  double log_det = 0.0;  // of S
  Matrix filtered;       // P' (q × q)
};
template <class Archive, class C>
requires std::is_same_v<std::remove_const_t<C>, Correction>
void fields(Archive& archive, C& c) { archive(c.gain, c.whitener, c.log_det, c.filtered); }

// Intermediate results of a correction, kept to reuse their memory.
struct Workspace {
  Matrix hp;          // H P (m × q)
  Matrix innovation;  // S (m × m)
  Matrix whp, left, product, noise;
};

// Computes a correction from P (q × q), H (m × q), R (m × m). P' is computed in Joseph's form (above), a sum of
// squares, so that it stays positive semidefinite.
void correct(const Matrix& p, const Matrix& h, const Matrix& r, Workspace& work, Correction& c);

// Calls body(j) for every output that is not in `there`, the list of available outputs.
template <class Body>
void each_missing(const std::vector<Index>& there, Index outputs, Body&& body) {
  auto next = there.begin();
  for (Index j = 0; j < outputs; ++j)
    if (next != there.end() && *next == j)
      ++next;
    else
      body(j);
}

// Gives a missing output an independent innovation of zero with variance one. The matrices thus have the same sizes for
// all patterns of missing outputs.
void leave_out_missing(const std::vector<Index>& there, Matrix& h, Matrix& r);

// The correction with roots, P = rootᵀ·root, in which rounding errors cost half as many digits. Rows are independent
// sources of variance 1. `seen` (rows × m) is the effect of the sources on the outputs, a root of S. `rest` (rows × p)
// is their effect on l, or on F l.
// \return K (p × m) of the best prediction of l or F l by the outputs, min ‖seen·Kᵀ - rest‖. If outputs have no noise
// of their own, K has the smallest norm. `rest` becomes the part that is not predicted, a root of P' or of F P' Fᵀ.
Matrix prediction_gain(const Matrix& seen, Matrix& rest);

// The root of P⁺ (up to n rows), from the part of F l that is not predicted and a root of Q (any rows × n).
Matrix next_root(const Matrix& rest, const Matrix& noise);

// rootᵀ·root, exactly symmetric.
Matrix covariance_of(const Matrix& root);

}  // namespace tokid::kalman
