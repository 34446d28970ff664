// Singular values and left singular vectors of many small matrices at once, one in each lane of the vector
// instructions.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/lane_memory.hpp"

namespace tokid::linalg {

// Decomposes matrices A = U Σ Vᵀ of the same shape. First Aᵀ = Q Lᵀ by Householder reflections, then L J = U Σ, where J
// are rotations of pairs of columns (one-sided Jacobi). No square of A is formed, so that the error of a small singular
// value is only a rounding error of A. The result of a lane does not depend on the other lanes.
//
// With Eigen's JacobiSVD of each single matrix, `tokid identify` takes 20 % more processor time: 67 ms instead of 56 ms
// with AVX-512, on exact data of the paper's example with N = 50 and T = 3200. With N = 1000 there is no difference.
class LaneSvd {
 public:
  LaneSvd(Index rows, Index cols);
  LaneSvd(const LaneSvd&) = delete;
  LaneSvd& operator=(const LaneSvd&) = delete;

  static Index lanes();  // number of matrices in a batch
  // The largest number of rows. With more rows, the matrices of all lanes do not fit into the caches.
  static Index most_rows();

  // Entry (i, j) of matrix l of the next batch. Set every entry before each run, because run() overwrites them.
  double& entry(Index l, Index i, Index j) { return a_[(i * even_ + j) * lanes_ + l]; }
  void run();

  // The result for matrix l of the last batch. found() is false if a singular value is zero or NaN, or if its square
  // loses digits. The caller must then use another method for this matrix.
  bool found(Index l) const { return found_[size_t(l)]; }
  // u (rows × q) and s (q) with q = min(rows, cols); singular values in decreasing order
  void take(Index l, Matrix& u, Vector& s);

 private:
  Index rows_, cols_, count_, even_, lanes_;
  double *a_ = nullptr, *r_ = nullptr, *l_ = nullptr, *norm_ = nullptr;
  LaneMemory memory_;
  std::vector<char> found_;
  Vector left_;  // singular values that take() has not sorted yet
};

}  // namespace tokid::linalg
