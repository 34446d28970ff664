// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/types.hpp"

namespace tokid::linalg {

// Matrices of one shape in one block of memory. An allocation for each would take longer than the work on it.
class MatrixList {
 public:
  MatrixList() = default;
  // Zero matrices.
  MatrixList(Index count, Index rows, Index cols)
      : count_(count), rows_(rows), cols_(cols), numbers_(Matrix::Zero(rows, cols * count)) {}

  Index size() const { return count_; }
  Index rows() const { return rows_; }
  Index cols() const { return cols_; }
  Eigen::Map<Matrix> operator[](size_t i) { return {numbers_.data() + Index(i) * rows_ * cols_, rows_, cols_}; }
  Eigen::Map<const Matrix> operator[](size_t i) const {
    return {numbers_.data() + Index(i) * rows_ * cols_, rows_, cols_};
  }

  // All matrices beside each other (rows × cols·count).
  Eigen::Ref<Matrix> together() { return numbers_; }
  const Matrix& together() const { return numbers_; }

  bool operator==(const MatrixList& other) const = default;

 private:
  Index count_ = 0, rows_ = 0, cols_ = 0;
  Matrix numbers_;
};

}  // namespace tokid::linalg
