// SPDX-License-Identifier: BSD-3-Clause
#include "riccati.hpp"

#include <algorithm>

namespace tokid {

namespace {

// Periods after which the gains of a periodic model have settled.
constexpr Index most_settling = 1000;
constexpr double settled = 1e-13;

class Riccati {
 public:
  Riccati(const Model& model, const std::vector<Matrix>& noise)
      : model_(model), noise_(noise), p_(Matrix::Zero(model.state_dim.front(), model.state_dim.front())) {}

  const Matrix& covariance() const { return p_; }

  struct Step {
    Matrix gain, innovation_cov;
  };
  Step advance(size_t s) {
    const Matrix &a = model_.A[s], &c = model_.C[s], &g = model_.G[s], &sigma = model_.innovation_cov[s];
    const Matrix pc = p_ * c.transpose();
    Matrix innovation = c * pc + sigma;
    const Matrix inverse = linalg::pseudo_inverse(innovation);
    // Joseph's form of the update keeps P positive semidefinite.
    const Matrix k = pc * inverse, rest = Matrix::Identity(p_.rows(), p_.rows()) - k * c, closed = a + g * c;
    const Matrix updated = rest * p_ * rest.transpose() + k * sigma * k.transpose();
    p_ = closed * updated * closed.transpose() + noise_[s];
    return {(g * sigma - a * pc) * inverse, std::move(innovation)};
  }

 private:
  const Model& model_;
  const std::vector<Matrix>& noise_;
  Matrix p_;
};

}  // namespace

void filter_gains(Model& model, const std::vector<Matrix>& noise) {
  Riccati filter(model, noise);
  Matrix before;
  for (Index round = 0; model.period > 0 && round < most_settling; ++round) {
    before = filter.covariance();
    for (Index s = 0; s < std::min(model.period, model.steps()); ++s) filter.advance(size_t(s));
    if ((filter.covariance() - before).norm() <= settled * filter.covariance().norm()) break;
  }
  std::vector<Riccati::Step> steady;
  for (size_t s = 0; s < model.A.size(); ++s) steady.push_back(filter.advance(s));
  for (size_t s = 0; s < steady.size(); ++s) {
    model.G[s] = steady[s].gain;
    model.innovation_cov[s] = steady[s].innovation_cov;
  }
}

}  // namespace tokid
