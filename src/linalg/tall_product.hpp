// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// x wᵀ, or - x wᵀ, for tall x (rows × p) and small w (q × p). The rows are experiments, which a model advances by one
// step.
struct TallProduct {
  ConstMatrixRef x, w;
  bool minus = false;
};

// out (rows × q) = `start` (if given) plus up to three products, in one pass. A general product would first copy its
// factors. `out` may be `start`, but shares no memory with the factors.
void tall_products(std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out);
void tall_products(const ConstMatrixRef& start, std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out);

}  // namespace tokid::linalg
