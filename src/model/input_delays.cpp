// SPDX-License-Identifier: BSD-3-Clause
#include "model/input_delays.hpp"

#include <algorithm>

namespace tokid {

namespace {

Matrix with_zeros(const Matrix& m, Index rows, Index cols) {
  Matrix result = Matrix::Zero(m.rows() + rows, m.cols() + cols);
  result.topLeftCorner(m.rows(), m.cols()) = m;
  return result;
}

Step of_undelayed(const Step& step, const std::vector<Index>& delays, bool on_states) {
  const Index n = step.states(), next = step.next_states(), held = held_inputs(delays);
  Matrix A = with_zeros(step.A(), held, held), C = with_zeros(step.C(), 0, held), B = with_zeros(step.B(), held, 0),
         D = step.D();
  Index first = 0;
  for (size_t i = 0; i < delays.size(); first += delays[i++]) {
    if (delays[i] == 0) continue;
    const Index input = Index(i), last = first + delays[i] - 1;
    A.col(n + last).head(next) = step.B().col(input);
    C.col(n + last) = step.D().col(input);
    B.col(input).setZero();
    D.col(input).setZero();
    B(next + first, input) = 1.0;
    for (Index held_at = first; held_at < last; ++held_at) A(next + held_at + 1, n + held_at) = 1.0;
  }
  Step result(A, B, C, D, with_zeros(step.G(), held, 0));
  result.take_diagnostics_of(step);
  // Regressions on states: the held inputs are known, and later samples determine them.
  if (on_states && step.has_rank()) result.set_rank(step.rank() + held);
  if (on_states && step.has_lags()) result.set_lags(step.lags() + latest(delays));
  if (step.has_Q()) result.set_Q(with_zeros(step.Q(), held, held));
  if (step.has_R()) result.set_R(step.R());
  if (step.has_K()) result.set_K(with_zeros(step.K(), held, 0));
  return result;
}

}  // namespace

Ensemble delayed(Ensemble e, const std::vector<Index>& delays) {
  for (Index i = 0; i < Index(delays.size()); ++i) {
    const Index delay = delays[size_t(i)];
    for (Index k = e.steps(); delay > 0 && k-- > 0;)
      if (k >= delay)
        e.input(k).col(i) = e.input(k - delay).col(i);
      else
        e.input(k).col(i).setZero();
  }
  return e;
}

Matrix delayed(Matrix inputs, const std::vector<Index>& delays) {
  for (Index i = 0; i < Index(delays.size()) && i < inputs.cols(); ++i) {
    const Index delay = std::min(delays[size_t(i)], inputs.rows()), left = inputs.rows() - delay;
    inputs.col(i).tail(left) = inputs.col(i).head(left).eval();
    inputs.col(i).head(delay).setZero();
  }
  return inputs;
}

Model of_undelayed(Model model, const std::vector<Index>& delays) {
  const Index held = held_inputs(delays);
  if (held == 0) return model;
  const std::vector<Step> before = model.period > 0 ? model.step : std::vector<Step>();
  const size_t period = size_t(model.period);
  for (size_t s = 0; s < model.step.size(); ++s)
    model.step[s] = period > 0 && s >= period && before[s] == before[s - period]
                        ? Step(model.step[s - period])  // shares the numbers again
                        : of_undelayed(model.step[s], delays, model.method != "tvera");
  if (model.x0_mean.size() > 0) {
    model.x0_mean = with_zeros(model.x0_mean, held, 0);
    model.x0_cov = with_zeros(model.x0_cov, held, held);
  }
  return model;
}

}  // namespace tokid
