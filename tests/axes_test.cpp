// SPDX-License-Identifier: BSD-3-Clause
#include "data/axes.hpp"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <array>
#include <random>
#include <vector>

namespace tokid::testing {
namespace {

struct Campaign {
  Index experiments, steps, states, inputs, outputs;
  double radius;  // of the eigenvalues
  double noise;   // share of the outputs
  int kind;       // of the inputs: 0 white, 1 slow, 2 held for some steps, 3 nearly the same in all experiments
  bool moves;     // a mean motion, and an offset of each experiment
  double gaps;    // share of missing samples
};

// (N, T, channels) of a random system, or (T, N, channels).
Ensemble ensemble_of(const Campaign& c, unsigned seed, bool swapped) {
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> uniform;
  const auto matrix = [&](Index rows, Index cols) {
    return Matrix(Matrix::NullaryExpr(rows, cols, [&] { return normal(random); }));
  };
  const Matrix square = matrix(c.states, c.states);
  const Matrix A = c.radius * Matrix(square.householderQr().householderQ()), B = matrix(c.states, c.inputs),
               C = matrix(c.outputs, c.states);
  Ensemble e(swapped ? c.steps : c.experiments, swapped ? c.experiments : c.steps, c.inputs, c.outputs);
  const Matrix common = matrix(c.steps, c.inputs);
  for (Index n = 0; n < c.experiments; ++n) {
    Vector x = Vector::Zero(c.states), u = matrix(c.inputs, 1);
    const double offset = c.moves ? 3 * normal(random) : 0.0;
    for (Index k = 0; k < c.steps; ++k) {
      const Vector fresh = matrix(c.inputs, 1);
      if (c.kind == 0) u = fresh;
      if (c.kind == 1) u = 0.95 * u + 0.3 * fresh;
      if (c.kind == 2 && k % 4 == 0) u = fresh;
      if (c.kind == 3) u = common.row(k).transpose() + 0.1 * fresh;
      const Vector y = C * x + 0.2 * matrix(c.outputs, 1) * c.noise * std::sqrt(double(c.states));
      for (Index i = 0; i < c.inputs; ++i) (swapped ? e.u(k, n, i) : e.u(n, k, i)) = u(i);
      for (Index j = 0; j < c.outputs; ++j) {
        double& sample = swapped ? e.y(k, n, j) : e.y(n, k, j);
        if (uniform(random) >= c.gaps) sample = y(j) + (c.moves ? 5 * std::sin(0.2 * double(k)) + offset : 0.0);
      }
      x = A * x + B * u;
    }
  }
  return e;
}

Campaign campaign(unsigned seed) {
  std::mt19937 random(seed);
  const auto among = [&](auto... values) {
    const std::vector<double> list{double(values)...};
    return list[random() % list.size()];
  };
  return {Index(among(6, 12, 40, 120)), Index(among(6, 15, 40, 150)), Index(among(1, 2, 5)), Index(among(1, 2, 3)),
          Index(among(1, 2, 3)),        among(0.0, 0.3, 0.8, 0.98),   among(0.0, 0.5, 2.0),  int(among(0, 1, 2, 3)),
          among(0, 0, 1) > 0,           among(0.0, 0.0, 0.1)};
}

TEST(Axes, OrderedAxesRaiseNoAlarm) {
  for (unsigned seed = 1; seed <= 500; ++seed) {
    const Campaign c = campaign(seed);
    if (c.inputs == c.outputs && c.inputs > c.steps) continue;
    const auto remark = swapped_axes(ensemble_of(c, seed, false));
    EXPECT_FALSE(remark) << "seed " << seed << ": " << in_words(*remark);
  }
}

TEST(Axes, TimeBeforeExperimentsIsTold) {
  Index found = 0, all = 0;
  for (unsigned seed = 1; seed <= 100; ++seed) {
    Campaign c = campaign(seed);
    c.experiments = std::max<Index>(c.experiments, 12), c.steps = std::max<Index>(c.steps, 40);
    c.noise = std::min(c.noise, 0.5);
    c.kind %= 3;  // inputs that hardly differ between experiments hide the order
    const auto remark = swapped_axes(ensemble_of(c, seed, true));
    found += remark && remark->kind == Finding::Kind::axes_time_before_experiments;
    ++all;
  }
  EXPECT_GE(found, 90) << "of " << all;
}

TEST(Axes, SizesThatNoDataHaveAreTold) {
  const auto remark = [](Index N, Index T, Index r, Index m) {
    const auto found = swapped_axes(Ensemble(N, T, r, m));
    return found ? in_words(*found) : std::string();
  };
  EXPECT_NE(remark(50, 2, 80, 80).find("50 experiments of 2 steps with 80 inputs and 80 outputs"), std::string::npos);
  EXPECT_NE(remark(50, 2, 80, 80).find("not (experiments, channels, steps)"), std::string::npos);
  EXPECT_NE(remark(50, 1, 2, 1).find("For one experiment of 50 steps, use the shape (1, 50, channels)"),
            std::string::npos);
  EXPECT_NE(remark(1, 5, 7, 7).find("u of shape (5, 7) was read as one experiment of 5 steps with 7 inputs"),
            std::string::npos);
  for (const auto& [N, T, r, m] :
       std::vector<std::array<Index, 4>>{{50, 5, 8, 2}, {50, 5, 2, 8}, {1, 80, 2, 2}, {5, 1, 1, 1}})
    EXPECT_EQ(remark(N, T, r, m), "");
}

TEST(Axes, CopiesSideBySideAreNoTime) {
  Campaign c{60, 40, 1, 1, 1, 0.0, 2.0, 0, false, 0.0};
  for (const bool noise_alone : {false, true}) {
    Ensemble e = ensemble_of(c, 3, false);
    std::mt19937 random(5);
    std::normal_distribution<double> normal;
    if (noise_alone) e.samples() = Matrix::NullaryExpr(60, 80, [&] { return normal(random); });
    for (Index n = 1; n < e.experiments(); n += 2) e.samples().row(n) = e.samples().row(n - 1);
    EXPECT_FALSE(swapped_axes(e));
  }
}

}  // namespace
}  // namespace tokid::testing
