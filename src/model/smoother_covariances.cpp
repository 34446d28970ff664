// SPDX-License-Identifier: BSD-3-Clause
#include "model/smoother_covariances.hpp"

#include "linalg/symmetric.hpp"

namespace tokid::kalman {

namespace {

// both = [a, these columns of b]
void with_columns(const ConstMatrixRef& a, const ConstMatrixRef& b, const std::vector<Index>& columns, Matrix& both) {
  both.resize(a.rows(), a.cols() + Index(columns.size()));
  both.leftCols(a.cols()) = a;
  for (size_t i = 0; i < columns.size(); ++i) both.col(a.cols() + Index(i)) = b.col(columns[i]);
}

}  // namespace

void Covariances::compute(const Model& model, const Samples& samples, const Alike& group, bool smooth) {
  step.resize(size_t(group.end));
  Matrix p = Matrix::Zero(model.n(model.k_begin), model.n(model.k_begin));
  if (model.x0_cov.size() > 0) p = model.x0_cov;
  for (Index t = 0; t < group.end; ++t) {
    const size_t s = size_t(t);
    StepCovariance& c = step[s];
    const std::vector<Index>& unknown = group.unknowns[s];
    const Index n = p.rows(), q = n + Index(unknown.size());
    prior_.setZero(q, q);
    prior_.topLeftCorner(n, n) = p;
    for (size_t i = 0; i < unknown.size(); ++i) prior_(n + Index(i), n + Index(i)) = samples.u_square(unknown[i]);
    correct_step(model.step[s], group.outputs[s], unknown, c);
    with_columns(model.step[s].A(), model.step[s].B(), unknown, c.transition);
    if (t + 1 == group.end) break;

    propagate(c.filtered, c.transition, model.step[s].Q(), fp_, c.predicted);
    p = c.predicted;
    if (!smooth) continue;
    linalg::inverse_root(p, w_);
    wfp_.noalias() = w_ * fp_;
    c.smoother.noalias() = wfp_.transpose() * w_;
  }
  if (smooth) smooth_backwards(model, group);
}

void Covariances::correct_step(const Step& own, const std::vector<Index>& there, const std::vector<Index>& unknown,
                               StepCovariance& c) {
  c.log_det = 0.0;
  if (there.empty()) {
    c.filtered = prior_;
    c.gain.setZero(prior_.rows(), own.outputs());
    return;
  }
  with_columns(own.C(), own.D(), unknown, h_);
  r_ = own.R();
  leave_out_missing(there, h_, r_);
  correct(prior_, h_, r_, work_, c);
}

// l_k - E[l_k | all samples] = (I - J F)(l_k - E[l_k | y_0 … y_k]) - J (w_k - …): the covariance is a sum of three
// squares.
void Covariances::smooth_backwards(const Model& model, const Alike& group) {
  for (Index t = group.end; t-- > 0;) {
    const size_t s = size_t(t);
    StepCovariance& c = step[s];
    const StepCovariance* const next = t + 1 < group.end ? &step[s + 1] : nullptr;
    c.smoothed = c.filtered;
    if (next) {
      const Index n = c.predicted.rows(), q = c.filtered.rows();
      left_.setIdentity(q, q);
      left_.noalias() -= c.smoother * c.transition;
      product_.noalias() = left_ * c.filtered;
      c.smoothed.noalias() = product_ * left_.transpose();
      r_ = model.step[s].Q() + next->smoothed.topLeftCorner(n, n);
      product_.noalias() = c.smoother * r_;
      c.smoothed.noalias() += product_ * c.smoother.transpose();
      linalg::symmetrise(c.smoothed);
    }
    join(model.step[s], next, group.outputs[s], group.unknowns[s], c);
  }
}

// The joint covariance of what the M-step regresses on each other. An available sample has none.
void Covariances::join(const Step& own, const StepCovariance* next, const std::vector<Index>& there,
                       const std::vector<Index>& unknown, StepCovariance& c) {
  const Index n = own.states(), r = own.inputs(), m = own.outputs(), l = n + r, after = next ? own.next_states() : 0;
  c.joint.setZero(l + after + m, l + after + m);
  c.joint.topLeftCorner(n, n) = c.smoothed.topLeftCorner(n, n);
  for (size_t i = 0; i < unknown.size(); ++i) {
    const Index from = n + Index(i), to = n + unknown[i];
    c.joint.block(to, 0, 1, n) = c.smoothed.block(from, 0, 1, n);
    c.joint.block(0, to, n, 1) = c.smoothed.block(0, from, n, 1);
    for (size_t j = 0; j < unknown.size(); ++j) c.joint(to, n + unknown[j]) = c.smoothed(from, n + Index(j));
  }
  if (next) {
    const auto smoothed = next->smoothed.topLeftCorner(after, after);
    product_.noalias() = smoothed * c.smoother.transpose();  // covariance of x_{k+1} and l_k
    c.joint.block(l, 0, after, n) = product_.leftCols(n);
    for (size_t i = 0; i < unknown.size(); ++i) c.joint.block(l, n + unknown[i], after, 1) = product_.col(n + Index(i));
    c.joint.block(0, l, l, after) = c.joint.block(l, 0, after, l).transpose();
    c.joint.block(l, l, after, after) = smoothed;
  }
  if (partly_missing(there, m)) fill_in_outputs(own, there, c);
}

// Missing outputs follow from the available ones and z_k = [x_k; u_k]: y = L y + (I - L) [C D] z + noise. L =
// R_{·,there} R_{there,there}⁻¹ in the columns of the available outputs.
void Covariances::fill_in_outputs(const Step& own, const std::vector<Index>& there, StepCovariance& c) {
  const Index m = own.outputs(), l = own.states() + own.inputs(), y = c.joint.rows() - m;
  known_ = own.R();
  c.from_outputs = own.R();
  each_missing(there, m, [&](Index j) {
    known_.row(j).setZero();
    known_.col(j).setZero();
    known_(j, j) = 1.0;
    c.from_outputs.col(j).setZero();
  });
  linalg::inverse_root(known_, w_);
  product_.noalias() = c.from_outputs * w_.transpose();
  c.from_outputs.noalias() = product_ * w_;
  rest_.setIdentity(m, m);
  rest_ -= c.from_outputs;
  c.from_states.resize(m, l);
  c.from_states.leftCols(own.states()).noalias() = rest_ * own.C();
  c.from_states.rightCols(own.inputs()).noalias() = rest_ * own.D();
  with_states_.noalias() = c.from_states * c.joint.topLeftCorner(l, l);
  c.joint.block(y, 0, m, l) = with_states_;
  c.joint.block(0, y, l, m) = with_states_.transpose();
  c.joint.block(y, y, m, m).noalias() = with_states_ * c.from_states.transpose();
  product_.noalias() = rest_ * own.R();
  c.joint.block(y, y, m, m).noalias() += product_ * rest_.transpose();
}

}  // namespace tokid::kalman
