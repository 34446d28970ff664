// The elimination of many random walks at once, one in each lane of the vector instructions.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/lane_memory.hpp"

namespace tokid::linalg {

// Minimises  Σ_g ‖R_g x_g - z_g‖² + Σ_g ‖x_{g+1} - x_g‖²  for upper triangular R_g (L × L) and z_g of each lane.
class LaneRandomWalk {
 public:
  LaneRandomWalk(Index steps, Index regressors);
  LaneRandomWalk(const LaneRandomWalk&) = delete;
  LaneRandomWalk& operator=(const LaneRandomWalk&) = delete;

  static Index lanes();  // number of walks in a batch

  double& r(Index g, Index i, Index j, Index lane) { return value(g, i, j + 1, lane); }  // i ≤ j
  double& z(Index g, Index i, Index lane) { return value(g, i, l_ + 1, lane); }

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
  double *stored_ = nullptr, *below_ = nullptr;
  LaneMemory memory_;
};

}  // namespace tokid::linalg
