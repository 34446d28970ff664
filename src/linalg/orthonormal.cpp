// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/orthonormal.hpp"

#include <algorithm>

#include "linalg/row_absorption.hpp"
#include "linalg/tall_product.hpp"

namespace tokid::linalg {

namespace {

// The number of columns that are computed together, and the number of rows that stay in the cache.
constexpr Index width = 8, height = 256;

// q = q R⁻¹. A column of q becomes zero if the diagonal entry of R is zero.
void divide(Matrix& q, const RowAbsorption& r) {
  const Index cols = q.cols();
  Matrix above(width, cols);  // R above the present diagonal block, transposed
  for (Index top = 0; top < q.rows(); top += height) {
    auto rows = q.middleRows(top, std::min(height, q.rows() - top));
    for (Index begin = 0; begin < cols; begin += width) {
      const Index count = std::min(width, cols - begin);
      if (begin > 0) {
        for (Index c = 0; c < count; ++c)
          for (Index i = 0; i < begin; ++i) above(c, i) = r(i, begin + c);
        tall_products(rows.middleCols(begin, count), {{rows.leftCols(begin), above.topLeftCorner(count, begin), true}},
                      rows.middleCols(begin, count));
      }
      for (Index c = begin; c < begin + count; ++c) {
        for (Index i = begin; i < c; ++i) rows.col(c) -= r(i, c) * rows.col(i);
        const double pivot = r(c, c);
        if (pivot == 0)
          rows.col(c).setZero();
        else
          rows.col(c) /= pivot;
      }
    }
  }
}

}  // namespace

void orthonormalise(Matrix& q) {
  RowAbsorption r;
  for (int pass = 0; pass < 2; ++pass) {
    r.reset(q.cols());
    r.absorb(q);
    divide(q, r);
  }
}

}  // namespace tokid::linalg
