// SPDX-License-Identifier: BSD-3-Clause
#include "model/observer_rows.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "base/nan.hpp"
#include "model/continuation.hpp"
#include "model/delays.hpp"
#include "model/observer_step.hpp"
#include "model/state_estimate.hpp"

namespace tokid::observer {

std::optional<Vector> known_start(const Model& model, InitialState initial, bool estimate) {
  if (starts_from_zero(model, initial)) return Vector::Zero(model.n(model.k_begin));
  if (estimate && has_initial_estimate(model, initial)) return model.x0_mean;
  return std::nullopt;
}

Rows::Rows(const Model& model, Index experiments, Index k, const std::optional<Vector>& x)
    : model_(model),
      window_(estimation_window(model)),
      held_(held_inputs(delays_of(model.provenance))),
      k_(k),
      n_(states_at(model, k)),
      x_(Vector::Zero(experiments * model.states())),
      next_(x_),
      since_(size_t(experiments), x ? sees : k),
      all_see_(x.has_value()),
      recent_u_(size_t(2 * window_)),
      recent_y_(recent_u_),
      available_(model.outputs) {
  if (x) Eigen::Map<Matrix>(x_.data(), experiments, n_).rowwise() = x->transpose();
}

void Rows::reserve() {
  for (Matrix& u : recent_u_) u.resize(experiments(), model_.inputs);
  for (Matrix& y : recent_y_) y.resize(experiments(), model_.outputs);
  u_.resize(experiments(), model_.inputs);
  seen_.resize(experiments(), model_.outputs);
}

Matrix Rows::state() const {
  Matrix states = x();
  blank(states);
  return states;
}

void Rows::blank(Eigen::Ref<Matrix> rows) const {
  if (all_see_) return;
  for (Index n = 0; n < experiments(); ++n)
    if (!knows(n)) rows.row(n).setConstant(nan);
}

void Rows::advance(const Samples& u, const Samples& y, Eigen::Ref<Matrix> prediction, Eigen::Ref<Matrix> innovation) {
  const Step& step = step_at(model_, k_);
  Eigen::Map<Matrix> next(next_.data(), experiments(), step.next_states());
  if (std::isfinite(u.sum()))  // surely no input is missing
    correct(step, x(), u, y, prediction, innovation, next);
  else
    correct(step, x(), of(without_missing(u)), y, prediction, innovation, next);
  x_.swap(next_);
  n_ = step.next_states();
  if (!all_see_) {
    blank(prediction);
    blank(innovation);
    remember(u, y);
  }
  ++k_;
  if (!all_see_ && has_step(model_, k_)) recover();
}

// The inputs with zeros for those that are missing. Their experiments become blind.
const Matrix& Rows::without_missing(const Samples& u) {
  u_ = u;
  for (Index n = 0; n < u_.rows(); ++n) {
    if (u_.row(n).allFinite()) continue;
    u_.row(n).setZero();
    since_[size_t(n)] = k_ + 1;
    all_see_ = false;
  }
  return u_;
}

// x̂_{k+1} = A_k x̂_k + B_k u_k - G_k (y_k - ŷ_k)                                                         (9)
void Rows::correct(const Step& step, const Samples& x, const Samples& u, const Samples& y,
                   Eigen::Ref<Matrix> prediction, Eigen::Ref<Matrix> innovation, Eigen::Ref<Matrix> next) {
  output(step, x, u, prediction);
  innovation = y - prediction;
  if (std::isfinite(innovation.sum())) {
    next_state(step, x, u, innovation, next);
    return;
  }
  seen_ = innovation;
  fill_in(step, seen_);
  next_state(step, x, u, seen_, next);
}

void Rows::fill_in(const Step& step, Matrix& innovations) {
  bool same_step = false;
  for (Index n = 0; n < innovations.rows(); ++n) {
    if (!innovations.row(n).hasNaN()) continue;
    available_.consider(step, innovations.row(n), same_step);
    available_.fill_in(step, innovations.row(n));
    same_step = true;
  }
}

void Rows::remember(const Samples& u, const Samples& y) {
  recent_u_[place(k_)] = u;
  recent_y_[place(k_)] = y;
}

// Restores the state of a blind experiment if its recent samples determine the state. If the window is too short, it
// grows up to twice its size.
void Rows::recover() {
  // Experiments whose windows begin at the same step and miss the same outputs.
  std::map<std::pair<Index, std::vector<bool>>, std::vector<Index>> groups;
  for (Index n = 0; n < experiments(); ++n) {
    const Index since = since_[size_t(n)];
    if (since == sees || k_ - since < window_) continue;
    const Index from = std::max(since, k_ - 2 * window_);
    if (!may_determine(n, from)) continue;
    std::vector<bool> present;
    for (Index k = from; k < k_; ++k)
      for (const double y : recent_y_[place(k)].row(n)) present.push_back(std::isfinite(y));
    groups[{from, std::move(present)}].push_back(n);
  }
  for (const auto& [group, rows] : groups) {
    Window window{group.first, {}, {}};
    for (Index k = window.k; k < k_; ++k) {
      window.u.emplace_back(recent_u_[place(k)](rows, Eigen::all));
      window.y.emplace_back(recent_y_[place(k)](rows, Eigen::all));
    }
    Matrix states = estimate(model_, window), prediction(Index(rows.size()), model_.outputs), innovation(prediction);
    for (size_t j = 0; j < window.u.size(); ++j) {
      const Step& step = step_at(model_, window.k + Index(j));
      Matrix next(states.rows(), step.next_states());
      correct(step, of(states), of(window.u[j]), of(window.y[j]), prediction, innovation, next);
      states.swap(next);
    }
    for (size_t i = 0; i < rows.size(); ++i) {
      if (!states.row(Index(i)).allFinite()) continue;
      Eigen::Map<Matrix>(x_.data(), experiments(), n_).row(rows[i]) = states.row(Index(i));
      since_[size_t(rows[i])] = sees;
    }
  }
  all_see_ = std::all_of(since_.begin(), since_.end(), [](Index k) { return k == sees; });
}

bool Rows::may_determine(Index n, Index from) const {
  Index samples = 0;
  for (Index k = from; k < k_; ++k)
    for (const double y : recent_y_[place(k)].row(n)) samples += std::isfinite(y);
  return samples >= states_at(model_, from) - held_;
}

}  // namespace tokid::observer
