// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/learning.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/nan.hpp"
#include "control/lq.hpp"
#include "model/continuation.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

void need_shape(const char* name, const ConstMatrixRef& a, Index rows, Index columns) {
  if (a.rows() != rows || a.cols() != columns)
    throw std::invalid_argument(
        fmt::format("{}: {} x {} found, {} x {} needed", name, a.rows(), a.cols(), rows, columns));
}

}  // namespace

LiftedMap::LiftedMap(Model model, Index begin, Index end)
    : model_(std::move(model)),
      begin_(begin < 0 ? model_.k_begin : begin),
      steps_((end < 0 ? model_.k_end() : end) - begin_) {
  model_.check();
  if (model_.steps() == 0) throw std::invalid_argument("model: no step found, at least one needed");
  if (begin_ < model_.k_begin || steps_ < 1 || !has_step(model_, begin_ + steps_ - 1))
    throw std::invalid_argument(fmt::format("steps: {} to {} found, steps within {} to {} needed, which the model has",
                                            begin_, begin_ + steps_ - 1, model_.k_begin, model_.k_end() - 1));
}

Matrix LiftedMap::product(const ConstMatrixRef& u) const {
  need_shape("u", u, steps_, inputs());
  Matrix y(steps_, outputs());
  Vector x = Vector::Zero(states_at(model_, begin_)), next;
  for (Index s = 0; s < steps_; ++s) {
    const Step& step = step_at(model_, begin_ + s);
    const Vector now = u.row(s);
    y.row(s) = step.C() * x + step.D() * now;
    next.noalias() = step.A() * x;
    next.noalias() += step.B() * now;
    x.swap(next);
  }
  return y;
}

// The adjoint recursion λ_k = A_kᵀ λ_{k+1} + C_kᵀ y_k from λ = 0 after the last step.
Matrix LiftedMap::transposed_product(const ConstMatrixRef& y) const {
  need_shape("y", y, steps_, outputs());
  Matrix u(steps_, inputs());
  Vector adjoint = Vector::Zero(step_at(model_, begin_ + steps_ - 1).next_states()), before;
  for (Index s = steps_; s-- > 0;) {
    const Step& step = step_at(model_, begin_ + s);
    const Vector now = y.row(s);
    u.row(s) = step.B().transpose() * adjoint + step.D().transpose() * now;
    before.noalias() = step.A().transpose() * adjoint;
    before.noalias() += step.C().transpose() * now;
    adjoint.swap(before);
  }
  return u;
}

Matrix LiftedMap::dense() const {
  const Index m = outputs(), r = inputs();
  Matrix h = Matrix::Zero(steps_ * m, steps_ * r);
  for (Index j = 0; j < steps_; ++j) {
    checkpoint();
    h.block(j * m, j * r, m, r) = step_at(model_, begin_ + j).D();
    Matrix x = step_at(model_, begin_ + j).B();
    for (Index s = j + 1; s < steps_; ++s) {
      const Step& step = step_at(model_, begin_ + s);
      h.block(s * m, j * r, m, r).noalias() = step.C() * x;
      x = step.A() * x;
    }
  }
  return h;
}

namespace {

// RMS of each column, over the numbers that are known; NaN without any.
Vector rms(const Matrix& error) {
  Vector result(error.cols());
  for (Index j = 0; j < error.cols(); ++j) {
    double squares = 0.0, count = 0.0;
    for (const double e : error.col(j))
      if (!std::isnan(e)) squares += e * e, count += 1;
    result(j) = count > 0 ? std::sqrt(squares / count) : nan;
  }
  return result;
}

// The change of the inputs (S × r), by the law of the solution from rest, and the change of the outputs.
struct Change {
  Matrix u, y;
};

Change follow(const lq::Problem& problem, const lq::Solution& law) {
  const Index r = problem.model.inputs;
  Change change{Matrix(problem.steps, r), Matrix(problem.steps, problem.model.outputs)};
  Vector x = Vector::Zero(states_at(problem.model, problem.begin)), next, u = Vector::Zero(r), now(r);
  for (Index s = 0; s < problem.steps; ++s) {
    const Step& step = step_at(problem.model, problem.begin + s);
    now = law.v.row(s).transpose();
    now.noalias() -= law.K[size_t(s)] * x;
    if (!law.L.empty()) now.noalias() -= law.L[size_t(s)] * u;
    u.swap(now);
    change.u.row(s) = u.transpose();
    change.y.row(s) = (step.C() * x + step.D() * u).transpose();
    next.noalias() = step.A() * x;
    next.noalias() += step.B() * u;
    x.swap(next);
  }
  return change;
}

}  // namespace

LearnedRun learn(const Model& model, const Matrix& reference, const Matrix& u, const Matrix& y,
                 const LearningWeights& weights) {
  model.check();
  const Index steps = reference.rows(), m = model.outputs, r = model.inputs;
  if (r == 0) throw std::invalid_argument("model: no input found, at least one needed to learn");
  need_shape("reference", reference, steps, m);
  need_shape("u", u, steps, r);
  need_shape("y", y, steps, m);
  for (const auto& [name, samples] : {std::pair{"reference", &reference}, {"u", &u}, {"y", &y}})
    if (samples->array().isInf().any())
      throw std::invalid_argument(fmt::format("{}: an infinite value found, finite ones needed", name));
  if (u.hasNaN()) throw std::invalid_argument("u: a missing input found, all inputs of the last run needed");
  Index end = steps;
  if (!has_step(model, steps - 1)) end = std::min(steps, model.k_end());
  const Index begin = model.k_begin, count = end - begin;
  if (model.steps() == 0 || count < 1)
    throw std::invalid_argument(fmt::format(
        "reference: {} steps found, more than {} needed, the first step of the model", steps, model.k_begin));

  const Matrix error = reference - y;
  if (error.middleRows(begin, count).array().isNaN().all()) {
    const bool free = reference.middleRows(begin, count).array().isNaN().all();
    throw std::invalid_argument(
        free ? "reference: all samples of the steps of the model are missing (NaN), at least one needed"
             : "y: no output of the last run found where the reference has one, at least one needed");
  }
  Matrix y_target = error.middleRows(begin, count), all = u.topRows(end);  // all inputs as departures
  for (Index k = 0; k < end; ++k) subtract_nominal(model.u_nominal, nominal_row(model, model.u_nominal, k), all.row(k));
  const Matrix departures = all.bottomRows(count);
  Matrix rates = all;  // the input before step 0 is nominal
  rates.bottomRows(end - 1) -= all.topRows(end - 1);
  rates = rates.bottomRows(count).eval();
  lq::Roots output("error", weights.error, m, count);
  output.leave_out_missing(y_target);
  y_target = y_target.array().isNaN().select(0.0, y_target);
  const Matrix u_target = -departures, rate_target = -rates;
  const lq::Problem problem{model,
                            begin,
                            count,
                            std::move(output),
                            lq::Roots("input", weights.input, r, count),
                            lq::Roots("input_change", weights.input_change, r, count),
                            lq::Roots("input_rate", weights.input_rate, r, count),
                            &y_target,
                            &u_target,
                            &rate_target};
  const Change change = follow(problem, lq::solve(problem, false));

  LearnedRun result{u, y, rms(error), {}};
  result.u.middleRows(begin, count) += change.u;
  result.predicted.middleRows(begin, count) += change.y;
  result.predicted_error = rms(reference - result.predicted);
  return result;
}

}  // namespace tokid
