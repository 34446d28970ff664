// SPDX-License-Identifier: BSD-3-Clause
#include "control/lq.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>

#include "linalg/reflection.hpp"
#include "model/continuation.hpp"
#include "tokid/parallel.hpp"

namespace tokid::lq {

namespace {

void need_count(const std::string& name, size_t found, Index steps) {
  if (found != 1 && found != size_t(steps))
    throw std::invalid_argument(
        fmt::format("{}: {} matrices found, one needed, or one for each of {} steps", name, found, steps));
}

void need_square(const std::string& name, const Matrix& weight, Index size) {
  if (weight.rows() != size || weight.cols() != size)
    throw std::invalid_argument(
        fmt::format("{}: {} x {} found, {} x {} needed", name, weight.rows(), weight.cols(), size, size));
}

// Without cost for some input, the best inputs could be infinitely large, or would not be unique.
void need_positive_definite(const Problem& p) {
  const Index steps = std::max({p.input.count(), p.change.count(), p.rate.count()});
  for (Index s = 0; s < steps; ++s) {
    Matrix sum = Matrix::Zero(p.model.inputs, p.model.inputs);
    for (const Roots* roots : {&p.input, &p.change, &p.rate})
      if (!roots->empty()) sum += roots->at(s).transpose() * roots->at(s);
    // Inputs have different units, so each is scaled to weight one.
    const Vector scale = sum.diagonal().cwiseSqrt().cwiseInverse();
    const bool weighted = (sum.diagonal().array() > 0).all();
    const Vector values =
        weighted ? linalg::symmetric_eigenvalues(scale.asDiagonal() * sum * scale.asDiagonal()) : Vector::Zero(1);
    constexpr double rounding = 8 * std::numeric_limits<double>::epsilon();
    if (!(values(0) > rounding * double(sum.rows()) * values(values.size() - 1)))
      throw std::invalid_argument(
          fmt::format("input: the sum of all weights on inputs is singular at step {}; a positive definite sum needed",
                      p.begin + s));
  }
  if (steps == 0) throw std::invalid_argument("input: no weight on inputs found, a positive definite one needed");
}

// The recursion, with memory for one step.
class Recursion {
 public:
  Recursion(const Problem& p, Solution& solution)
      : p_(p), solution_(solution), r_(p.model.inputs), m_(p.model.outputs), held_(p.rate.empty() ? 0 : r_) {
    const Index most = p.model.states() + held_;
    work_.resize(m_ + 3 * r_ + most, r_ + most + 1);
    root_.setZero(most, most);
    gamma_.setZero(most);
  }

  Index size(Index k) const { return states_at(p_.model, k) + held_; }  // of z_k
  Index rows() const { return rows_; }                                  // of Γ
  double constant() const { return constant_; }
  Matrix root(Index k) const { return root_.topLeftCorner(rows_, size(k)); }
  Vector gamma() const { return gamma_.head(rows_); }

  // From the cost of the steps k+1 … to that of the steps k …, for k = begin + s.
  void go_back(Index s) {
    const Index k = p_.begin + s;
    const Step& step = step_at(p_.model, k);
    const Index n = step.states(), targets = p_.has_targets() ? 1 : 0, cols = r_ + n + held_ + targets;
    used_ = 0;
    cols_ = cols;
    work_.setZero();
    if (!p_.output.empty()) {
      const Matrix& f = p_.output.at(s);
      auto rows = take(m_);
      rows.leftCols(r_).noalias() = f * step.D();
      rows.middleCols(r_, n).noalias() = f * step.C();
      if (p_.y_target) rows.col(cols - 1).noalias() = f * p_.y_target->row(s).transpose();
    }
    add_input(p_.input, p_.u_target, s);
    add_input(p_.change, nullptr, s);
    add_input(p_.rate, p_.rate_target, s);
    if (held_ > 0) work_.block(used_ - r_, r_ + n, r_, r_) = -p_.rate.at(s);
    add_future(step);
    auto w = work_.topLeftCorner(used_, cols);
    linalg::triangularise(w, w.rows());
    store_law(s, n);
    store_root(n + held_);
  }

 private:
  Eigen::Block<Matrix> take(Index rows) {
    used_ += rows;
    return work_.block(used_ - rows, 0, rows, cols_);
  }

  void add_input(const Roots& weight, const Matrix* target, Index s) {
    if (weight.empty()) return;
    const Matrix& f = weight.at(s);
    auto rows = take(r_);
    rows.leftCols(r_) = f;
    if (target) rows.col(cols_ - 1).noalias() = f * target->row(s).transpose();
  }

  // Γ_{k+1} [A x + B u; u] - γ_{k+1}
  void add_future(const Step& step) {
    if (rows_ == 0) return;
    const Index next = step.next_states(), n = step.states();
    auto rows = take(rows_);
    const auto of_state = root_.topLeftCorner(rows_, next);
    rows.leftCols(r_).noalias() = of_state.lazyProduct(step.B());
    rows.middleCols(r_, n).noalias() = of_state.lazyProduct(step.A());
    if (held_ > 0) rows.leftCols(r_) += root_.block(0, next, rows_, held_);
    if (p_.has_targets()) rows.col(cols_ - 1) = gamma_.head(rows_);
  }

  void store_law(Index s, Index n) {
    const auto factor = work_.topLeftCorner(r_, r_).triangularView<Eigen::Upper>();
    work_.block(0, r_, r_, cols_ - r_) = factor.solve(work_.block(0, r_, r_, cols_ - r_));
    solution_.K[size_t(s)] = work_.block(0, r_, r_, n);
    if (held_ > 0) solution_.L[size_t(s)] = work_.block(0, r_ + n, r_, r_);
    if (p_.has_targets()) solution_.v.row(s) = work_.col(cols_ - 1).head(r_).transpose();
  }

  void store_root(Index size) {
    rows_ = std::clamp<Index>(used_ - r_, 0, size);
    for (Index j = 0; j < size; ++j)
      for (Index i = 0; i < rows_; ++i) root_(i, j) = i <= j ? work_(r_ + i, r_ + j) : 0.0;
    if (!p_.has_targets()) return;
    gamma_.head(rows_) = work_.col(cols_ - 1).segment(r_, rows_);
    if (used_ > r_ + rows_) constant_ += work_(r_ + rows_, cols_ - 1) * work_(r_ + rows_, cols_ - 1);
  }

  const Problem& p_;
  Solution& solution_;
  Index r_, m_, held_;         // held_: number of inputs in z
  Index used_ = 0, cols_ = 0;  // rows and columns of work_ at this step
  Index rows_ = 0;             // of Γ
  double constant_ = 0.0;
  Matrix work_, root_;
  Vector gamma_;
};

}  // namespace

Roots::Roots(const std::string& name, const std::vector<Matrix>& weights, Index size, Index steps) {
  if (weights.empty()) return;
  need_count(name, weights.size(), steps);
  for (const Matrix& weight : weights) {
    need_square(name, weight, size);
    const std::optional<Matrix> factor = linalg::covariance_factor(weight);
    if (!factor)
      throw std::invalid_argument(fmt::format(
          "{}: a matrix that is no weight found; a symmetric matrix without negative eigenvalues needed", name));
    roots_.emplace_back(factor->transpose());
  }
}

// Without the columns of some entries, FᵀF is the weight of the other ones.
void Roots::leave_out_missing(const Matrix& targets) {
  if (empty() || !targets.hasNaN()) return;
  if (count() == 1) roots_.resize(size_t(targets.rows()), Matrix(roots_.front()));
  for (Index s = 0; s < targets.rows(); ++s)
    for (Index j = 0; j < targets.cols(); ++j)
      if (std::isnan(targets(s, j))) roots_[size_t(s)].col(j).setZero();
}

Matrix weight_at(const std::vector<Matrix>& weights, Index s, Index size) {
  if (weights.empty()) return Matrix::Zero(size, size);
  return weights.size() == 1 ? weights.front() : weights[size_t(s)];
}

std::vector<Matrix> with_terminal(const std::vector<Matrix>& output, const Matrix& terminal, Index size, Index steps) {
  if (terminal.size() == 0) return output;
  Roots("terminal", {terminal}, size, 1);  // checks it
  if (!output.empty()) need_count("output", output.size(), steps);
  std::vector<Matrix> all;
  for (Index s = 0; s < steps; ++s) all.push_back(weight_at(output, s, size));
  need_square("output", all.back(), size);
  all.back() += terminal;
  return all;
}

Solution solve(const Problem& p, bool keep_roots) {
  need_positive_definite(p);
  Solution solution;
  const size_t steps = size_t(p.steps);
  solution.K.resize(steps);
  if (!p.rate.empty()) solution.L.resize(steps);
  if (p.has_targets()) solution.v.resize(p.steps, p.model.inputs);
  solution.c.resize(p.steps + 1);
  if (keep_roots) {
    solution.root.resize(steps + 1);
    if (p.has_targets()) solution.gamma.resize(steps + 1);
  }
  Recursion recursion(p, solution);
  for (Index s = p.steps; s >= 0; --s) {
    if (s < p.steps) {
      checkpoint();
      recursion.go_back(s);
    }
    solution.c(s) = recursion.constant();
    if (!keep_roots) continue;
    solution.root[size_t(s)] =
        s < p.steps
            ? recursion.root(p.begin + s)
            : Matrix(0, step_at(p.model, p.begin + s - 1).next_states() + (p.rate.empty() ? 0 : p.model.inputs));
    if (p.has_targets()) solution.gamma[size_t(s)] = recursion.gamma();
  }
  return solution;
}

}  // namespace tokid::lq
