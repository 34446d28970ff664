// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>

#include "base/nan.hpp"
#include "model/channels.hpp"
#include "model/continuation.hpp"
#include "model/initial_state.hpp"
#include "model/kalman_step.hpp"
#include "model/observer_step.hpp"
#include "tokid/innovations.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

std::vector<Index> finite_entries(const Eigen::Ref<const Eigen::RowVectorXd>& row) {
  std::vector<Index> entries;
  for (Index j = 0; j < row.size(); ++j)
    if (std::isfinite(row(j))) entries.push_back(j);
  return entries;
}

// The covariance of a state that is estimated from the samples k … k+window-1, much enlarged. The filter uses these
// samples a second time. Therefore the state must count as almost unknown at step k.
Matrix vague(const Model& model, Index k, Index window) {
  constexpr double enlarged = 1e4;
  const Index n = model.n(k), m = model.outputs;
  Matrix sensitivity(window * m, n), transition = Matrix::Identity(n, n);
  for (Index j = 0; j < window; ++j) {
    const size_t s = model.index(k + j);
    sensitivity.middleRows(j * m, m) =
        linalg::whitener(model.step[s].innovation_cov()) * model.step[s].C() * transition;
    transition = model.at(k + j).closed_loop() * transition;
  }
  const Matrix none = Matrix::Zero(sensitivity.rows(), 1);
  const Matrix root = linalg::minimum_norm(sensitivity, none, 1e-12).inverse_t;
  return enlarged * root * root.transpose();
}

// What is known about the state of one experiment, compared with the state of the model's observer with all outputs.
struct Knowledge {
  bool blind = false;
  Index from = 0;     // first step with a valid innovation
  Matrix error;       // P_k, the covariance of the difference of both states; empty if they are equal
  Index settled = 0;  // number of steps for which the outputs have not shown the difference

  bool exact() const { return error.size() == 0; }
};

class Filter {
 public:
  Filter(const Model& model, const Ensemble& data, std::optional<InitialState> initial)
      : model_(model),
        data_(data),
        window_(estimation_window(model)),
        end_(std::min(model.k_end(), data.steps())),
        known_(size_t(data.experiments())),
        x_(Matrix::Zero(data.experiments(), model.steps() > 0 ? model.n(model.k_begin) : 0)) {
    const InitialState state = initial_state_of(model, data, initial);
    if (!starts_from_zero(model, state))
      for (Knowledge& known : known_) known.blind = true;
  }

  Innovations run() {
    Innovations result(size_t(data_.steps()), Matrix::Constant(data_.experiments(), model_.outputs, nan));
    const Index full_begin = model_.k_begin < end_ ? model_.full_begin() : end_;
    for (Index k = model_.k_begin; k < end_; ++k) {
      checkpoint();
      if (k >= full_begin) wake(k);
      result[size_t(k)] = advance(k);
    }
    return result;
  }

 private:
  // Finds blind experiments whose next samples determine the state, and sets this state.
  void wake(Index k) {
    for (const Index window : {window_, 2 * window_}) {
      if (k + window > end_) return;
      std::vector<Index> rows;
      for (Index n = 0; n < data_.experiments(); ++n) {
        bool inputs = known_[size_t(n)].blind;
        for (Index j = k; inputs && j < k + window; ++j) inputs = data_.input(j).row(n).allFinite();
        if (inputs) rows.push_back(n);
      }
      if (rows.empty()) return;
      const Matrix x = estimate_state(model_, data_.subset(rows), k, window).transpose();
      const Matrix error = vague(model_, k, window);
      for (size_t i = 0; i < rows.size(); ++i) {
        if (!x.row(Index(i)).allFinite()) continue;
        x_.row(rows[i]) = x.row(Index(i));
        known_[size_t(rows[i])] = {false, k + window, error, 0};
      }
    }
  }

  // Returns the innovations of step k, and advances the states.
  Matrix advance(Index k) {
    const Step& step = model_.at(k);
    Matrix u = data_.input(k), y = data_.output(k);
    subtract_nominal(model_.u_nominal, k, u);
    subtract_nominal(model_.y_nominal, k, y);
    for (Index n = 0; n < u.rows(); ++n)
      if (!u.row(n).allFinite()) {
        u.row(n).setZero();
        known_[size_t(n)] = {true, 0, {}, 0};
      }
    Matrix e;
    observer::innovation(step, x_, u, y, e);
    const auto sees_all = [&](Index n) {
      return !known_[size_t(n)].blind && known_[size_t(n)].exact() && e.row(n).allFinite();
    };
    seen_ = e;
    for (Index n = 0; n < e.rows(); ++n)
      if (!sees_all(n)) seen_.row(n).setZero();  // corrected below, if possible
    observer::next_state(step, x_, u, seen_, next_);
    for (Index n = 0; n < e.rows(); ++n) {
      Knowledge& known = known_[size_t(n)];
      if (known.blind) {
        e.row(n).setConstant(nan);
      } else if (!sees_all(n)) {
        next_.row(n) += correction(k, known, e.row(n));
        if (k < known.from) e.row(n).setConstant(nan);
      }
    }
    x_.swap(next_);
    return e;
  }

  // δ_k is the state of the observer with all outputs minus the state of this experiment. E selects the available
  // outputs. Their innovations are E (ε_k + C δ_k), and δ_{k+1} = A δ_k - G ε_k. This is a step of the Kalman filter
  // with l = [δ; ε]. The function scales e from its covariance Σ = E (S + C P Cᵀ) Eᵀ to E S Eᵀ.
  // \return the correction of the next state
  Eigen::RowVectorXd correction(Index k, Knowledge& known, Eigen::Ref<Eigen::RowVectorXd, 0, Eigen::InnerStride<>> e) {
    const Step& step = model_.at(k);
    const Step::View noise = step.innovation_cov();
    const Index n = step.states(), m = model_.outputs, q = n + m;
    prior_.setZero(q, q);
    if (!known.exact()) prior_.topLeftCorner(n, n) = known.error;
    prior_.bottomRightCorner(m, m) = noise;
    f_.resize(step.next_states(), q);
    f_ << step.A(), -step.G();
    const std::vector<Index> seen = finite_entries(e);
    Eigen::RowVectorXd correction = Eigen::RowVectorXd::Zero(f_.rows());
    if (!seen.empty()) {
      h_.resize(m, q);
      h_ << step.C(), Matrix::Identity(m, m);
      r_.setZero(m, m);
      kalman::leave_out_missing(seen, h_, r_);
      kalman::correct(prior_, h_, r_, work_, corrected_);
      const Vector innovation = e(seen).transpose();
      correction = (f_ * (corrected_.gain(Eigen::all, seen) * innovation)).transpose();
      const Matrix own = linalg::whitener(noise(seen, seen)), all = linalg::whitener(work_.innovation(seen, seen));
      e(seen) = (linalg::pseudo_inverse(own) * all * innovation).transpose();
    }
    kalman::propagate(seen.empty() ? prior_ : corrected_.filtered, f_, Matrix::Zero(f_.rows(), f_.rows()), fp_,
                      known.error);
    settle(k, known);
    return correction;
  }

  // Drops the difference of the states if the outputs have not shown it for more than `window_` steps. A state that
  // affects the outputs would show within this time.
  void settle(Index k, Knowledge& known) const {
    if (k + 1 >= model_.k_end()) return;
    const size_t s = model_.index(k + 1);
    const Step::View c = model_.step[s].C();
    const bool shows = (c * known.error * c.transpose()).trace() > 1e-6 * model_.step[s].innovation_cov().trace();
    known.settled = shows ? 0 : known.settled + 1;
    if (known.settled > window_) known.error.resize(0, 0);
  }

  const Model& model_;
  const Ensemble& data_;
  Index window_, end_;
  std::vector<Knowledge> known_;  // (N)
  Matrix x_;                      // (N × n_k)
  // values of one step
  Matrix seen_, next_, prior_, f_, fp_, h_, r_;
  kalman::Workspace work_;
  kalman::Correction corrected_;
};

}  // namespace

Innovations model_innovations(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state) {
  if (!model.has(&Step::has_innovation_cov)) return predict(model, data, {1, initial_state}).innovations;
  check_channels(model, data, true);
  if (model.steps() == 0 || std::min(model.k_end(), data.steps()) <= model.k_begin)
    return Innovations(size_t(data.steps()), Matrix::Constant(data.experiments(), model.outputs, nan));
  return Filter(model, data, initial_state).run();
}

}  // namespace tokid
