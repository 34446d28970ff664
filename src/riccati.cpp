// SPDX-License-Identifier: BSD-3-Clause
#include "riccati.hpp"

#include <algorithm>

#include "regressions.hpp"

namespace tokid {

namespace {

// Directions of the innovations below this share of the largest carry nothing but rounding errors.
constexpr double singular = 1e-12;

// Periods after which the gains of a periodic model have settled.
constexpr Index most_settling = 1000;
constexpr double settled = 1e-13;

class Riccati {
 public:
  Riccati(const Model& model, const NoiseRoots& noise)
      : model_(model), noise_(noise), root_(Matrix::Zero(0, model.state_dim.front())) {}

  Matrix covariance() const { return covariance_of(root_); }

  struct Step {
    Matrix gain, innovation_cov;
  };
  Step advance(size_t s) {
    const Matrix& sigma = noise_.innovation[s];
    Matrix seen = linalg::stacked(sigma, root_ * model_.C[s].transpose());
    drop_rounding(seen, noise_.output_size);
    Matrix rest = linalg::stacked(-sigma * model_.G[s].transpose(), root_ * model_.A[s].transpose());
    rest = linalg::stacked(rest, Matrix::Zero(seen.cols(), rest.cols()));
    const Matrix gain = prediction_gain(linalg::stacked(seen, missing_noise(seen)), rest);
    Matrix next = linalg::stacked(rest, noise_.state[s]);
    root_ = linalg::triangular_factor(next);
    return {-gain, covariance_of(seen)};
  }

 private:
  Matrix missing_noise(const Matrix& seen) const {
    const Vector norm = seen.colwise().norm();
    const Vector& size = noise_.output_size;
    double noisiest = 0.0;
    for (Index j = 0; j < size.size(); ++j)
      if (size(j) > 0) noisiest = std::max(noisiest, norm(j) / size(j));
    const Vector missing = (least_noise * noisiest * size).cwiseAbs2() - norm.cwiseAbs2();
    return missing.cwiseMax(0.0).cwiseSqrt().asDiagonal();
  }

  const Model& model_;
  const NoiseRoots& noise_;
  Matrix root_;  // of P
};

}  // namespace

Matrix prediction_gain(const Matrix& seen, Matrix& rest) {
  Vector scale = seen.colwise().norm();  // outputs in any units
  scale = (scale.array() > 0).select(scale.cwiseInverse(), 1.0);
  const Matrix transposed = scale.asDiagonal() * linalg::minimum_norm(seen * scale.asDiagonal(), rest, singular).x;
  rest -= seen * transposed;
  return transposed.transpose();
}

Matrix covariance_of(const Matrix& root) {
  Matrix product = Matrix::Zero(root.cols(), root.cols());
  product.selfadjointView<Eigen::Lower>().rankUpdate(root.transpose());
  product.triangularView<Eigen::StrictlyUpper>() = product.transpose();
  return product;
}

void drop_rounding(Matrix& residuals, const Vector& size) {
  for (Index j = 0; j < residuals.cols(); ++j)
    if (size(j) == 0 || residuals.col(j).norm() <= rounding_share * size(j)) residuals.col(j).setZero();
}

void filter_gains(Model& model, const NoiseRoots& noise) {
  Riccati filter(model, noise);
  Matrix before;
  for (Index round = 0; model.period > 0 && round < most_settling; ++round) {
    before = filter.covariance();
    for (Index s = 0; s < std::min(model.period, model.steps()); ++s) filter.advance(size_t(s));
    if ((filter.covariance() - before).norm() <= settled * filter.covariance().norm()) break;
  }
  std::vector<Riccati::Step> steady;
  for (size_t s = 0; s < model.A.size(); ++s) steady.push_back(filter.advance(s));
  model.innovation_cov.clear();
  for (size_t s = 0; s < steady.size(); ++s) {
    model.G[s] = std::move(steady[s].gain);
    model.innovation_cov.push_back(std::move(steady[s].innovation_cov));
  }
}

}  // namespace tokid
