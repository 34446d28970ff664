// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// x wᵀ, or -x wᵀ with `minus`, for tall x (rows × p) and small w (q × p). Each row belongs to one experiment, and w is
// a matrix of the model.
struct TallProduct {
  ConstMatrixRef x, w;
  bool minus = false;
};

// out (rows × q) = `start` (if given) plus up to three products, in one pass. This is faster than general products,
// which first copy their factors. `out` may be `start`, but shares no memory with the factors.
void tall_products(std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out);
void tall_products(const ConstMatrixRef& start, std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out);

}  // namespace tokid::linalg
