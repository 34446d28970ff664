// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>
#include <span>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// x wᵀ, or -x wᵀ with `minus`, for tall x (rows × p) and small w (q × p). Each row belongs to one experiment, and w is
// a matrix of the model.
struct TallProduct {
  ConstMatrixRef x, w;
  bool minus = false;
};

// A product and its sum are rounded once, or each. Rounded once, they are faster. Rounded each, they have the same bits
// with every instruction set.
enum class Rounding { once, each };

// out (rows × q) = `start` (if given) plus up to three products, in one pass. This is faster than general products,
// which first copy their factors. `out` may be `start`, but shares no memory with the factors.
void tall_products(std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out,
                   Rounding rounding = Rounding::once);
void tall_products(const ConstMatrixRef& start, std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out,
                   Rounding rounding = Rounding::once);

// sum += XᵀX in the upper left corner of `sum`, for the columns of X (rows numbers each, a multiple of 8). The sum has
// the same bits with every instruction set.
void add_gram(std::span<const double* const> columns, Index rows, Eigen::Ref<Matrix> sum);

}  // namespace tokid::linalg
