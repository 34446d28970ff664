// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// x wᵀ, or - x wᵀ, for tall x (rows × p) and small w (q × p): experiments as rows, which a model takes from one step to
// the next.
struct TallProduct {
  ConstMatrixRef x, w;
  bool minus = false;
};

// out (rows × q) = the sum of up to three products, or that and `start`, in one pass. A general product would copy its
// factors before it multiplies. `out` may be `start`, and shares no memory with what is multiplied.
void tall_products(std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out);
void tall_products(const ConstMatrixRef& start, std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out);

}  // namespace tokid::linalg
