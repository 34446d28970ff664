// SPDX-License-Identifier: BSD-3-Clause
#include "model/riccati.hpp"

#include <algorithm>
#include <optional>

#include "base/rounding.hpp"
#include "linalg/symmetric.hpp"
#include "model/kalman_step.hpp"

namespace tokid {

namespace {

// Number of periods after which the gains of a periodic model are steady.
constexpr Index most_settling = 1000;
constexpr double settled = 1e-13;
// Number of doublings, for many more steps than any filter needs.
constexpr Index most_doublings = 50;

// The filter over several steps, as it depends on the covariance P before them:
// P⁺ = A (I + P J)⁻¹ P Aᵀ + C, with C and J as roots (· × n).
struct Stretch {
  Matrix a, c, j;

  Matrix covariance() const { return kalman::covariance_of(c); }
  bool finite() const { return a.allFinite() && c.allFinite() && j.allFinite(); }
};

// Both stretches, one after the other. With W = J₂ C₁ᵀ of the roots and M = I + WᵀW:
// A = A₂ A₁ - A₂ C₁ᵀ M⁻¹ Wᵀ J₂ A₁, CᵀC = A₂ C₁ᵀ M⁻¹ C₁ A₂ᵀ + C₂ᵀC₂, JᵀJ = A₁ᵀ J₂ᵀ (I + W Wᵀ)⁻¹ J₂ A₁ + J₁ᵀJ₁
Stretch joined(const Stretch& first, const Stretch& second) {
  const auto root_of_both = [](const ConstMatrixRef& a, const ConstMatrixRef& b) {
    Matrix rows = linalg::stacked(a, b);
    return linalg::triangular_factor(rows);
  };
  // (root of I + WᵀW)⁻ᵀ x
  const auto whitened = [&](const Matrix& w, const Matrix& x) {
    const Matrix root = root_of_both(w, Matrix::Identity(w.cols(), w.cols()));
    return Matrix(root.triangularView<Eigen::Upper>().transpose().solve(x));
  };
  const Matrix w = second.j * first.c.transpose(), ja = second.j * first.a;
  const Matrix ca = whitened(w, first.c * second.a.transpose());
  return {second.a * first.a - ca.transpose() * whitened(w, w.transpose() * ja), root_of_both(ca, second.c),
          root_of_both(whitened(w.transpose(), ja), first.j)};
}

class Riccati {
 public:
  Riccati(const Model& model, const NoiseRoots& noise)
      : model_(model), noise_(noise), root_(Matrix::Zero(0, model.n(model.k_begin))) {}

  Matrix covariance() const { return kalman::covariance_of(root_); }

  // Begins near the steady covariance of a period. Each doubling of the stretch costs about as much as one step, and a
  // slow filter settles only after hundreds of steps. Without noise of an output, it begins with P = 0.
  void approach_steady(Index period) {
    std::optional<Stretch> all;
    for (size_t s = 0; s < size_t(period); ++s) {
      const Matrix& sigma = noise_.innovation[s % noise_.innovation.size()];
      Matrix whitener;
      if (!(sigma.norm() > 0) || sigma.rows() < sigma.cols() || missing_noise(sigma).rows() > 0) return;
      linalg::inverse_root(kalman::covariance_of(sigma), whitener);
      const auto& step = model_.step[s];
      const Stretch one{step.A() + step.G() * step.C(), noise_.state[s % noise_.state.size()], whitener * step.C()};
      all = all ? joined(*all, one) : one;
    }
    for (Index i = 0; all && i < most_doublings; ++i) {
      const Matrix before = all->covariance();
      all = joined(*all, *all);
      if (!all->finite()) return;
      if (!((all->covariance() - before).norm() <= settled * before.norm())) continue;
      root_ = all->c;
      return;
    }
  }

  struct Step {
    Matrix gain, innovation_cov;
  };
  // A filter step with l = [x; ε] and no other noise of the outputs: y = C x + ε. F = [A -G] and w = w'.
  Step advance(size_t s) {
    const Matrix& sigma = noise_.innovation[s % noise_.innovation.size()];
    Matrix seen = linalg::stacked(sigma, root_ * model_.step[s].C().transpose());
    drop_rounding(seen, noise_.output_size);
    Matrix rest = linalg::stacked(-sigma * model_.step[s].G().transpose(), root_ * model_.step[s].A().transpose());
    const Matrix missing = missing_noise(seen);
    rest = linalg::stacked(rest, Matrix::Zero(missing.rows(), rest.cols()));
    const Matrix gain = kalman::prediction_gain(linalg::stacked(seen, missing), rest);
    root_ = kalman::next_root(rest, noise_.state[s % noise_.state.size()]);
    return {-gain, kalman::covariance_of(seen)};
  }

 private:
  // A root of the noise that must be added to the innovations, so that each direction has at least least_noise.
  Matrix missing_noise(const Matrix& seen) const {
    const Vector& size = noise_.output_size;
    const Vector unit = (size.array() > 0).select(size.cwiseInverse(), 0.0);
    const auto [variance, directions] = linalg::symmetric_eigensystem(kalman::covariance_of(seen * unit.asDiagonal()));
    const double least = least_noise * least_noise * variance(variance.size() - 1);
    const Index lacking = (variance.array() < least).count();
    return (least - variance.head(lacking).array().max(0.0)).sqrt().matrix().asDiagonal() *
           directions.leftCols(lacking).transpose() * size.asDiagonal();
  }

  const Model& model_;
  const NoiseRoots& noise_;
  Matrix root_;  // root of P
};

}  // namespace

void drop_rounding(Matrix& residuals, const Vector& size) {
  for (Index j = 0; j < residuals.cols(); ++j)
    if (size(j) == 0 || residuals.col(j).norm() <= rounding_share * size(j)) residuals.col(j).setZero();
}

void filter_gains(Model& model, const NoiseRoots& noise) {
  Riccati filter(model, noise);
  Matrix before;
  bool steady = false;
  if (model.period > 0) filter.approach_steady(std::min(model.period, model.steps()));
  for (Index round = 0; model.period > 0 && !steady && round < most_settling; ++round) {
    before = filter.covariance();
    for (Index s = 0; s < std::min(model.period, model.steps()); ++s) filter.advance(size_t(s));
    steady = (filter.covariance() - before).norm() <= settled * filter.covariance().norm();
  }
  // The filter needs the gains of the noise, and the new ones replace them. The steady gains of one period hold for
  // all.
  const size_t all = model.step.size(), own = steady ? std::min(size_t(model.period), all) : all;
  std::vector<Riccati::Step> found;
  for (size_t s = 0; s < own; ++s) found.push_back(filter.advance(s));
  for (size_t s = 0; s < own; ++s) {
    model.step[s].G() = found[s].gain;
    model.step[s].set_innovation_cov(found[s].innovation_cov);
  }
  for (size_t s = own; s < all; ++s) model.step[s] = model.step[s - own];
}

}  // namespace tokid
