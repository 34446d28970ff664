// SPDX-License-Identifier: BSD-3-Clause
#include "model/observer_step.hpp"

namespace tokid::observer {

// ŷ = C x + D u
void output(const Step& step, const Operand& x, const Operand& u, Eigen::Ref<Matrix> y) {
  linalg::tall_products({{x, step.C()}, {u, step.D()}}, y);
}

void output(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, Matrix& y) {
  y.resize(x.rows(), step.outputs());
  output(step, x, u, Eigen::Ref<Matrix>(y));
}

// e = y - ŷ
void innovation(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, const ConstMatrixRef& y,
                Matrix& e) {
  output(step, x, u, e);
  e = y - e;
}

// x⁺ = A x + B u - G e
void next_state(const Step& step, const Operand& x, const Operand& u, const Operand& e, Eigen::Ref<Matrix> next) {
  linalg::tall_products({{x, step.A()}, {u, step.B()}, {e, step.G(), true}}, next);
}

void next_state(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, const ConstMatrixRef& e,
                Matrix& next) {
  next.resize(x.rows(), step.next_states());
  next_state(step, x, u, e, Eigen::Ref<Matrix>(next));
}

// x⁺ = A x + B u
void next_state(const Step& step, const Operand& x, const Operand& u, Eigen::Ref<Matrix> next) {
  linalg::tall_products({{x, step.A()}, {u, step.B()}}, next);
}

void next_state(const Step& step, const ConstMatrixRef& x, const ConstMatrixRef& u, Matrix& next) {
  next.resize(x.rows(), step.next_states());
  next_state(step, x, u, Eigen::Ref<Matrix>(next));
}

}  // namespace tokid::observer
