// The elimination of a random walk for many right-hand sides at once, one in each lane of the vector instructions.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/lane_memory.hpp"

namespace tokid::linalg {

// Minimises  Σ_g ‖R_g x_g - z_g‖² + Σ_g ‖S (x_{g+1} - x_g)‖²  for one z and one S = diag(stiffness) in each lane. The
// R_g (L × L, upper triangular) are the same in all lanes. Multiplications and additions are rounded one by one, so
// that every instruction set gives the same bits.
class LaneRandomWalk {
 public:
  LaneRandomWalk(Index steps, Index regressors);
  LaneRandomWalk(const LaneRandomWalk&) = delete;
  LaneRandomWalk& operator=(const LaneRandomWalk&) = delete;

  static Index lanes();  // number of right-hand sides in a batch

  double& r(Index g, Index i, Index j) { return triangles_[(g * l_ + j) * l_ + i]; }  // i ≤ j
  double& z(Index g, Index i, Index lane) { return value(g, i, l_ + 1, lane); }
  double& stiffness(Index i, Index lane) { return stiffness_[i * lanes_ + lane]; }  // positive in every lane

  // Eliminates x_0 … x_{G-2}. What is then known of the last x of a lane are the rows [R z] (L × (L+1)).
  void eliminate();
  Matrix last(Index lane);
  // Replaces each z_g by x_g. Before, z of the last step must have been replaced by its x.
  void substitute();

 private:
  double& value(Index g, Index i, Index j, Index lane) {
    return stored_[((g * (l_ + 2) + j) * l_ + i) * lanes_ + lane];
  }

  Index steps_, l_, lanes_;
  // Row i of a step (L × (L+2)) holds V in the columns 0 … i, U in the columns i+1 … L, and z in the column L+1. The
  // equations of a step are U x_g = z - V x_{g+1}.
  double *stored_ = nullptr, *stiffness_ = nullptr, *below_ = nullptr;
  LaneMemory memory_;
  std::vector<double> triangles_;
};

}  // namespace tokid::linalg
