// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

enum class Into { set, add, subtract };

// out = x wᵀ, or out + x wᵀ, out - x wᵀ, for tall x (rows × p) and small w (q × p): experiments as rows, which a model
// takes from one step to the next. A general product would copy its factors before it multiplies. `out` (rows × q)
// shares no memory with x.
void tall_product(const ConstMatrixRef& x, const ConstMatrixRef& w, Into into, Eigen::Ref<Matrix> out);

}  // namespace tokid::linalg
