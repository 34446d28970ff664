// One step of a model and of its observer, for all experiments at once as rows:
//   ŷ_k = C_k x_k + D_k u_k,   e_k = y_k - ŷ_k,   x_{k+1} = A_k x_k + B_k u_k - G_k e_k                          (9)
// The functions set the shape of their results, which must not share memory with the arguments. A row of a result
// depends only on the same rows of the arguments, to the last bit. A missing sample of an experiment thus affects no
// other experiment.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "linalg/tall_product.hpp"
#include "tokid/model.hpp"

namespace tokid::observer {

// ŷ_k (N × m) from x_k (N × n_k) and u_k (N × r).
void output(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, Matrix& y);
// e_k (N × m) from x_k, u_k and y_k (N × m).
void innovation(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, const ConstMatrixRef& y, Matrix& e);

// x_{k+1} (N × n_{k+1}) from x_k, u_k and e_k. The form without e_k is a simulation: e_k = 0.
void next_state(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, const ConstMatrixRef& e,
                Matrix& next);
void next_state(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, Matrix& next);

// The same for results that have their shape already. These allocate no memory, and are the fastest for few rows.
using linalg::Operand;
void output(const Step& step, const Operand& x, const Operand& u, Eigen::Ref<Matrix> y);
void next_state(const Step& step, const Operand& x, const Operand& u, const Operand& e, Eigen::Ref<Matrix> next);
void next_state(const Step& step, const Operand& x, const Operand& u, Eigen::Ref<Matrix> next);

}  // namespace tokid::observer
