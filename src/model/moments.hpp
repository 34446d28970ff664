// What the smoother computes for the M-step of EM.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/matrix_list.hpp"

namespace tokid::kalman {

// Sums over the experiments of expected second moments, given all samples. z_k = [x_k; u_k].
struct Moments {
  linalg::MatrixList measured;  // (T) of [z_k; y_k], over the experiments with an output at step k
  linalg::MatrixList moved;     // (T) of [z_k; x_{k+1}], over the experiments that continue at step k+1
  Vector measured_count, moved_count;
  Vector x0;         // (n_0) sum of x_0
  Matrix x0_square;  // (n_0 × n_0) of x_0
  double x0_count = 0;
};

}  // namespace tokid::kalman
