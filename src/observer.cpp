// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/observer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <ranges>
#include <stdexcept>

namespace tokid {

namespace {

// Directions of the innovations below this share of the largest carry nothing but rounding errors.
constexpr double singular = 1e-12;

}  // namespace

std::vector<double> deadbeat_products(const Model& model, Index p) {
  if (p < 1) throw std::invalid_argument(fmt::format("p: {} found, at least 1 needed", p));
  std::vector<double> norms;
  for (Index k = model.k_begin; k + p <= model.k_end(); ++k) {
    Matrix product = model.closed_loop(k);
    for (Index j = k + 1; j < k + p; ++j) product = model.closed_loop(j) * product;
    norms.push_back(product.norm());
  }
  return norms;
}

namespace {

// S_j(k): the states that the last outputs could not see, as an orthonormal basis, and for how many steps. Stages of
// the same dimension are the same subspace; only the oldest is kept, so that a flag has at most n of them.
struct Stage {
  Matrix basis;   // (n × dim)
  Index age = 0;  // j
};

// The part of a basis that C maps to outputs not yet lifted, as the pair (outputs reached, states that reach them), and
// the part that C can't see.
struct Lift {
  Matrix outputs;  // (m × q) orthonormal
  Matrix states;   // (n × q) with C·states = outputs
  Matrix unseen;   // (n × (dim - …)) orthonormal: S ∩ ker C
};

Lift split_by_output(const Matrix& c, const Matrix& basis, const Matrix& lifted, double threshold) {
  Lift lift;
  const Matrix seen = c * basis;
  {
    const linalg::Svd d = linalg::svd(seen.transpose());  // right null space of seen, from its full set of directions
    const Index rank = (d.s.array() > threshold).count();
    // S ∩ ker C: orthogonal complement, within the basis, of the directions that C sees.
    const Matrix visible = d.u.leftCols(rank);
    const Matrix rest = Matrix::Identity(basis.cols(), basis.cols()) - visible * visible.transpose();
    lift.unseen = basis * linalg::svd(rest).u.leftCols(basis.cols() - rank);
  }
  const Matrix fresh = seen - lifted * (lifted.transpose() * seen);  // outputs that no smaller S_j reaches
  const linalg::Svd d = linalg::svd(fresh);
  const Index rank = (d.s.array() > threshold).count();
  lift.outputs = d.u.leftCols(rank);
  lift.states = basis * d.v.leftCols(rank) * d.s.head(rank).cwiseInverse().asDiagonal();
  return lift;
}

}  // namespace

DeadbeatGain deadbeat_gain(const Model& model, double tolerance) {
  DeadbeatGain result;
  const Index m = model.outputs;
  std::vector<Stage> flag;  // S_0 ⊃ S_1 ⊃ … at the present step
  if (model.steps() > 0) flag.push_back({Matrix::Identity(model.state_dim[0], model.state_dim[0]), 0});
  for (Index k = model.k_begin; k < model.k_end(); ++k) {
    const size_t s = model.at(k);
    const Matrix& a = model.A[s];
    const Matrix& c = model.C[s];
    const Index n = model.state_dim[s], next = model.state_dim[s + 1];
    const double see = tolerance * c.norm(), move = tolerance * a.norm();

    // Every direction of the next state may hold a new error; what has survived j steps ages by one.
    std::vector<Stage> following{{Matrix::Identity(next, next), 0}};
    // Lift from the smallest subspace outwards, so that the outputs of S_j are answered by states of S_j.
    Matrix lift = Matrix::Zero(n, m), outputs(m, 0);
    std::vector<Stage> survivors;
    for (const Stage& stage : std::views::reverse(flag)) {
      const Lift part = split_by_output(c, stage.basis, outputs, see);
      // States whose outputs reach into what is lifted already are corrected by those lifts.
      const Matrix states = part.states - lift * (c * part.states - part.outputs);
      lift += states * part.outputs.transpose();
      Matrix joined(m, outputs.cols() + part.outputs.cols());
      joined << outputs, part.outputs;
      outputs = std::move(joined);
      const linalg::Svd image = linalg::svd(a * part.unseen);
      const Index dim = (image.s.array() > move).count();
      if (dim > 0) survivors.push_back({image.u.leftCols(dim), stage.age + 1});
    }
    result.G.emplace_back(-a * lift);

    for (Stage& survivor : std::views::reverse(survivors)) {
      if (survivor.basis.cols() == following.back().basis.cols())
        following.back() = std::move(survivor);
      else
        following.push_back(std::move(survivor));
    }
    flag = std::move(following);
    result.steps = std::max(result.steps, flag.back().age + 1);
  }
  return result;
}

namespace {

Matrix factor_of(const Matrix& covariance, const char* name, Index k, Index size) {
  if (covariance.rows() != size || covariance.cols() != size)
    throw std::invalid_argument(fmt::format("{}: {} x {} found at step {}, {} x {} needed", name, covariance.rows(),
                                            covariance.cols(), k, size, size));
  std::optional<Matrix> factor = linalg::covariance_factor(covariance);
  if (!factor)
    throw std::invalid_argument(fmt::format(
        "{}: no covariance at step {}; a symmetric matrix without negative eigenvalues is needed", name, k));
  return std::move(*factor);
}

// F·Fᵀ, symmetric to the last bit.
Matrix square(const Matrix& factor) {
  Matrix product = Matrix::Zero(factor.rows(), factor.rows());
  product.selfadjointView<Eigen::Lower>().rankUpdate(factor);
  product.triangularView<Eigen::StrictlyUpper>() = product.transpose();
  return product;
}

}  // namespace

KalmanFilter kalman_filter(const Model& model) {
  model.check();
  if (model.steps() == 0) throw std::invalid_argument("model: no step found, at least one needed");
  const auto given = [&](const std::vector<Matrix>& list, const char* name) {
    if (static_cast<Index>(list.size()) != model.steps())
      throw std::invalid_argument(
          fmt::format("{}: {} matrices found, {} (one for each step) needed: a Kalman filter "
                      "weighs process against measurement noise",
                      name, list.size(), model.steps()));
  };
  given(model.Q, "Q");
  given(model.R, "R");
  const Index m = model.outputs;
  KalmanFilter filter;
  Matrix s = Matrix::Zero(model.state_dim[0], model.state_dim[0]);  // P = s·sᵀ
  if (model.x0_cov.size() > 0) s = factor_of(model.x0_cov, "x0_cov", model.k_begin, model.state_dim[0]);
  filter.P.push_back(square(s));
  for (Index k = model.k_begin; k < model.k_end(); ++k) {
    const size_t step = model.at(k);
    const Index n = model.n(k), next = model.n(k + 1), q = s.cols();
    // Kᵀ solves min ‖F Kᵀ - [0; sᵀ]‖ with F = [R^{1/2}ᵀ; sᵀCᵀ], and what is left over is a root of Joseph's
    // P⁺ = (I - K C) P (I - K C)ᵀ + K R Kᵀ.
    Matrix f(m + q, m), rest = Matrix::Zero(m + q, n);
    f.topRows(m) = factor_of(model.R[step], "R", k, m).transpose();
    f.bottomRows(q) = s.transpose() * model.C[step].transpose();
    rest.bottomRows(q) = s.transpose();
    filter.innovation_cov.push_back(square(f.transpose()));
    Vector scale = f.colwise().norm();  // outputs in any units
    scale = (scale.array() > 0).select(scale.cwiseInverse(), 1.0);
    const linalg::MinimumNorm gain = linalg::minimum_norm(f * scale.asDiagonal(), rest, singular);
    filter.K.emplace_back(gain.x.transpose() * scale.asDiagonal());
    rest -= f * filter.K.back().transpose();

    Matrix stacked(m + q + next, next);
    stacked.topRows(m + q) = rest * model.A[step].transpose();
    stacked.bottomRows(next) = factor_of(model.Q[step], "Q", k, next).transpose();
    s = linalg::triangular_factor(stacked).transpose();
    filter.P.push_back(square(s));
  }
  return filter;
}

Model kalman_observer(Model model) {
  KalmanFilter filter = kalman_filter(model);
  for (size_t s = 0; s < filter.K.size(); ++s) model.G[s] = -model.A[s] * filter.K[s];
  model.K = std::move(filter.K);
  model.innovation_cov = std::move(filter.innovation_cov);
  return model;
}

}  // namespace tokid
