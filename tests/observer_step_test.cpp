// SPDX-License-Identifier: BSD-3-Clause
#include "model/observer_step.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"

namespace tokid::testing {
namespace {

constexpr SystemSize step_sizes[] = {{1, 1, 1}, {2, 1, 3}, {3, 4, 1}, {5, 2, 2}, {8, 3, 4}};

Step random_step(Random& random, Index n, Index next, Index r, Index m) {
  return {random.matrix(next, n), random.matrix(next, r), random.matrix(m, n), random.matrix(m, r),
          random.matrix(next, m)};
}

// Gains that leave the observer of a system with singular values below one about as stable.
Model with_small_gains(Model model, std::uint64_t seed) {
  Random random(seed);
  for (Step& step : model.step) step.G() = 0.1 * random.matrix(step.next_states(), step.outputs());
  return model;
}

TEST(ObserverStep, IsTheEquation) {
  Random random(1);
  for (const auto& [n, m, r] : step_sizes)
    for (const Index next : {n, n + 2, Index(1)})
      for (const Index count : {1, 7, 40}) {
        const Step step = random_step(random, n, next, r, m);
        const Matrix x = random.matrix(count, n), u = random.matrix(count, r), y = random.matrix(count, m);
        Matrix output, e, found, simulated;
        observer::output(step, x, u, output);
        observer::innovation(step, x, u, y, e);
        observer::next_state(step, x, u, e, found);
        observer::next_state(step, x, u, simulated);
        // A sum of n + r + m products is off by as many rounding errors of the sum of their sizes.
        const double sum = double(n + r + m + 2) * epsilon;
        const Matrix ax = x.cwiseAbs(), au = u.cwiseAbs(), ae = e.cwiseAbs();
        const auto within = [](const Matrix& a, const Matrix& b, const Matrix& bound) {
          return a.rows() == b.rows() && a.cols() == b.cols() && ((a - b).cwiseAbs().array() <= bound.array()).all();
        };
        const Matrix of_output = ax * step.C().transpose().cwiseAbs() + au * step.D().transpose().cwiseAbs();
        const Matrix of_state = ax * step.A().transpose().cwiseAbs() + au * step.B().transpose().cwiseAbs();
        EXPECT_TRUE(within(output, x * step.C().transpose() + u * step.D().transpose(), sum * of_output));
        EXPECT_EQ(e, y - output);
        EXPECT_TRUE(within(simulated, x * step.A().transpose() + u * step.B().transpose(), sum * of_state));
        EXPECT_TRUE(within(found, x * step.A().transpose() + u * step.B().transpose() - e * step.G().transpose(),
                           sum * (of_state + ae * step.G().transpose().cwiseAbs())));
      }
}

TEST(ObserverStep, ARowDependsOnNoOther) {
  Random random(2);
  for (const auto& [n, m, r] : step_sizes) {
    const Step step = random_step(random, n, n, r, m);
    Matrix x = random.matrix(37, n), u = random.matrix(37, r), y = random.matrix(37, m), e, next, own_e, own_next;
    y(5, 0) = u(11, 0) = x(36, 0) = nan;
    observer::innovation(step, x, u, y, e);
    observer::next_state(step, x, u, e, next);
    for (Index i = 0; i < 37; ++i) {
      const bool missing = i == 5 || i == 11 || i == 36;
      EXPECT_EQ(next.row(i).allFinite(), !missing) << i;
      observer::innovation(step, x.row(i), u.row(i), y.row(i), own_e);
      observer::next_state(step, x.row(i), u.row(i), own_e, own_next);
      EXPECT_TRUE(missing || (own_e.row(0) == e.row(i) && own_next.row(0) == next.row(i))) << i;
    }
  }
}

// y = C x + D u + e and x⁺ = A x + B u - G e: the observer finds the e again, and with them the outputs.
TEST(ObserverStep, FindsTheInnovationsThatMadeTheOutputs) {
  for (const SystemSize& size : step_sizes) {
    const Model model = with_small_gains(random_system(size, 30, 0.9, 3), 4);
    Random random(5);
    const Index count = 9;
    Matrix x = random.matrix(count, size.n), observed = x, y, e, next;
    double error = 0.0;  // bound of that of the observed state
    for (const Step& step : model.step) {
      const Matrix u = random.matrix(count, size.r), exact = random.matrix(count, size.m);
      observer::output(step, x, u, y);
      y += exact;
      observer::next_state(step, x, u, exact, next);
      x.swap(next);
      observer::innovation(step, observed, u, y, e);
      // Rounding errors of sums of n + r + m products of this size, twice; earlier ones go on through A + G C.
      const double scale = x.norm() + observed.norm() + u.norm() + exact.norm() + y.norm();
      const double parts = step.A().norm() + step.B().norm() + step.C().norm() + step.D().norm() + step.G().norm() + 1;
      const double rounding = 2 * double(size.n + size.r + size.m) * epsilon * scale * parts;
      EXPECT_LE((e - exact).norm(), step.C().norm() * error + rounding) << name(size);
      observer::next_state(step, observed, u, e, next);
      observed.swap(next);
      error = step.closed_loop().norm() * error + (1 + step.G().norm()) * rounding;
      EXPECT_LE((observed - x).norm(), error) << name(size);
    }
  }
}

// predict() and simulate() run these steps and nothing else, to the last bit.
TEST(ObserverStep, IsThatOfPredictionsAndSimulations) {
  for (const SystemSize& size : step_sizes) {
    Model model = with_small_gains(random_system(size, 12, 0.9, 6), 7);
    const Ensemble data = with_noise(random_experiments(model, 11, 8), 0.1, 9);
    const Prediction prediction = predict(model, data, {1, InitialState::zero});
    const Ensemble simulation = simulate(model, data);
    Matrix x = Matrix::Zero(11, size.n), simulated = x, y, e, next;
    for (Index k = 0; k < 12; ++k) {
      const Step& step = model.at(k);
      observer::output(step, x, data.input(k), y);
      EXPECT_EQ(prediction.y.output(k), y) << k;
      observer::innovation(step, x, data.input(k), data.output(k), e);
      EXPECT_EQ(prediction.innovations[size_t(k)], e) << k;
      observer::next_state(step, x, data.input(k), e, next);
      x.swap(next);
      observer::output(step, simulated, data.input(k), y);
      EXPECT_EQ(simulation.output(k), y) << k;
      observer::next_state(step, simulated, data.input(k), next);
      simulated.swap(next);
    }
  }
}

}  // namespace
}  // namespace tokid::testing
