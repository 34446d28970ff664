// The kernel of all large factorisations, in vector instructions that are chosen at run time. Matrices are row-major
// here: a vector contains neighbouring columns, so that no sum runs across the lanes of a vector.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// An upper triangular matrix R (n × n) that absorbs rows: R becomes the triangular factor of [R; rows] by blocked
// Householder reflections, with 2 n² operations for each row. A tall matrix is absorbed in pieces that stay in the
// cache.
class RowAbsorption {
 public:
  // Sets the triangle to zero. This allocates no memory if an earlier size was as large.
  void reset(Index n);
  Index size() const { return n_; }

  // Absorbs the rows of a column-major matrix (any number × n), with columns multiplied by `scales` (n) if given.
  void absorb(const ConstMatrixRef& rows, const double* scales = nullptr);
  // Drops the columns begin … begin+count-1 of a factor. The columns before `begin` must be dropped already. The
  // remaining columns absorb the rows of the dropped columns.
  void drop(Index begin, Index count);

  double operator()(Index i, Index j) const {  // i ≤ j
    return r_[offset(j / width) + size_t(i * width + j % width)];
  }

  Matrix factor() const;  // (n × n)

  // Columns are stored in blocks of this width. A block has contiguous rows, down to the diagonal. Products of blocks
  // thus read memory in order for any n.
  static constexpr Index width = 16;
  static constexpr size_t offset(Index block) { return size_t(width * width * block * (block + 1) / 2); }

 private:
  double* piece(Index rows);

  Index n_ = 0;
  std::vector<double> r_, piece_;
};

// The number of stored columns for n used columns: every row consists of whole vectors.
constexpr Index whole_vectors(Index n) { return (n + 7) / 8 * 8; }

// b = r⁻¹ b for the upper triangle of r (n × whole_vectors(n)) without a zero on the diagonal, b (n × whole vectors).
// With `triangular`, b is upper triangular and stays so.
void back_substitute(const RowMatrix& r, RowMatrix& b, bool triangular);

}  // namespace tokid::linalg
