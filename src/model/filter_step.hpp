// One step of the Kalman filter with missing samples, for batches of experiments and for samples that arrive step by
// step. The latent vector is l_k = [x_k; missing inputs], and F = [A B] with the columns of B of the missing inputs.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <type_traits>
#include <vector>

#include "model/kalman_step.hpp"
#include "tokid/step.hpp"

namespace tokid::kalman {

// The covariances of the filter, step after step. They do not depend on samples.
class FilterCovariance {
 public:
  // Begins with P_0.
  void start(const Matrix& covariance);

  // True if the steps `before` and `own` have the same matrices and the same missing samples, and if the covariance no
  // longer changes. The correction of `before` then serves for `own`, and advance() is not needed.
  bool settled_as(const Step& before, const Step& own, bool same_missing) const;

  // The correction at a step with available outputs `there` and missing inputs `unknown`. input_square (r): the
  // variance of each input where it is missing.
  void correct(const Step& own, const std::vector<Index>& there, const std::vector<Index>& unknown,
               const Vector& input_square, Correction& c);
  // P_{k+1} = F P' Fᵀ + Q from the corrected P'.
  void advance(const Step& own, const std::vector<Index>& unknown, const Correction& c);

  const Matrix& P() const { return p_; }        // of x_k, or of x_{k+1} after advance()
  const Matrix& effect() const { return fp_; }  // F P', after advance()

  // What later steps need (base/archive.hpp).
  template <class Archive, class C>
  requires std::is_same_v<std::remove_const_t<C>, FilterCovariance>
  friend void fields(Archive& archive, C& c) { archive(c.steady_, c.p_); }

 private:
  bool steady_ = false;
  Matrix p_, prior_, f_, fp_, predicted_, h_, r_;  // kept to reuse their memory
  Workspace work_;
};

// Do covariances differ by at most 1e-14 in units of the standard deviations? Any difference counts where the product
// of the two variances is zero or outside the range of normal numbers.
bool nearly_equal(const ConstMatrixRef& a, const ConstMatrixRef& b);

// both = [a, these columns of b]
void with_columns(const ConstMatrixRef& a, const ConstMatrixRef& b, const std::vector<Index>& columns, Matrix& both);

// E[l_k | y_0 … y_k] (N × q) from x = E[x_k | y_0 … y_{k-1}] (N × n_k), for experiments with the same missing samples;
// u (N × r) and y (N × m) are zero where missing. `innovation` is y - C x - D u, zero where missing.
void correct_means(const Step& own, const std::vector<Index>& there, const Correction& c, const ConstMatrixRef& x,
                   const ConstMatrixRef& u, const ConstMatrixRef& y, Matrix& innovation, Eigen::Ref<Matrix> l);
// E[x_{k+1} | y_0 … y_k] (N × n_{k+1})
void advance_means(const Step& own, const std::vector<Index>& unknown, const ConstMatrixRef& l, const ConstMatrixRef& u,
                   Matrix& of_unknown, Eigen::Ref<Matrix> next);

}  // namespace tokid::kalman
