// SPDX-License-Identifier: BSD-3-Clause
#include "model/filter_step.hpp"

#include <algorithm>
#include <cmath>

#include "linalg/tall_product.hpp"

namespace tokid::kalman {

bool nearly_equal(const ConstMatrixRef& a, const ConstMatrixRef& b) {
  constexpr double unchanged = 1e-14;
  for (Index j = 0; j < a.cols(); ++j)
    for (Index i = 0; i < a.rows(); ++i) {
      const double difference = (a(i, j) - b(i, j)) / unchanged;
      const double variances = std::max(0.0, b(i, i)) * std::max(0.0, b(j, j));
      // A product outside the range of normal numbers is no measure of a difference.
      if (difference != 0.0 && !(std::isnormal(variances) && difference * difference <= variances)) return false;
    }
  return true;
}

void with_columns(const ConstMatrixRef& a, const ConstMatrixRef& b, const std::vector<Index>& columns, Matrix& both) {
  both.resize(a.rows(), a.cols() + Index(columns.size()));
  both.leftCols(a.cols()) = a;
  both.rightCols(Index(columns.size())) = b(Eigen::all, columns);
}

void FilterCovariance::start(const Matrix& covariance) {
  p_ = covariance;
  steady_ = false;
}

bool FilterCovariance::settled_as(const Step& before, const Step& own, bool same_missing) const {
  return steady_ && same_missing && before.states() == own.states() && before.next_states() == own.next_states() &&
         before.next_states() == before.states() && before.A() == own.A() && before.B() == own.B() &&
         before.C() == own.C() && before.D() == own.D() && before.Q() == own.Q() && before.R() == own.R();
}

void FilterCovariance::correct(const Step& own, const std::vector<Index>& there, const std::vector<Index>& unknown,
                               const Vector& input_square, Correction& c) {
  const Index n = p_.rows(), q = n + Index(unknown.size());
  prior_.setZero(q, q);
  prior_.topLeftCorner(n, n) = p_;
  for (size_t i = 0; i < unknown.size(); ++i) prior_(n + Index(i), n + Index(i)) = input_square(unknown[i]);
  c.log_det = 0.0;
  if (there.empty()) {
    c.filtered = prior_;
    c.gain.setZero(q, own.outputs());
    return;
  }
  with_columns(own.C(), own.D(), unknown, h_);
  r_ = own.R();
  leave_out_missing(there, h_, r_);
  kalman::correct(prior_, h_, r_, work_, c);
}

void FilterCovariance::advance(const Step& own, const std::vector<Index>& unknown, const Correction& c) {
  with_columns(own.A(), own.B(), unknown, f_);
  propagate(c.filtered, f_, own.Q(), fp_, predicted_);
  steady_ = p_.rows() == predicted_.rows() && nearly_equal(predicted_, p_);
  p_ = predicted_;
}

void correct_means(const Step& own, const std::vector<Index>& there, const Correction& c, const ConstMatrixRef& x,
                   const ConstMatrixRef& u, const ConstMatrixRef& y, Matrix& innovation, Eigen::Ref<Matrix> l) {
  l.leftCols(own.states()) = x;
  l.rightCols(l.cols() - own.states()).setZero();
  if (there.empty()) return;
  innovation.resize(y.rows(), own.outputs());
  linalg::tall_products(y, {{x, own.C(), true}, {u, own.D(), true}}, innovation);
  each_missing(there, own.outputs(), [&](Index j) { innovation.col(j).setZero(); });
  linalg::tall_products(l, {{innovation, c.gain}}, l);
}

void advance_means(const Step& own, const std::vector<Index>& unknown, const ConstMatrixRef& l, const ConstMatrixRef& u,
                   Matrix& of_unknown, Eigen::Ref<Matrix> next) {
  of_unknown = own.B()(Eigen::all, unknown);
  linalg::tall_products(
      {{l.leftCols(own.states()), own.A()}, {u, own.B()}, {l.rightCols(Index(unknown.size())), of_unknown}}, next);
}

}  // namespace tokid::kalman
