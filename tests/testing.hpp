// Seeded random systems and scaled errors for the property tests.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>

#include "tokid/ensemble.hpp"
#include "tokid/linalg.hpp"
#include "tokid/model.hpp"

namespace tokid::testing {

inline constexpr double epsilon = std::numeric_limits<double>::epsilon();

// What a refused call says of it.
template <class Call>
std::string message(Call&& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "no exception";
}

class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}
  double normal() { return normal_(engine_); }
  double uniform(double a, double b) { return a + (b - a) * std::generate_canonical<double, 53>(engine_); }
  Matrix matrix(Index rows, Index cols) {
    return Matrix::NullaryExpr(rows, cols, [this] { return normal(); });
  }
  Matrix orthogonal(Index n) { return linalg::orthonormal_factor(matrix(n, n)); }

 private:
  std::mt19937_64 engine_;
  std::normal_distribution<double> normal_;
};

struct SystemSize {
  Index n, m, r;
};

// Independent A_k at every step, each with singular values between 0.7 and 1 times `growth`: above about 1.2 the origin
// is unstable. Nothing is slow, symmetric or sparse about it.
inline Model random_system(const SystemSize& size, Index steps, double growth, std::uint64_t seed) {
  Random random(seed);
  Model model;
  model.inputs = size.r;
  model.outputs = size.m;
  model.method = "known";
  for (Index k = 0; k < steps; ++k) {
    Vector s(size.n);
    for (double& value : s) value = growth * random.uniform(0.7, 1.0);
    model.A.push_back(random.orthogonal(size.n) * s.asDiagonal() * random.orthogonal(size.n));
    model.B.push_back(random.matrix(size.n, size.r));
    model.C.push_back(random.matrix(size.m, size.n));
    model.D.push_back(random.matrix(size.m, size.r));
    model.G.push_back(Matrix::Zero(size.n, size.m));
  }
  model.state_dim.assign(size_t(steps) + 1, size.n);
  return model;
}

// The same matrices at every step.
inline Model constant_system(const SystemSize& size, Index steps, double growth, std::uint64_t seed) {
  Model model = random_system(size, steps, growth, seed);
  for (auto* list : {&model.A, &model.B, &model.C, &model.D})
    for (Matrix& a : *list) a = list->front();
  return model;
}

// Noise-free experiments with unit Gaussian inputs and initial states of the given size.
inline Ensemble with_noise(Ensemble e, double sigma, std::uint64_t seed) {
  Random random(seed);
  for (Index k = 0; k < e.steps(); ++k) e.output(k) += sigma * random.matrix(e.experiments(), e.outputs());
  return e;
}

inline Ensemble random_experiments(const Model& system, Index experiments, std::uint64_t seed, double initial = 0.0) {
  Random random(seed);
  Ensemble e(experiments, system.steps(), system.inputs, system.outputs, system.dt);
  for (Index k = 0; k < e.steps(); ++k) e.input(k) = random.matrix(experiments, e.inputs());
  const Matrix x0 = initial * random.matrix(system.state_dim.front(), experiments);
  return simulate(system, e, x0);
}

// Largest error of the outputs over the steps where both are known, relative to the largest output of the same step and
// channel: unstable systems are judged at every step, not at the last alone. Infinite where nothing could be compared.
inline double output_error(const Ensemble& truth, const Ensemble& computed, Index from = 0) {
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

// p with p·m ≥ n.
inline Index smallest_lag_order(const SystemSize& size) { return (size.n + size.m - 1) / size.m; }

inline std::string name(const SystemSize& s) {
  return "n" + std::to_string(s.n) + "m" + std::to_string(s.m) + "r" + std::to_string(s.r);
}

}  // namespace tokid::testing
