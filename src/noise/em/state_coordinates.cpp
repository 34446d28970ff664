// SPDX-License-Identifier: BSD-3-Clause
#include "noise/em/state_coordinates.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <utility>

#include "linalg/symmetric.hpp"

namespace tokid::em {

namespace {

// Gauss-Newton steps, and iterations of conjugate gradients in each. The first iterations remove what changes from step
// to step, such as the noise of coordinates that were estimated step by step. Slow changes remain, but cost little.
constexpr int newton_steps = 3, gradient_iterations = 20;
// A step is halved at most so many times.
constexpr int halvings = 3;

// Σ ‖V^{-1/2} (Θ_k - Θ_{k-1}) W^{1/2}‖² over the steps without jumps
double square_of_changes(const linalg::MatrixList& theta, const std::vector<Index>& jumps, const Matrix& reference,
                         const Vector& weight) {
  const Index l = theta.cols(), changes = theta.size() - 1;
  const Matrix& all = theta.together();
  const Matrix difference = whitener_of(reference) * (all.rightCols(l * changes) - all.leftCols(l * changes));
  double sum = 0.0;
  for (Index k = 1; k <= changes; ++k)
    if (!std::binary_search(jumps.begin(), jumps.end(), k))
      sum += difference.middleCols(l * (k - 1), l).colwise().squaredNorm().dot(weight);
  return sum;
}

// The changes of the matrices, weighted as in the variation, one after the other.
struct Changes {
  linalg::MatrixList a, b, c;  // (T-1) n × n, n × r, m × n

  double squared_norm() const {
    return a.together().squaredNorm() + b.together().squaredNorm() + c.together().squaredNorm();
  }
  void add(double factor, const Changes& other) {
    a.together() += factor * other.a.together();
    b.together() += factor * other.b.together();
    c.together() += factor * other.c.together();
  }
};

// The changes as linear functions of E_1 … E_T, where the new states are (I + E_k) x_k. E_0 = 0, so that the
// distribution of x_0 stays the same. In coordinates in which V = I, they are (A_{k+1} - A_k + E_{k+2} A_{k+1} -
// A_{k+1} E_{k+1} - E_{k+1} A_k + A_k E_k) W^{1/2}, (B_{k+1} - B_k + E_{k+2} B_{k+1} - E_{k+1} B_k) W^{1/2} and
// (C_{k+1} - C_k - C_{k+1} E_{k+1} + C_k E_k) W^{1/2}. D does not depend on the coordinates.
class Linearised {
 public:
  Linearised(const linalg::MatrixList& ab, const linalg::MatrixList& cd, const Variation& variation)
      : n_(ab.rows()),
        r_(ab.cols() - n_),
        m_(cd.rows()),
        steps_(ab.size()),
        jumps_(variation.jumps),
        to_white_(whitener_of(variation.process_reference)),
        from_white_(to_white_.inverse()),
        weight_a_(to_white_ * variation.process_weight.head(n_).cwiseSqrt().asDiagonal()),
        weight_c_(to_white_ * variation.measurement_weight.head(n_).cwiseSqrt().asDiagonal()),
        weight_b_(variation.process_weight.tail(r_).cwiseSqrt()),
        a_(steps_, n_, n_),
        b_(steps_, n_, r_),
        c_(steps_, m_, n_) {
    const Matrix of_outputs = whitener_of(variation.measurement_reference);
    for (size_t k = 0; k < size_t(steps_); ++k) {
      a_[k] = to_white_ * ab[k].leftCols(n_) * from_white_;
      b_[k] = to_white_ * ab[k].rightCols(r_);
      c_[k] = of_outputs * cd[k].leftCols(n_) * from_white_;
    }
  }

  Index unknowns() const { return steps_ + 1; }
  Changes zero() const { return {{steps_ - 1, n_, n_}, {steps_ - 1, n_, r_}, {steps_ - 1, m_, n_}}; }

  // E = 0
  Changes changes() const {
    Changes result = zero();
    for_each([&](size_t k) {
      result.a[k] = (a_[k + 1] - a_[k]) * weight_a_;
      result.b[k] = (b_[k + 1] - b_[k]) * weight_b_.asDiagonal();
      result.c[k] = (c_[k + 1] - c_[k]) * weight_c_;
    });
    return result;
  }

  // The linear part. Products of small matrices are not worth blocks.
  void apply(const linalg::MatrixList& e, Changes& result) const {
    Matrix a(n_, n_), b(n_, r_), c(m_, n_);
    for_each([&](size_t k) {
      a.noalias() = e[k + 2].lazyProduct(a_[k + 1]);
      a.noalias() -= a_[k + 1].lazyProduct(e[k + 1]);
      a.noalias() -= e[k + 1].lazyProduct(a_[k]);
      a.noalias() += a_[k].lazyProduct(e[k]);
      result.a[k].noalias() = a.lazyProduct(weight_a_);
      b.noalias() = e[k + 2].lazyProduct(b_[k + 1]);
      b.noalias() -= e[k + 1].lazyProduct(b_[k]);
      result.b[k] = b * weight_b_.asDiagonal();
      c.noalias() = c_[k].lazyProduct(e[k]);
      c.noalias() -= c_[k + 1].lazyProduct(e[k + 1]);
      result.c[k].noalias() = c.lazyProduct(weight_c_);
    });
  }

  // Its transpose.
  void apply_transposed(const Changes& changes, linalg::MatrixList& e) const {
    e.together().setZero();
    Matrix a(n_, n_), b(n_, r_), c(m_, n_);
    for_each([&](size_t k) {
      a.noalias() = changes.a[k].lazyProduct(weight_a_.transpose());
      b = changes.b[k] * weight_b_.asDiagonal();
      c.noalias() = changes.c[k].lazyProduct(weight_c_.transpose());
      e[k + 2].noalias() += a.lazyProduct(a_[k + 1].transpose());
      e[k + 2].noalias() += b.lazyProduct(b_[k + 1].transpose());
      e[k + 1].noalias() -= a_[k + 1].transpose().lazyProduct(a);
      e[k + 1].noalias() -= a.lazyProduct(a_[k].transpose());
      e[k + 1].noalias() -= b.lazyProduct(b_[k].transpose());
      e[k + 1].noalias() -= c_[k + 1].transpose().lazyProduct(c);
      e[k].noalias() += a_[k].transpose().lazyProduct(a);
      e[k].noalias() += c_[k].transpose().lazyProduct(c);
    });
    e[0].setZero();
  }

  // The E that conjugate gradients find for the smallest sum of squares, in the coordinates of the model.
  linalg::MatrixList minimum() const {
    linalg::MatrixList e(unknowns(), n_, n_), descent = e, direction = e;
    Changes rest = changes(), change = zero();
    apply_transposed(rest, descent);
    descent.together() *= -1.0;
    direction = descent;
    double square = descent.together().squaredNorm();
    for (int i = 0; i < gradient_iterations && square > 0; ++i) {
      apply(direction, change);
      const double curvature = change.squared_norm();
      if (!(curvature > 0)) break;
      const double length = square / curvature;
      e.together() += length * direction.together();
      rest.add(length, change);
      apply_transposed(rest, descent);
      descent.together() *= -1.0;
      const double next = descent.together().squaredNorm();
      direction.together() = descent.together() + next / square * direction.together();
      square = next;
    }
    for (size_t k = 0; k < size_t(unknowns()); ++k) e[k] = from_white_ * Matrix(e[k]) * to_white_;
    return e;
  }

 private:
  template <class Body>
  void for_each(Body&& body) const {
    for (Index k = 0; k + 1 < steps_; ++k)
      if (!std::binary_search(jumps_.begin(), jumps_.end(), k + 1)) body(size_t(k));
  }

  Index n_, r_, m_, steps_;
  const std::vector<Index>& jumps_;
  Matrix to_white_, from_white_;  // V^{-1/2} and V^{1/2}
  Matrix weight_a_, weight_c_;    // V^{-1/2} W^{1/2}
  Vector weight_b_;               // diagonal of W^{1/2}
  linalg::MatrixList a_, b_, c_;  // (T) with V = I
};

// The model with the states (I + share E_k) x_k.
Coordinates moved(const linalg::MatrixList& ab, const linalg::MatrixList& cd, const linalg::MatrixList& e,
                  double share) {
  const Index n = ab.rows(), r = ab.cols() - n;
  Coordinates result{ab, cd, {}};
  for (size_t k = 0; k < size_t(e.size()); ++k) result.s.push_back(Matrix::Identity(n, n) + share * e[k]);
  for (size_t k = 0; k < size_t(ab.size()); ++k) {
    const Matrix back = result.s[k].inverse();
    result.ab[k].leftCols(n) = result.s[k + 1] * ab[k].leftCols(n) * back;
    result.ab[k].rightCols(r) = result.s[k + 1] * ab[k].rightCols(r);
    result.cd[k].leftCols(n) = cd[k].leftCols(n) * back;
  }
  return result;
}

}  // namespace

Matrix whitener_of(const Matrix& covariance) {
  Matrix w;
  linalg::inverse_root(covariance, w);
  return w;
}

double Variation::of(const linalg::MatrixList& ab, const linalg::MatrixList& cd) const {
  return 0.5 * (square_of_changes(ab, jumps, process_reference, process_weight) +
                square_of_changes(cd, jumps, measurement_reference, measurement_weight));
}

std::optional<Coordinates> with_less_variation(const linalg::MatrixList& ab, const linalg::MatrixList& cd,
                                               const Variation& variation) {
  std::optional<Coordinates> best;
  double least = variation.of(ab, cd);
  for (int i = 0; i < newton_steps; ++i) {
    const linalg::MatrixList &ab_now = best ? best->ab : ab, &cd_now = best ? best->cd : cd;
    const linalg::MatrixList e = Linearised(ab_now, cd_now, variation).minimum();
    bool less = false;
    double share = 1.0;
    for (int j = 0; j <= halvings && !less; ++j, share /= 2) {
      Coordinates next = moved(ab_now, cd_now, e, share);
      const double found = variation.of(next.ab, next.cd);
      less = found < least;  // false if it is not finite
      if (!less) continue;
      least = found;
      for (size_t k = 0; best && k < next.s.size(); ++k) next.s[k] = next.s[k] * best->s[k];
      best = std::move(next);
    }
    if (!less) break;
  }
  return best;
}

}  // namespace tokid::em
