// The kernel of all large factorisations, and its companions, in vector instructions chosen at run time. Matrices are
// row-major here: a vector holds neighbouring columns, so that no sum runs across its lanes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

// An upper triangular matrix (n × n) that absorbs rows: R becomes the triangular factor of [R; rows] by blocked
// Householder reflections, 2 n² operations for each row. A tall matrix is absorbed in pieces that stay in the cache.
class RowAbsorption {
 public:
  // Zero, without allocating where a larger one was held before.
  void reset(Index n);
  Index size() const { return n_; }

  // Rows of a column-major matrix (any number × n), columns multiplied by `scales` (n) where given.
  void absorb(const ConstMatrixRef& rows, const double* scales = nullptr);
  // Drops the columns begin … begin+count-1 of a factor whose columns before `begin` are dropped already: their rows
  // are absorbed by those that follow.
  void drop(Index begin, Index count);

  double operator()(Index i, Index j) const {  // i ≤ j
    return r_[offset(j / width) + size_t(i * width + j % width)];
  }

  Matrix factor() const;  // (n × n)

  // Columns lie in blocks of this width, each with contiguous rows down to the diagonal: products of blocks then read
  // memory in order, whatever n is.
  static constexpr Index width = 16;
  static constexpr size_t offset(Index block) { return size_t(width * width * block * (block + 1) / 2); }

 private:
  double* piece(Index rows);

  Index n_ = 0;
  std::vector<double> r_, piece_;
};

// Columns of a matrix whose rows are whole vectors, and the n that such a matrix is to hold.
constexpr Index whole_vectors(Index n) { return (n + 7) / 8 * 8; }

// b = r⁻¹ b for the upper triangle of r (n × whole_vectors(n)) without a zero on the diagonal, b (n × whole vectors); a
// triangular b is told to stay so.
void back_substitute(const RowMatrix& r, RowMatrix& b, bool triangular);

}  // namespace tokid::linalg
