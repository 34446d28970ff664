// SPDX-License-Identifier: BSD-3-Clause
#include "model/smoother_covariances.hpp"

#include "linalg/symmetric.hpp"

namespace tokid::kalman {

namespace {

// Do the steps t-1 and t have the same missing samples?
bool same_missing(const Alike& group, size_t t) {
  return group.outputs[t] == group.outputs[t - 1] && group.unknowns[t] == group.unknowns[t - 1];
}

}  // namespace

// A new entry for step t.
StepCovariance& Covariances::add(size_t t) {
  if (used_ == distinct_.size()) distinct_.emplace_back();
  place_[t] = used_;
  return distinct_[used_++];
}

void Covariances::compute(const Model& model, const Samples& samples, const Alike& group, bool smooth) {
  place_.resize(size_t(group.end));
  used_ = 0;
  filter_.start(model.x0_cov.size() > 0 ? model.x0_cov
                                        : Matrix(Matrix::Zero(model.n(model.k_begin), model.n(model.k_begin))));
  for (Index t = 0; t < group.end; ++t) {
    const size_t s = size_t(t);
    if (t > 0 && filter_.settled_as(model.step[s - 1], model.step[s], same_missing(group, s))) {
      place_[s] = place_[s - 1];
      continue;
    }
    StepCovariance& c = add(s);
    filter_.correct(model.step[s], group.outputs[s], group.unknowns[s], samples.u_square, c);
    if (t + 1 == group.end) break;

    filter_.advance(model.step[s], group.unknowns[s], c);
    c.predicted = filter_.P();
    if (!smooth) continue;
    linalg::inverse_root(c.predicted, w_);
    wfp_.noalias() = w_ * filter_.effect();
    c.smoother.noalias() = wfp_.transpose() * w_;
  }
  if (smooth) smooth_backwards(model, group);
}

// l_k - E[l_k | all samples] = (I - J F)(l_k - E[l_k | y_0 … y_k]) - J (w_k - …): the covariance is a sum of three
// squares.
void Covariances::smooth_backwards(const Model& model, const Alike& group) {
  filtered_ = place_;
  bool steady = false;
  for (Index t = group.end; t-- > 0;) {
    const size_t s = size_t(t);
    const bool as_after = t + 1 < group.end && filtered_[s + 1] == filtered_[s];
    if (steady && as_after) {
      place_[s] = place_[s + 1];
      continue;
    }
    if (s > 0 && filtered_[s - 1] == filtered_[s]) {
      const StepCovariance& of_filter = distinct_[filtered_[s]];
      add(s) = of_filter;
    }
    StepCovariance& c = distinct_[place_[s]];
    c.smoothed = c.filtered;
    if (t + 1 == group.end) continue;
    const StepCovariance& after = at(s + 1);
    const Index n = c.predicted.rows(), q = c.filtered.rows();
    with_columns(model.step[s].A(), model.step[s].B(), group.unknowns[s], f_);
    left_.setIdentity(q, q);
    left_.noalias() -= c.smoother * f_;
    product_.noalias() = left_ * c.filtered;
    c.smoothed.noalias() = product_ * left_.transpose();
    r_ = model.step[s].Q() + after.smoothed.topLeftCorner(n, n);
    cross_.noalias() = c.smoother * r_;
    c.smoothed.noalias() += cross_ * c.smoother.transpose();
    linalg::symmetrise(c.smoothed);
    steady = as_after && nearly_equal(c.smoothed, after.smoothed);
  }
}

namespace {

// Missing outputs follow from the available ones and z_k = [x_k; u_k]: y = L y + (I - L) [C D] z + noise. L =
// R_{·,there} R_{there,there}⁻¹ in the columns of the available outputs.
void fill_in_outputs(const Step& own, const std::vector<Index>& there, JointCovariance& joint) {
  const Index m = own.outputs(), l = own.states() + own.inputs(), y = joint.covariance.rows() - m;
  Matrix known = own.R(), w;
  joint.from_outputs = own.R();
  each_missing(there, m, [&](Index j) {
    known.row(j).setZero();
    known.col(j).setZero();
    known(j, j) = 1.0;
    joint.from_outputs.col(j).setZero();
  });
  linalg::inverse_root(known, w);
  const Matrix whitened = joint.from_outputs * w.transpose();
  joint.from_outputs.noalias() = whitened * w;
  const Matrix rest = Matrix::Identity(m, m) - joint.from_outputs;
  Matrix& map = joint.from_states_and_inputs;
  map.resize(m, l);
  map.leftCols(own.states()).noalias() = rest * own.C();
  map.rightCols(own.inputs()).noalias() = rest * own.D();
  const Matrix with_z = map * joint.covariance.topLeftCorner(l, l);
  joint.covariance.block(y, 0, m, l) = with_z;
  joint.covariance.block(0, y, l, m) = with_z.transpose();
  joint.covariance.block(y, y, m, m).noalias() = with_z * map.transpose();
  joint.covariance.block(y, y, m, m).noalias() += rest * own.R() * rest.transpose();
}

}  // namespace

// An available sample has no covariance.
void Covariances::join(const Model& model, const Alike& group, size_t t, JointCovariance& joint) const {
  const Step& own = model.step[t];
  const StepCovariance& c = at(t);
  const std::vector<Index>&there = group.outputs[t], &unknown = group.unknowns[t];
  const bool goes_on = Index(t) + 1 < group.end;
  const Index n = own.states(), r = own.inputs(), m = own.outputs(), l = n + r, next = goes_on ? own.next_states() : 0;
  joint.covariance.setZero(l + next + m, l + next + m);
  joint.covariance.topLeftCorner(n, n) = c.smoothed.topLeftCorner(n, n);
  for (size_t i = 0; i < unknown.size(); ++i) {
    const Index from = n + Index(i), to = n + unknown[i];
    joint.covariance.block(to, 0, 1, n) = c.smoothed.block(from, 0, 1, n);
    joint.covariance.block(0, to, n, 1) = c.smoothed.block(0, from, n, 1);
    for (size_t j = 0; j < unknown.size(); ++j) joint.covariance(to, n + unknown[j]) = c.smoothed(from, n + Index(j));
  }
  if (goes_on) {
    const auto smoothed = at(t + 1).smoothed.topLeftCorner(next, next);
    const auto with_x = joint.covariance.block(l, 0, next, l);
    // The covariance of x_{k+1} and l_k is `smoothed` Jᵀ.
    joint.covariance.block(l, 0, next, n).noalias() = smoothed.lazyProduct(c.smoother.topRows(n).transpose());
    for (size_t i = 0; i < unknown.size(); ++i)
      joint.covariance.col(n + unknown[i]).segment(l, next).noalias() =
          smoothed.lazyProduct(c.smoother.row(n + Index(i)).transpose());
    joint.covariance.block(0, l, l, next) = with_x.transpose();
    joint.covariance.block(l, l, next, next) = smoothed;
  }
  if (partly_missing(there, m)) fill_in_outputs(own, there, joint);
}

}  // namespace tokid::kalman
