// SPDX-License-Identifier: BSD-3-Clause
#include "testing.hpp"

#include <fmt/format.h>

#include <algorithm>

namespace tokid::testing {

Matrix Random::matrix(Index rows, Index cols) {
  return Matrix::NullaryExpr(rows, cols, [this] { return normal(); });
}

Matrix Random::orthogonal(Index n) { return linalg::orthonormal_factor(matrix(n, n)); }

Model random_system(const SystemSize& size, Index steps, double growth, std::uint64_t seed) {
  Random random(seed);
  Model model;
  model.inputs = size.r;
  model.outputs = size.m;
  model.method = "known";
  for (Index k = 0; k < steps; ++k) {
    Vector s(size.n);
    for (double& value : s) value = growth * random.uniform(0.7, 1.0);
    // Each by itself: compilers differ in which operand of a product they draw first.
    const Matrix right = random.orthogonal(size.n), left = random.orthogonal(size.n);
    model.A.emplace_back(left * s.asDiagonal() * right);
    model.B.push_back(random.matrix(size.n, size.r));
    model.C.push_back(random.matrix(size.m, size.n));
    model.D.push_back(random.matrix(size.m, size.r));
    model.G.emplace_back(Matrix::Zero(size.n, size.m));
  }
  model.state_dim.assign(size_t(steps) + 1, size.n);
  return model;
}

Model constant_system(const SystemSize& size, Index steps, double growth, std::uint64_t seed) {
  Model model = random_system(size, steps, growth, seed);
  for (auto* list : {&model.A, &model.B, &model.C, &model.D})
    for (Matrix& a : *list) a = list->front();
  return model;
}

Ensemble with_noise(Ensemble e, double sigma, std::uint64_t seed) {
  Random random(seed);
  for (Index k = 0; k < e.steps(); ++k) e.output(k) += sigma * random.matrix(e.experiments(), e.outputs());
  return e;
}

Ensemble random_experiments(const Model& system, Index experiments, std::uint64_t seed, double initial) {
  Random random(seed);
  Ensemble e(experiments, system.steps(), system.inputs, system.outputs, system.dt);
  for (Index k = 0; k < e.steps(); ++k) e.input(k) = random.matrix(experiments, e.inputs());
  const Matrix x0 = initial * random.matrix(system.state_dim.front(), experiments);
  return simulate(system, e, x0);
}

double output_error(const Ensemble& truth, const Ensemble& computed, Index from) {
  double worst = 0.0;
  Index compared = 0;
  for (Index k = from; k < truth.steps(); ++k)
    for (Index j = 0; j < truth.outputs(); ++j) {
      const Vector y = truth.output(k).col(j), e = computed.output(k).col(j) - y;
      if (!e.allFinite()) continue;
      ++compared;
      worst = std::max(worst, e.cwiseAbs().maxCoeff() / y.cwiseAbs().maxCoeff());
    }
  return compared > 0 ? worst : std::numeric_limits<double>::infinity();
}

std::string name(const SystemSize& s) { return fmt::format("n{}m{}r{}", s.n, s.m, s.r); }

}  // namespace tokid::testing
