// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>
#include <span>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// A matrix or a part of one, without a copy. An Eigen::Ref would do the same, but takes longer to make than a product
// of few rows.
struct Operand {
  template <class Derived>
  Operand(const Eigen::MatrixBase<Derived>& a)  // NOLINT: as Eigen::Ref
      : data(a.derived().data()), rows(a.rows()), cols(a.cols()), stride(stride_of(a.derived())) {}

  const double* data;
  Index rows, cols;
  Index stride;  // from column to column

 private:
  template <class Derived>
  static Index stride_of(const Derived& a) {
    static_assert((Eigen::internal::traits<Derived>::Flags & Eigen::DirectAccessBit) != 0, "no matrix in memory");
    if constexpr (Derived::RowsAtCompileTime == 1) return a.innerStride();
    static_assert(Derived::RowsAtCompileTime == 1 || (!Derived::IsRowMajor && Derived::InnerStrideAtCompileTime == 1),
                  "columns are not contiguous");
    return a.outerStride();
  }
};

// x wᵀ, or -x wᵀ with `minus`, for tall x (rows × p) and small w (q × p). Each row belongs to one experiment, and w is
// a matrix of the model.
struct TallProduct {
  Operand x, w;
  bool minus = false;
};

// out (rows × q) = `start` (if given) plus up to three products, in one pass. This is faster than general products,
// which first copy their factors. `out` may be `start`, but shares no memory with the factors.
void tall_products(std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out);
void tall_products(const ConstMatrixRef& start, std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out);

// The number of rows of X in add_gram() is a multiple of this.
inline constexpr Index gram_rows = 8;
// sum += XᵀX in the upper left corner of a symmetric `sum`, for the columns of X (`rows` numbers each). Of `sum`, only
// the lower triangle is read.
// \throws std::logic_error for a small `sum` or a wrong number of rows
void add_gram(std::span<const double* const> columns, Index rows, Eigen::Ref<Matrix> sum);

}  // namespace tokid::linalg
