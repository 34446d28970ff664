// SPDX-License-Identifier: BSD-3-Clause
#include "model/state_estimate.hpp"

#include <cmath>

#include "base/nan.hpp"
#include "linalg/tall_product.hpp"
#include "model/continuation.hpp"
#include "model/observer_step.hpp"

namespace tokid::observer {

namespace {

// Directions of the state count as not observed if their effect on the samples is below this share of the largest
// effect.
constexpr double unseen = 1e-12;

// One whitener for the whole window, because rounding errors may make the covariance of a single step singular.
Matrix whitener_of(const Model& model, Index k, Index steps) {
  Matrix covariance = Matrix::Zero(model.outputs, model.outputs);
  if (model.has(&Step::has_innovation_cov))
    for (Index j = k; j < k + steps; ++j) covariance += step_at(model, j).innovation_cov();
  return linalg::whitener(covariance);
}

// Does the part of the state that the samples of the window do not determine still act after the window?
bool matters_afterwards(const Matrix& sensitivity, const Matrix& transition, Index rank) {
  const Matrix seen = linalg::svd(sensitivity).v.leftCols(rank);
  return !((transition - transition * seen * seen.transpose()).norm() <= unseen);
}

}  // namespace

Matrix estimate(const Model& model, const Window& window) {
  const Index m = model.outputs, steps = Index(window.u.size()), n = states_at(model, window.k);
  const Index experiments = window.u.front().rows();
  const Matrix whitener = whitener_of(model, window.k, steps);
  Matrix sensitivity(steps * m, n), innovations(experiments, steps * m);
  Matrix transition = Matrix::Identity(n, n);  // transition of the error of x_k through the observer
  Matrix x = Matrix::Zero(experiments, n), e, next;
  for (Index j = 0; j < steps; ++j) {
    const Step& step = step_at(model, window.k + j);
    const Matrix &u = window.u[size_t(j)], &y = window.y[size_t(j)];
    innovation(step, x, u, y, e);
    Vector present = Vector::Ones(m);
    for (Index i = 0; i < m; ++i)
      if (!std::isfinite(y(0, i))) present(i) = 0.0, e.col(i).setZero();
    const Matrix seen = present.asDiagonal() * step.C();
    sensitivity.middleRows(j * m, m) = whitener * seen * transition;
    linalg::tall_products({{e, whitener}}, innovations.middleCols(j * m, m));
    next_state(step, x, u, e, next);
    x.swap(next);
    transition = (step.A() + step.G() * seen) * transition;
  }
  // The map from innovations to the state is computed first, so that the same bits result for any number of rows.
  const linalg::MinimumNorm map = linalg::minimum_norm(sensitivity, Matrix::Identity(steps * m, steps * m), unseen);
  if (map.rank < n && matters_afterwards(sensitivity, transition, map.rank))
    return Matrix::Constant(experiments, n, nan);
  Matrix states(experiments, n);
  linalg::tall_products({{innovations, map.x}}, states);
  return states;
}

}  // namespace tokid::observer
