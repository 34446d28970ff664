// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/observer.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <ranges>
#include <stdexcept>

#include "model/kalman_step.hpp"

namespace tokid {

std::vector<double> deadbeat_products(const Model& model, Index p) {
  if (p < 1) throw std::invalid_argument(fmt::format("p: {} found, at least 1 needed", p));
  std::vector<double> norms;
  for (Index k = model.k_begin; k + p <= model.k_end(); ++k) {
    Matrix product = model.at(k).closed_loop();
    for (Index j = k + 1; j < k + p; ++j) product = model.at(j).closed_loop() * product;
    norms.push_back(product.norm());
  }
  return norms;
}

namespace {

// N_j(k), an orthonormal basis of the state errors that the last j outputs did not observe, and j. Stages of the same
// dimension are the same subspace, and only the oldest stage is kept. There are thus at most n stages.
struct Stage {
  Matrix basis;   // (n × dim)
  Index age = 0;  // j
};

// The split of a basis by C. The first part reaches outputs that were not reached before: pairs of an output and a
// state. The other part is not observed by C.
struct Lift {
  Matrix outputs;  // (m × q) orthonormal
  Matrix states;   // (n × q) with C·states = outputs
  Matrix unseen;   // (n × (dim - …)) orthonormal: S ∩ ker C
};

Lift split_by_output(const Matrix& c, const Matrix& basis, const Matrix& lifted, double threshold) {
  Lift lift;
  const Matrix seen = c * basis;
  {
    const linalg::Svd d = linalg::svd(seen.transpose());  // right null space of seen, from all of its directions
    const Index rank = (d.s.array() > threshold).count();
    // S ∩ ker C: the complement, within the basis, of the directions that C observes.
    const Matrix visible = d.u.leftCols(rank);
    const Matrix rest = Matrix::Identity(basis.cols(), basis.cols()) - visible * visible.transpose();
    lift.unseen = basis * linalg::svd(rest).u.leftCols(basis.cols() - rank);
  }
  const Matrix fresh = seen - lifted * (lifted.transpose() * seen);  // outputs that no smaller N_j reaches
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
  if (model.steps() > 0) flag.push_back({Matrix::Identity(model.n(model.k_begin), model.n(model.k_begin)), 0});
  for (Index k = model.k_begin; k < model.k_end(); ++k) {
    const size_t s = model.index(k);
    const Step::View a = model.step[s].A();
    const Step::View c = model.step[s].C();
    const Index n = model.step[s].states(), next = model.step[s].next_states();
    const double see = tolerance * c.norm(), move = tolerance * a.norm();

    // Every direction of the next state may have a new error (j = 0). An error that has survived j steps becomes one
    // that has survived j + 1 steps.
    std::vector<Stage> following{{Matrix::Identity(next, next), 0}};
    // The lift maps outputs to the states that correct them. It starts with the smallest subspace, so that states of
    // N_j correct the outputs that N_j reaches.
    Matrix lift = Matrix::Zero(n, m), outputs(m, 0);
    std::vector<Stage> survivors;
    for (const Stage& stage : std::views::reverse(flag)) {
      const Lift part = split_by_output(c, stage.basis, outputs, see);
      // Earlier lifts already correct a part of the outputs of these states. This part is subtracted.
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

// The root of a covariance rootᵀ·root.
Matrix root_of(const ConstMatrixRef& covariance, const char* name, Index k, Index size) {
  if (covariance.rows() != size || covariance.cols() != size)
    throw std::invalid_argument(fmt::format("{}: {} x {} found at step {}, {} x {} needed", name, covariance.rows(),
                                            covariance.cols(), k, size, size));
  const std::optional<Matrix> factor = linalg::covariance_factor(covariance);
  if (!factor)
    throw std::invalid_argument(fmt::format(
        "{}: no covariance at step {}; a symmetric matrix without negative eigenvalues is needed", name, k));
  return factor->transpose();
}

}  // namespace

KalmanFilter kalman_filter(const Model& model) {
  model.check();
  if (model.steps() == 0) throw std::invalid_argument("model: no step found, at least one needed");
  const auto given = [&](bool (Step::*part)() const, const char* name) {
    if (!model.has(part))
      throw std::invalid_argument(fmt::format(
          "{}: not known of this model, needed at each step: a Kalman filter weighs process against measurement noise",
          name));
  };
  given(&Step::has_Q, "Q");
  given(&Step::has_R, "R");
  KalmanFilter filter;
  Matrix root = Matrix::Zero(0, model.n(model.k_begin));  // Sᵀ, P = S Sᵀ
  if (model.x0_cov.size() > 0) root = root_of(model.x0_cov, "x0_cov", model.k_begin, model.n(model.k_begin));
  filter.P.push_back(kalman::covariance_of(root));
  for (Index k = model.k_begin; k < model.k_end(); ++k) {
    const size_t step = model.index(k);
    const Matrix noise = root_of(model.step[step].R(), "R", k, model.outputs);
    const Matrix seen = linalg::stacked(noise, root * model.step[step].C().transpose());
    Matrix rest = linalg::stacked(Matrix::Zero(noise.rows(), model.n(k)), root);
    filter.innovation_cov.push_back(kalman::covariance_of(seen));
    filter.K.push_back(kalman::prediction_gain(seen, rest));
    root = kalman::next_root(rest * model.step[step].A().transpose(),
                             root_of(model.step[step].Q(), "Q", k, model.n(k + 1)));
    filter.P.push_back(kalman::covariance_of(root));
  }
  return filter;
}

Model kalman_observer(Model model) {
  const KalmanFilter filter = kalman_filter(model);
  for (size_t s = 0; s < model.step.size(); ++s) {
    Step& step = model.step[s];
    step.G() = -step.A() * filter.K[s];
    step.set_K(filter.K[s]);
    step.set_innovation_cov(filter.innovation_cov[s]);
  }
  return model;
}

}  // namespace tokid
