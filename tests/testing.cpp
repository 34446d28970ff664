// SPDX-License-Identifier: BSD-3-Clause
#include "testing.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <numeric>

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
    Step& step = model.step.emplace_back(size.n, size.n, size.r, size.m);
    step.A() = left * s.asDiagonal() * right;
    step.B() = random.matrix(size.n, size.r);
    step.C() = random.matrix(size.m, size.n);
    step.D() = random.matrix(size.m, size.r);
  }
  return model;
}

std::vector<Matrix> all(const Model& model, Step::View (Step::*part)() const) {
  std::vector<Matrix> result;
  for (const Step& step : model.step) result.emplace_back((step.*part)());
  return result;
}

std::vector<Index> state_dims(const Model& model) {
  std::vector<Index> result;
  for (Index k = model.k_begin; k <= model.k_end(); ++k) result.push_back(model.n(k));
  return result;
}

void set_gains(Model& model, const std::vector<Matrix>& G) {
  for (size_t s = 0; s < model.step.size(); ++s) model.step[s].G() = G[s];
}

Model constant_system(const SystemSize& size, Index steps, double growth, std::uint64_t seed) {
  Model model = random_system(size, steps, growth, seed);
  const Step first = model.step.front();
  model.step.assign(model.step.size(), first);
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
  const Matrix x0 = initial * random.matrix(system.n(system.k_begin), experiments);
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

std::vector<Index> range(Index begin, Index end) {
  std::vector<Index> list(size_t(std::max<Index>(0, end - begin)));
  std::iota(list.begin(), list.end(), begin);
  return list;
}

std::string name(const SystemSize& s) { return fmt::format("n{}m{}r{}", s.n, s.m, s.r); }

Index mentions(const std::vector<std::string>& texts, const std::string& part) {
  return std::count_if(texts.begin(), texts.end(),
                       [&](const std::string& text) { return text.find(part) != std::string::npos; });
}

Index mentions(const Findings& findings, const std::string& part) { return mentions(in_words(findings), part); }

}  // namespace tokid::testing
