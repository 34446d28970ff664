// SPDX-License-Identifier: BSD-3-Clause
#include "model/smoother.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <stdexcept>

#include "base/integers.hpp"
#include "linalg/simd.hpp"
#include "noisy.hpp"

namespace tokid {
namespace {

using testing::epsilon;
using testing::Random;

constexpr Index steps = 12;

Model model_with_noise(std::uint64_t seed, Index states = 3) {
  Random random(seed);
  Model model = testing::random_system({states, 2, 2}, steps, 0.9, seed);
  for (Step& step : model.step) {
    const Matrix q = random.matrix(states, states), r = random.matrix(2, 2);
    step.set_Q(q * q.transpose() + Matrix::Identity(states, states));
    step.set_R(r * r.transpose() + Matrix::Identity(2, 2));
  }
  model.x0_mean = random.matrix(states, 1);
  model.x0_cov = Matrix::Identity(states, states);
  model.initial_state = InitialState::unknown;
  return model;
}

// Complete experiments, and some with the same missing inputs, missing outputs and early end. Twenty experiments each
// miss other samples.
Ensemble with_gaps(const Model& model, Index experiments) {
  Ensemble data = testing::random_experiments(model, experiments, 7, 1.0);
  Random random(8);
  for (Index n = 1; n < std::min<Index>(experiments, 60); n += 3) {
    const Index end = n % 2 == 0 ? steps : steps / 2 + n % 5;
    for (Index k = 0; k < steps; ++k)
      for (Index j = 0; j < 2; ++j) {
        if (random.uniform(0, 1) < 0.3 || k >= end) data.y(n, k, j) = std::nan("");
        if (random.uniform(0, 1) < 0.1) data.u(n, k, j) = std::nan("");
      }
  }
  for (Index n = 0; n < experiments; n += 9) {
    data.u(n, 3, 1) = std::nan("");
    data.y(n, 5, 0) = std::nan("");
    for (Index j = 0; j < 2; ++j) data.y(n, 7, j) = std::nan("");
    for (Index k = 10; k < steps && n % 2 == 0; ++k)
      for (Index j = 0; j < 2; ++j) data.y(n, k, j) = data.u(n, k, j) = std::nan("");
  }
  return data;
}

void expect_same_bits(const kalman::Smoothed& a, const kalman::Smoothed& b) {
  EXPECT_EQ(a.log_likelihood, b.log_likelihood);
  EXPECT_EQ(a.moments.moved, b.moments.moved);
  EXPECT_EQ(a.moments.measured, b.moments.measured);
  EXPECT_EQ(a.moments.x0, b.moments.x0);
  EXPECT_EQ(a.moments.x0_square, b.moments.x0_square);
}

TEST(Smoother, HasTheSameBitsWhateverWasInItsMemoryAndWithAnyThreadsAndInstructions) {
  const Model model = model_with_noise(1), other = model_with_noise(2, 5);
  for (const Index experiments : {5, 70, 1200}) {
    SCOPED_TRACE(experiments);
    const Ensemble data = with_gaps(model, experiments);
    const kalman::Samples samples = kalman::samples_of(model, data);
    const kalman::Smoothed first = kalman::Smoother(samples).smooth(model);
    kalman::Smoother used(samples);
    used.smooth(other);
    for (const int threads : {1, 2, 4}) expect_same_bits(used.smooth(model, {threads, {}}), first);
    for (const simd::Target target : simd::targets()) {
      SCOPED_TRACE(simd::to_string(target));
      simd::limit_target(target);
      expect_same_bits(used.smooth(model), first);
      simd::limit_target(simd::Target::avx512);
    }
  }
}

// Groups of experiments that lie in several pieces, pieces that go through the steps in several parts, and experiments
// that are computed in lanes. A single experiment is computed by neither.
TEST(Smoother, SumsOfAllExperimentsAreThoseOfEach) {
  for (const Index states : {1, 3, 6}) {
    SCOPED_TRACE(states);
    const Model model = model_with_noise(3, states);
    constexpr Index experiments = 1200;
    const Ensemble data = with_gaps(model, experiments);
    const kalman::Samples samples = kalman::samples_of(model, data);
    const kalman::Smoothed all = kalman::Smoother(samples).smooth(model);
    const kalman::Moments& found = all.moments;
    Matrix moved = Matrix::Zero(found.moved.rows(), found.moved.cols() * steps);
    Matrix measured = Matrix::Zero(found.measured.rows(), found.measured.cols() * steps);
    Vector measured_count = Vector::Zero(steps), moved_count = measured_count, x0 = Vector::Zero(states);
    Matrix x0_square = Matrix::Zero(states, states);
    // Each likelihood is a sum over steps and outputs.
    const double tolerance = 100 * epsilon * steps;
    for (Index row = 0; row < experiments; ++row) {
      kalman::Samples own = kalman::samples_of(model, data.subset({samples.experiment[size_t(row)]}));
      own.u_square = samples.u_square;  // the variance of a missing input
      const kalman::Smoothed alone = kalman::Smoother(own).smooth(model);
      EXPECT_NEAR(all.log_likelihood(row), alone.log_likelihood(0),
                  tolerance * (1 + std::abs(alone.log_likelihood(0))));
      moved += alone.moments.moved.together();
      measured += alone.moments.measured.together();
      moved_count += alone.moments.moved_count;
      measured_count += alone.moments.measured_count;
      x0 += alone.moments.x0;
      x0_square += alone.moments.x0_square;
    }
    EXPECT_EQ(measured_count, found.measured_count);
    EXPECT_EQ(moved_count, found.moved_count);
    EXPECT_EQ(double(experiments), found.x0_count);
    // Sums of 1200 squares in another order.
    const auto near = [&](const Matrix& a, const Matrix& b) {
      EXPECT_LE((a - b).norm(), epsilon * experiments * b.norm());
    };
    near(found.moved.together(), moved);
    near(found.measured.together(), measured);
    near(found.x0, x0);
    near(found.x0_square, x0_square);
    EXPECT_EQ(kalman::log_likelihoods(model, samples), all.log_likelihood);
  }
}

// 49 rows stand for many experiments: 1, and two inputs and outputs at each of twelve steps.
TEST(Smoother, HasTheSameSumsWithFewerRows) {
  const Model model = model_with_noise(4);
  for (const Index experiments : {98, 700}) {
    SCOPED_TRACE(experiments);
    for (const Index end : {steps, steps - 2}) {
      Ensemble data = testing::random_experiments(model, experiments, 8, 1.0);
      for (Index k = end; k < steps; ++k) data.output(k).setConstant(std::nan(""));
      const kalman::Samples all = kalman::samples_of(model, data);
      const std::optional<kalman::Samples> fewer = kalman::with_fewer_rows(all);
      ASSERT_TRUE(fewer);
      EXPECT_EQ(fewer->rows, 1 + 4 * end);
      EXPECT_EQ(fewer->experiments, experiments);
      const kalman::Smoothed expected = kalman::Smoother(all).smooth(model),
                             found = kalman::Smoother(*fewer).smooth(model);
      // Rounding errors of a triangular factor and of the sums.
      const double tolerance = 100 * epsilon * double(experiments);
      const auto near = [&](const Matrix& a, const Matrix& b) { EXPECT_LE((a - b).norm(), tolerance * b.norm()); };
      near(found.moments.moved.together(), expected.moments.moved.together());
      near(found.moments.measured.together(), expected.moments.measured.together());
      near(found.moments.measured_count, expected.moments.measured_count);
      near(found.moments.moved_count, expected.moments.moved_count);
      near(found.moments.x0, expected.moments.x0);
      near(found.moments.x0_square, expected.moments.x0_square);
      EXPECT_NEAR(found.moments.x0_count, expected.moments.x0_count, tolerance * double(experiments));
      EXPECT_NEAR(found.log_likelihood.sum(), expected.log_likelihood.sum(),
                  tolerance * std::abs(expected.log_likelihood.sum()));
    }
  }
}

TEST(Smoother, KeepsTheRowsOfFewOrIncompleteExperiments) {
  const Model model = model_with_noise(5);
  EXPECT_FALSE(kalman::with_fewer_rows(kalman::samples_of(model, testing::random_experiments(model, 97, 9, 1.0))));
  EXPECT_FALSE(kalman::with_fewer_rows(kalman::samples_of(model, with_gaps(model, 700))));
  Ensemble same_gap = testing::random_experiments(model, 700, 10, 1.0);
  same_gap.output(4).col(1).setConstant(std::nan(""));
  EXPECT_FALSE(kalman::with_fewer_rows(kalman::samples_of(model, same_gap)));
}

// Steps with the same matrices share their covariances once these have settled. A change of a matrix in its last digit
// keeps the steps from sharing them.
TEST(Smoother, SharesSettledCovariancesOfEqualSteps) {
  constexpr Index length = 400, middle = 250;
  Model model = model_with_noise(6);
  model.step.assign(size_t(length), Step(model.step.front()));
  Model each = model;
  for (size_t s = 0; s < each.step.size(); s += 2) each.step[s].D()(0, 0) = std::nextafter(each.step[s].D()(0, 0), 9.0);
  Ensemble data = testing::random_experiments(model, 9, 12, 1.0);
  for (Index n : {0, 4}) data.y(n, middle, 0) = data.u(n, middle + 40, 1) = std::nan("");
  data.output(middle + 90).row(5).setConstant(std::nan(""));
  for (Index k = length - 3; k < length; ++k) data.output(k).row(7).setConstant(std::nan(""));
  const kalman::Samples samples = kalman::samples_of(model, data);
  const kalman::Smoothed found = kalman::Smoother(samples).smooth(model),
                         expected = kalman::Smoother(samples).smooth(each);
  // Settled covariances are off by 1e-14 / (1 - ρ²) of their size, for states that are forgotten by ρ < 0.95 a step.
  const auto near = [](const Matrix& a, const Matrix& b) { EXPECT_LE((a - b).norm(), 1e-12 * b.norm()); };
  for (size_t s = 0; s < size_t(length); ++s) {
    near(found.moments.measured[s], expected.moments.measured[s]);
    near(found.moments.moved[s], expected.moments.moved[s]);
  }
  near(found.log_likelihood, expected.log_likelihood);
  near(found.moments.x0_square, expected.moments.x0_square);
}

TEST(Smoother, OneSumOfAllStepsIsTheSumOfTheirMoments) {
  const Model model = model_with_noise(7);
  for (const Index experiments : {5, 70}) {
    const kalman::Samples samples = kalman::samples_of(model, with_gaps(model, experiments));
    const kalman::Smoothed each = kalman::Smoother(samples).smooth(model),
                           all = kalman::Smoother(samples).smooth(model, {}, true);
    ASSERT_EQ(all.moments.measured.size(), 1);
    Matrix measured = Matrix::Zero(all.moments.measured.rows(), all.moments.measured.cols());
    Matrix moved = Matrix::Zero(all.moments.moved.rows(), all.moments.moved.cols());
    for (size_t s = 0; s < size_t(steps); ++s) measured += each.moments.measured[s], moved += each.moments.moved[s];
    const double tolerance = epsilon * double(steps * experiments);
    EXPECT_LE((all.moments.measured[0] - measured).norm(), tolerance * measured.norm());
    EXPECT_LE((all.moments.moved[0] - moved).norm(), tolerance * moved.norm());
    EXPECT_EQ(all.moments.measured_count(0), each.moments.measured_count.sum());
    EXPECT_EQ(all.moments.moved_count(0), each.moments.moved_count.sum());
    EXPECT_EQ(all.moments.x0_square, each.moments.x0_square);
    EXPECT_EQ(all.log_likelihood, each.log_likelihood);
  }
}

TEST(Smoother, NeedsAConstantStateDimension) {
  const Model model = model_with_noise(4);
  Model varying = model;
  varying.step.back() = Step(3, 2, 2, 2);
  varying.step.back().set_Q(Matrix::Identity(2, 2));
  varying.step.back().set_R(Matrix::Identity(2, 2));
  const Ensemble data = with_gaps(model, 5);
  const kalman::Samples samples = kalman::samples_of(model, data);
  EXPECT_THROW(kalman::Smoother(samples).smooth(varying), std::logic_error);
}

}  // namespace
}  // namespace tokid
