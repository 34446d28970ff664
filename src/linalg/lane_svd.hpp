// Singular values and left singular vectors of many small matrices at once, one in each lane of the vector
// instructions.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/lane_memory.hpp"

namespace tokid::linalg {

// A = U Σ Vᵀ of matrices of one shape: Aᵀ = Q Lᵀ by Householder reflections, then L J = U Σ by rotations of pairs of
// columns (one-sided Jacobi), each to the last digit that it has, however small it is. What a lane gets does not depend
// on the other ones.
class LaneSvd {
 public:
  LaneSvd(Index rows, Index cols);
  LaneSvd(const LaneSvd&) = delete;
  LaneSvd& operator=(const LaneSvd&) = delete;

  static Index lanes();  // matrices of a batch
  // Beyond, matrices of all lanes together leave the caches.
  static Index most_rows();

  // Entry (i, j) of matrix l of the next batch; every entry has to be set before each run.
  double& entry(Index l, Index i, Index j) { return a_[(i * even_ + j) * lanes_ + l]; }
  void run();

  // Of matrix l of the last batch. Where `found` does not hold, because singular values are zero or beyond the range
  // of squares, or NaN, another way has to be taken.
  bool found(Index l) const { return found_[size_t(l)]; }
  // (rows × q) and (q), singular values in decreasing order; q = min(rows, cols)
  void take(Index l, Matrix& u, Vector& s);

 private:
  Index rows_, cols_, count_, even_, lanes_;
  double *a_ = nullptr, *r_ = nullptr, *l_ = nullptr, *norm_ = nullptr;
  LaneMemory memory_;
  std::vector<char> found_;
  Vector left_;  // singular values not yet in order
};

}  // namespace tokid::linalg
