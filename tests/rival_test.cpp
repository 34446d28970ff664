// SPDX-License-Identifier: BSD-3-Clause
// Errors of held-out experiments, and regressions that the choice of p and λ does not reach.
#include "choose/rival.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <limits>

#include "base/random.hpp"
#include "choose/held_out_error.hpp"
#include "model/input_delays.hpp"
#include "testing.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing::rivals {
namespace {

Squares random_squares(RandomNumbers& random, Index experiments, Index columns) {
  Squares s(experiments, columns);
  for (Index c = 0; c < columns; ++c)
    for (Index n = 0; n < experiments; ++n) {
      s.outputs(n, c) = 1 + random.uniform();
      s.errors(n, c) = 0.1 * s.outputs(n, c) * random.uniform();
    }
  return s;
}

TEST(HeldOutErrors, HaveTheDerivativesOfTheWeightsOfExperiments) {
  RandomNumbers random(1);
  const Index count = 7;
  const Squares s = random_squares(random, count, 6);
  const Vector weights = Vector::Ones(2);
  const HeldOutError error = held_out_error(s, weights);
  EXPECT_LT(std::abs(error.influence.sum()), 100 * epsilon);
  for (Index n = 0; n < count; ++n) {
    const double step = 1e-6;
    Squares more = s, less = s;
    more.errors.row(n) *= 1 + step, more.outputs.row(n) *= 1 + step;
    less.errors.row(n) *= 1 - step, less.outputs.row(n) *= 1 - step;
    const double derivative = (held_out_error(more, weights).value - held_out_error(less, weights).value) / (2 * step);
    // Central differences err by step² and by rounding errors over step.
    EXPECT_NEAR(error.influence(n) / double(count), derivative, 1e-9);
  }
}

TEST(HeldOutErrors, DifferClearlyOnlyIfAllExperimentsAgree) {
  RandomNumbers random(2);
  const Vector weights = Vector::Ones(2);
  const Squares s = random_squares(random, 9, 6);
  Squares larger = s, other = s;
  larger.errors *= 1.2;
  EXPECT_TRUE(clearly_smaller(held_out_error(s, weights), held_out_error(larger, weights), 2.0));
  EXPECT_FALSE(clearly_smaller(held_out_error(larger, weights), held_out_error(s, weights), 2.0));
  other.errors.row(0) *= 3.0;  // one experiment alone says nothing
  EXPECT_FALSE(clearly_smaller(held_out_error(s, weights), held_out_error(other, weights), 2.0));
}

// Errors above those of the mean motion count as equal to them, but one step ahead.
TEST(HeldOutErrors, OfDivergedPredictionsAreBounded) {
  Squares s(3, 2);
  s.outputs.setOnes();
  s.errors.col(0).setConstant(4.0);
  s.errors.col(1).setConstant(1e200);
  EXPECT_NEAR(held_out_error(s, Vector::Ones(1)).value, 0.5 * std::log(2.0), 10 * epsilon);
}

TEST(HeldOutErrors, OfOneOutputDoNotSpoilThoseOfTheOthers) {
  Squares s(3, 4);
  s.outputs.setOnes();
  s.errors.setConstant(0.01);
  s.errors.col(2).setConstant(1e8);  // five steps ahead, of the first output
  EXPECT_NEAR(held_out_error(s, Vector::Ones(2)).value, 0.75 * 0.5 * std::log(0.01), 100 * epsilon);
}

// The standard errors are those of the jackknife but for terms of higher order.
// An output of weight zero, here of noise alone, neither counts nor limits how exact the others may be.
TEST(HeldOutErrors, OfOutputsWithoutWeightDoNotCount) {
  Squares one(6, 2), both(6, 4);
  for (Index n = 0; n < 6; ++n)
    for (Index i = 0; i < 2; ++i) {
      both.errors(n, 2 * i) = one.errors(n, i) = 1e-12 * double(n + 1);
      both.errors(n, 2 * i + 1) = both.outputs(n, 2 * i + 1) = both.outputs(n, 2 * i) = one.outputs(n, i) = 1.0;
    }
  const HeldOutError alone = held_out_error(one, Vector::Ones(1)), beside = held_out_error(both, Vector{{1.0, 0.0}});
  EXPECT_EQ(beside.value, alone.value);
  EXPECT_EQ(beside.influence, alone.influence);
}

// A model that diverges is worse than any other, but its error is finite: a search over n does not end there.
TEST(HeldOutErrors, OfModelsThatDivergeOrPredictNothingAreFinite) {
  Squares diverged(3, 1), nothing(3, 1);
  diverged.errors.setConstant(std::numeric_limits<double>::infinity());
  diverged.outputs.setOnes();
  const HeldOutError error = held_out_error(diverged, Vector::Ones(1));
  EXPECT_GT(error.value, std::log(1e11));
  EXPECT_TRUE(std::isfinite(error.value) && error.influence.allFinite());
  EXPECT_EQ(held_out_error(nothing, Vector::Ones(1)).value, error.value);
  EXPECT_TRUE(std::isinf(infinite_error({0, {1, 5}}, 3).value));
}

TEST(HeldOutErrors, OfHorizonsAreMeansOverTheOutputs) {
  RandomNumbers random(5);
  const Index count = 400;
  const Squares s = random_squares(random, count, 6);
  const Vector weights = Vector::LinSpaced(2, 1.0, 3.0);
  const HeldOutErrors found = errors_at_horizons(s, weights);
  ASSERT_EQ(found.error.size(), 3);
  for (Index h = 0; h < 3; ++h) {
    const auto of = [&](const Squares& some) {
      const Eigen::ArrayXd shares =
          (some.errors.colwise().sum().array() / some.outputs.colwise().sum().array()).sqrt().transpose();
      return (shares(2 * h) + 3 * shares(2 * h + 1)) / 4;
    };
    EXPECT_NEAR(found.error(h), of(s), 10 * epsilon);
    double square = 0.0;
    for (Index n = 0; n < count; ++n) {
      Squares without = s;
      without.errors.row(n).setZero();
      without.outputs.row(n).setZero();
      square += std::pow(of(without) - of(s), 2);
    }
    // One of 400 experiments changes the sums by about 1/400.
    EXPECT_NEAR(found.standard_error(h), std::sqrt(square), 0.02 * found.standard_error(h));
  }
}

// White inputs act 14 steps later on a system of one state.
Ensemble late(Index experiments, std::uint64_t seed, double noise) {
  RandomNumbers random(seed);
  Ensemble e(experiments, 60, 1, 1);
  for (Index n = 0; n < experiments; ++n)
    for (Index k = 0; k < 60; ++k) {
      e.u(n, k, 0) = random.normal();
      const double before = k > 0 ? e.y(n, k - 1, 0) : 0.0;
      e.y(n, k, 0) = 0.7 * before + (k >= 15 ? e.u(n, k - 15, 0) : 0.0) + noise * random.normal();
    }
  e.initial_state = InitialState::zero;
  return e;
}

RegressionErrors::Found best(const Rivals& rivals, const RegressionErrors& errors, const std::vector<Squares>& models) {
  return best_regression(rivals, errors, errors.found(rivals.lags, rivals.smoothing, rivals.jumps), models);
}

TEST(Rivals, SeeInputsBeyondTheLagsOfTheChoice) {
  SmoothingOptions o;
  o.lags = {1, 2, 4, 8, 12, 16, 24};
  const RegressionErrors errors(late(24, 3, 0.1), o, 3, IdentifyOptions().horizons);
  EXPECT_GE(best({o, 2, 100.0}, errors, errors.squares(0, 3, 2, 100.0)).lags, 16);
}

// More lags have more coefficients, and need a larger λ.
TEST(Rivals, HaveTheirOwnSmoothing) {
  Ensemble e = late(24, 3, 0.1);
  for (Index k = 0; k < e.steps(); ++k) e.output(k) *= 1 + 0.5 * std::sin(0.1 * double(k));
  SmoothingOptions o;
  o.lags = {1, 2, 4, 8, 12, 16, 24};
  const RegressionErrors errors(e, o, 3, IdentifyOptions().horizons);
  const Rivals rivals{o, 2, 0.1};
  const RegressionErrors::Found found = best(rivals, errors, errors.squares(0, 3, 2, 0.1));
  EXPECT_GE(found.lags, 16);
  EXPECT_GT(found.smoothing, 1.0);
  EXPECT_TRUE(std::isfinite(found.smoothing));
  EXPECT_LT(found.error.value, errors.found(found.lags, 0.1).error.value);
  const RegressionErrors::Found constant =
      best({o, 16, std::numeric_limits<double>::infinity()}, errors, errors.squares(0, 3, 2, 0.1));
  EXPECT_TRUE(std::isfinite(constant.smoothing));
}

TEST(Rivals, AreGivenUpWhereHopeless) {
  SmoothingOptions o;
  o.lags = {1, 2, 4, 8};
  const RegressionErrors errors(late(24, 3, 0.1), o, 3, IdentifyOptions().horizons);
  const Rivals rivals{o, 2, 100.0};
  const std::vector<Squares> as_good = errors.squares(0, 3, 8, std::numeric_limits<double>::infinity());
  std::vector<Squares> hopeless = as_good;
  for (Squares& fold : hopeless) fold.errors *= 1e-4;
  const RegressionErrors::Found found = best(rivals, errors, as_good);
  EXPECT_GT(found.lags, rivals.lags);
  EXPECT_FALSE(surely_smaller(found.error, errors.error_of(as_good)));
  EXPECT_EQ(best(rivals, errors, hopeless).lags, rivals.lags);
}

bool holds(const Ensemble& e, Index lags, double smoothing) {
  SmoothingOptions o;
  o.lags = {lags};
  const RegressionErrors errors(e, o, 3, IdentifyOptions().horizons);
  return holds_with_nearly_all(errors.found(lags, smoothing), errors, e, o);
}

// With 39 unknowns, the least squares solution of 32 experiments predicts far better than that of 38 or 40.
TEST(Rivals, AreDroppedWhereExperimentsAreAsManyAsUnknowns) {
  EXPECT_FALSE(holds(late(40, 3, 0.1), 19, 0.0));
  EXPECT_TRUE(holds(late(40, 3, 0.1), 4, 0.0));
  for (const Index experiments : {3, 9, 12, 24}) EXPECT_TRUE(holds(late(experiments, 3, 0.1), 8, 100.0)) << experiments;
}

TEST(Rivals, TakeOverWhereTheyPredictBetter) {
  int models = 0;
  const Identification found = identify(late(24, 4, 0.1), {.delays = std::vector<Index>{}}, [&](Model) { ++models; });
  EXPECT_LE(models, 1);  // before EM
  EXPECT_GE(found.plan.lags, 16);
  const Ensemble fresh = late(10, 5, 0.0);
  const Ensemble simulated = simulate(found.model, fresh);
  double error = 0.0;
  for (Index k = 0; k < 60; ++k) error += (simulated.output(k) - fresh.output(k)).squaredNorm();
  EXPECT_LT(std::sqrt(error / 600), 0.1);
}

// The pulse response of random taps needs as many states as it has taps, and so few experiments do not determine these
// for EM.
TEST(Rivals, AreTheModelWhereTheyPredictBetterThanEm) {
  RandomNumbers random(7);
  const Index taps = 20, steps = 50;
  Vector h(taps);
  for (double& tap : h) tap = random.normal();
  Ensemble e(14, steps, 1, 1);
  for (Index n = 0; n < e.experiments(); ++n) {
    Vector past = Vector::Zero(taps);
    for (Index k = 0; k < steps; ++k) {
      e.u(n, k, 0) = random.normal();
      e.y(n, k, 0) = h.dot(past) + 0.3 * random.normal();
      past.tail(taps - 1) = past.head(taps - 1).eval();
      past(0) = e.u(n, k, 0);
    }
  }
  e.initial_state = InitialState::zero;
  const Identification found = identify(e, {.delays = std::vector<Index>{}});
  EXPECT_EQ(found.plan.method, Method::regression);
  ASSERT_TRUE(found.comparison);
  EXPECT_EQ(found.comparison->model.error, found.comparison->regression.error);
  EXPECT_LT(found.comparison->model.error(0), 0.15);
}

// A balancing robot with its wheels under feedback. A model without the unstable state would simulate better.
Ensemble balancing(Index experiments, Index steps, std::uint64_t seed) {
  RandomNumbers random(seed);
  const Matrix A{{1.00319, 0.01992, 0.00015}, {0.31875, 0.99323, 0.01502}, {0, 0, 0.88692}},
      gain{{0.6816, 0.00008}, {4.16417, 0.00751}, {0, 0.44346}};
  const Vector B{{-0.00077, -0.07509, 0.5654}};
  const Eigen::RowVector3d feedback(23.92053, 5.27279, 0.40325);
  Ensemble e(experiments, steps, 1, 2);
  for (Index n = 0; n < experiments; ++n) {
    Vector x = Vector::Zero(3), estimate = x;
    for (Index k = 0; k < steps; ++k) {
      const Vector y{{x(0) + 0.002 * random.normal(), x(2) + 0.05 * random.normal()}};
      const double u = feedback * estimate + 0.6 * random.sign();
      e.u(n, k, 0) = u;
      for (Index j = 0; j < 2; ++j) e.y(n, k, j) = y(j);
      estimate = (A * estimate + B * u + gain * (y - Vector{{estimate(0), estimate(2)}})).eval();
      x = (A * x + B * u).eval();
      x(1) += 0.01 * random.normal();
      x(2) += 0.02 * random.normal();
    }
  }
  e.initial_state = InitialState::zero;
  return e;
}

TEST(Choices, KeepTheUnstableState) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Model model = identify(balancing(20, 100, seed), {.period = 1}).model;
    EXPECT_EQ(model.states(), 3);
    EXPECT_NEAR(Matrix(model.step.front().A()).eigenvalues().cwiseAbs().maxCoeff(), 1.078, 0.03);
  }
}

}  // namespace
}  // namespace tokid::testing::rivals
