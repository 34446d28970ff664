// SPDX-License-Identifier: BSD-3-Clause
#include "model/observer_step.hpp"

#include "linalg/tall_product.hpp"

namespace tokid::observer {

// ŷ = C x + D u
void output(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, Matrix& y) {
  y.resize(x.rows(), step.outputs());
  linalg::tall_products({{x, step.C()}, {u, step.D()}}, y);
}

// e = y - ŷ
void innovation(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, const ConstMatrixRef& y,
                Matrix& e) {
  output(step, x, u, e);
  e = y - e;
}

// x⁺ = A x + B u - G e
void next_state(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, const ConstMatrixRef& e,
                Matrix& next) {
  next.resize(x.rows(), step.next_states());
  linalg::tall_products({{x, step.A()}, {u, step.B()}, {e, step.G(), true}}, next);
}

// x⁺ = A x + B u
void next_state(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, Matrix& next) {
  next.resize(x.rows(), step.next_states());
  linalg::tall_products({{x, step.A()}, {u, step.B()}}, next);
}

}  // namespace tokid::observer
