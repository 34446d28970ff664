// The finite-horizon linear-quadratic problem with targets, by a backward recursion of square roots.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/model.hpp"

namespace tokid::lq {

// Roots F of the weights FᵀF: one for all steps or one for each. Empty: no weight.
class Roots {
 public:
  Roots() = default;
  // `name` stands for the weights in messages.
  // \throws std::invalid_argument for a wrong number or shape of weights, or a weight that is no covariance
  Roots(const std::string& name, const std::vector<Matrix>& weights, Index size, Index steps);

  bool empty() const { return roots_.empty(); }
  const Matrix& at(Index s) const { return roots_.size() == 1 ? roots_.front() : roots_[size_t(s)]; }
  Index count() const { return Index(roots_.size()); }

  // Takes the weight of the entries that are NaN in `targets` (S × size) away.
  void leave_out_missing(const Matrix& targets);

 private:
  std::vector<Matrix> roots_;
};

// The weights at step s of S steps; a zero matrix if none are stated.
Matrix weight_at(const std::vector<Matrix>& weights, Index s, Index size);
// The output weights of all steps, with `terminal` (if not empty) added at the last one. As Roots, with the names
// "output" and "terminal" in messages. \throws as Roots
std::vector<Matrix> with_terminal(const std::vector<Matrix>& output, const Matrix& terminal, Index size, Index steps);

// Minimise the sum over s = 0 … S-1, k = begin + s, of
//   |F_y (C x_k + D u_k - y°_s)|² + |F_u (u_k - u°_s)|² + |F_c u_k|² + |F_d (u_k - u_{k-1} - d°_s)|²
// Targets (S × m or S × r) are zero if they are null.
struct Problem {
  const Model& model;
  Index begin, steps;
  Roots output, input, change, rate;
  const Matrix *y_target = nullptr, *u_target = nullptr, *rate_target = nullptr;

  bool has_targets() const { return y_target || u_target || rate_target; }
};

// u_k = v_s - K_s x_k - L_s u_{k-1}; the smallest cost from step k on is |Γ_s z - γ_s|² + c_s with z = x_k, or z =
// [x_k; u_{k-1}] if there is a weight on the rate.
struct Solution {
  std::vector<Matrix> K, L;
  Matrix v;                   // (S × r), empty without targets
  std::vector<Matrix> root;   // (S+1) Γ, upper triangular or trapezoidal; empty unless kept
  std::vector<Vector> gamma;  // (S+1), empty without targets or unless kept
  Vector c;                   // (S+1)
};

// \throws std::invalid_argument if no input, input-change or input-rate weight is positive definite, or if their sum is
// singular at a step
Solution solve(const Problem& problem, bool keep_roots);

}  // namespace tokid::lq
