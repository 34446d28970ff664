// SPDX-License-Identifier: BSD-3-Clause
#include "model/riccati.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "model/kalman_step.hpp"
#include "testing.hpp"
#include "textbook.hpp"

namespace tokid::testing {
namespace {

constexpr SystemSize gain_sizes[] = {{1, 1, 1}, {2, 1, 2}, {4, 2, 1}, {3, 4, 1}, {6, 3, 2}};

// Gains, and noise of every step of about the size one; less beyond the innovations.
Model with_random_gains(Model model, std::uint64_t seed) {
  Random random(seed);
  for (Step& step : model.step) step.G() = 0.2 * random.matrix(step.next_states(), step.outputs());
  return model;
}
Matrix noise_root(Random& random, Index n) { return Matrix::Identity(n, n) + 0.1 * random.matrix(n, n); }
NoiseRoots random_noise_roots(const Model& model, double process, std::uint64_t seed) {
  Random random(seed);
  NoiseRoots noise;
  for (const Step& step : model.step) {
    noise.innovation.push_back(noise_root(random, step.outputs()));
    noise.state.push_back(process * noise_root(random, step.next_states()));
  }
  noise.output_size = Vector::Constant(model.outputs, 10.0);
  return noise;
}

// Errors of a step by least squares with a well-conditioned root, as shares of the results; steps contract them.
double gain_tolerance(const SystemSize& size) { return 1000 * double(size.n + size.m) * epsilon; }

TEST(FilterGains, AreThoseOfTheTextbook) {
  for (const SystemSize& size : gain_sizes) {
    const Model before = with_random_gains(random_system(size, 15, 0.9, 1), 2);
    const NoiseRoots noise = random_noise_roots(before, 0.5, 3);
    Model model = before;
    filter_gains(model, noise);
    textbook::FilterGains exact(size.n);
    for (size_t s = 0; s < model.step.size(); ++s) {
      exact.advance(before.step[s], noise.innovation[s], noise.state[s]);
      const Step& step = model.step[s];
      EXPECT_LE((step.G() - exact.gain).norm(), gain_tolerance(size) * (1 + step.G().norm())) << name(size) << s;
      EXPECT_LE((step.innovation_cov() - exact.S).norm(), gain_tolerance(size) * step.innovation_cov().norm());
      EXPECT_EQ(Matrix(step.innovation_cov()), Matrix(step.innovation_cov().transpose()));
    }
  }
}

TEST(FilterGains, StayWhereStatesHaveNoNoiseBeyondTheInnovations) {
  for (const SystemSize& size : gain_sizes) {
    const Model before = with_random_gains(random_system(size, 15, 0.9, 4), 5);
    NoiseRoots noise = random_noise_roots(before, 0.0, 6);
    Model model = before;
    filter_gains(model, noise);
    for (size_t s = 0; s < model.step.size(); ++s) {
      const Step& step = model.step[s];
      EXPECT_LE((step.G() - before.step[s].G()).norm(), gain_tolerance(size) * (1 + step.G().norm()))
          << name(size) << s;
      const Matrix sigma = kalman::covariance_of(noise.innovation[s]);
      EXPECT_LE((step.innovation_cov() - sigma).norm(), gain_tolerance(size) * sigma.norm());
    }
  }
}

TEST(FilterGains, OfAPeriodicModelAreSteadyAllAround) {
  for (const SystemSize& size : gain_sizes)
    for (const Index period : {1, 3}) {
      Model before = with_random_gains(random_system(size, 4 * period, 0.9, 7), 8);
      NoiseRoots noise = random_noise_roots(before, 0.5, 9);
      before.period = period;
      for (size_t s = size_t(period); s < before.step.size(); ++s) {
        before.step[s] = before.step[s - size_t(period)];
        noise.innovation[s] = noise.innovation[s - size_t(period)];
        noise.state[s] = noise.state[s - size_t(period)];
      }
      Model model = before;
      filter_gains(model, noise);
      // The solution of the periodic Riccati equation: the textbook's recursion until nothing changes.
      textbook::FilterGains exact(size.n);
      const auto around = [&](auto&& use) {
        for (size_t s = 0; s < size_t(period); ++s) {
          exact.advance(before.step[s], noise.innovation[s], noise.state[s]);
          use(s);
        }
      };
      for (int round = 0; round < 200; ++round) around([](size_t) {});
      around([&](size_t s) {
        // Settled to 1e-13 of P from one round to the next, which errors of up to ten times as much may be.
        for (size_t at = s; at < model.step.size(); at += size_t(period)) {
          const Step& step = model.step[at];
          EXPECT_LE((step.G() - exact.gain).norm(), 1e-12 * (1 + step.G().norm()) + gain_tolerance(size))
              << name(size) << " " << at;
          EXPECT_LE((step.innovation_cov() - exact.S).norm(),
                    (1e-12 + gain_tolerance(size)) * step.innovation_cov().norm());
        }
      });
    }
}

// x⁺ = a x + w, y = x + ε with variances q and r
Model with_filter_gains(double a, double q, double r) {
  Model model;
  model.inputs = model.outputs = 1;
  model.period = 1;
  const auto scalar = [](double value) { return Matrix(Matrix::Constant(1, 1, value)); };
  for (int k = 0; k < 5; ++k) model.step.emplace_back(scalar(a), scalar(0), scalar(1), scalar(0), scalar(0));
  NoiseRoots noise;
  noise.innovation = {scalar(std::sqrt(r))};
  noise.state = {scalar(std::sqrt(q))};
  noise.output_size = Vector::Ones(1);
  filter_gains(model, noise);
  return model;
}

// The errors of this filter fall by 1e-5 a step: 1000 repetitions do not reach the limit.
TEST(FilterGains, OfASlowFilterAreThoseOfTheLimit) {
  constexpr double q = 1e-10, r = 1.0;
  // P = P - P²/(P + r) + q, so P² = q P + q r
  const double p = (q + std::sqrt(q * q + 4 * q * r)) / 2, gain = p / (p + r);
  // Relative rounding errors of each step, which the steps contract by (1 - gain)².
  const double tolerance = epsilon / (1 - (1 - gain) * (1 - gain));
  for (const Step& step : with_filter_gains(1.0, q, r).step) {
    EXPECT_NEAR(step.G()(0, 0), -gain, tolerance * gain);
    EXPECT_NEAR(step.innovation_cov()(0, 0), p + r, 4 * epsilon);
  }
}

// An exact output tells the state, also if the plant is unstable.
TEST(FilterGains, OfExactOutputsFollowThem) {
  for (const double a : {0.5, 1.0, 2.0})
    for (const Step& step : with_filter_gains(a, 0.25, 0.0).step) {
      EXPECT_NEAR(step.G()(0, 0), -a, 4 * epsilon * a);
      EXPECT_NEAR(step.innovation_cov()(0, 0), 0.25, epsilon);
    }
}

TEST(FilterGains, FollowVaryingStateDimensions) {
  Model before = with_random_gains(random_system({3, 2, 1}, 8, 0.9, 10), 11);
  const Step first = before.step[0];  // rest: no state at all to begin with
  before.step[0] = Step(Matrix(3, 0), first.B(), Matrix(2, 0), first.D(), first.G());
  const NoiseRoots noise = random_noise_roots(before, 0.5, 12);
  Model model = before;
  filter_gains(model, noise);
  textbook::FilterGains exact(0);
  for (size_t s = 0; s < 8; ++s) {
    exact.advance(before.step[s], noise.innovation[s], noise.state[s]);
    EXPECT_LE((model.step[s].G() - exact.gain).norm(), gain_tolerance({3, 2, 1}) * (1 + model.step[s].G().norm()));
  }
}

// A combination of outputs without noise counts as if it had least_noise of the noisiest, as shares of their
// sizes. The covariance of the innovations is stated as it is.
TEST(FilterGains, CountNoOutputAsExact) {
  const SystemSize size{3, 2, 1};
  const Model before = with_random_gains(random_system(size, 6, 0.9, 13), 14);
  NoiseRoots noise = random_noise_roots(before, 0.5, 15);
  noise.output_size << 10.0, 1000.0;                                  // in other units
  for (Matrix& root : noise.innovation) root = Matrix{{1.0, 100.0}};  // the same for both, and nothing else
  Model model = before;
  filter_gains(model, noise);
  // P = 0: S = Σ. In units of the sizes the noise has one direction, and the gain answers to that alone.
  const Matrix sigma = kalman::covariance_of(noise.innovation[0]), projection = Matrix::Constant(2, 2, 0.5);
  const Matrix gain =
      before.step[0].G() * noise.output_size.asDiagonal() * projection * noise.output_size.cwiseInverse().asDiagonal();
  // Least squares with a root of condition 1/least_noise.
  EXPECT_LE(((model.step[0].G() - gain) * noise.output_size.asDiagonal()).norm(),
            100 * epsilon / least_noise * before.step[0].G().norm() * noise.output_size.norm());
  EXPECT_LE((model.step[0].innovation_cov() - sigma).norm(), 10 * epsilon * sigma.norm());
  for (const Step& step : model.step) EXPECT_TRUE(step.G().allFinite());
}

TEST(DropRounding, LeavesNothingOfRoundingErrorsAndOfOutputsAtRest) {
  Random random(16);
  Matrix residuals = random.matrix(7, 3);
  residuals.col(1) *= 1e-15;
  const Matrix before = residuals;
  drop_rounding(residuals, Vector{{1.0, 1.0, 0.0}});
  EXPECT_EQ(residuals.col(0), before.col(0));
  EXPECT_EQ(residuals.rightCols(2).norm(), 0.0);
}

}  // namespace
}  // namespace tokid::testing
