// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/observer.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/validate.hpp"

namespace tokid::testing {
namespace {

TEST(Deadbeat, TimeInvariantExampleOfThePaper) {
  Model model = constant_system({2, 1, 1}, 10, 1.0, 1);
  for (Step& step : model.step) step.A() = Matrix{{1, 0}, {1, 2}};  // (73)
  for (Step& step : model.step) step.C() = Matrix{{0, 1}};
  const DeadbeatGain gain = deadbeat_gain(model);
  EXPECT_EQ(gain.steps, 2);
  // The first step has no past to be deadbeat over; from the second on the gain is unique.
  for (size_t k = 1; k + 1 < 10; ++k) EXPECT_LE((gain.G[k] - Matrix{{-1.0}, {-3.0}}).norm(), 1e-12) << k;
  set_gains(model, gain.G);
  EXPECT_LE((model.at(5).closed_loop() - Matrix{{1, -1}, {1, -1}}).norm(), 1e-12);  // (75)
}

TEST(Deadbeat, ProductsVanishForEveryStepAndSize) {
  for (const SystemSize size :
       {SystemSize{1, 1, 1}, {4, 2, 1}, {3, 2, 1}, {2, 3, 1}, {5, 2, 1}, {7, 3, 1}, {12, 4, 1}, {6, 1, 1}})
    for (const double growth : {0.9, 1.3}) {
      Model model = random_system(size, 30, growth, 90);
      const DeadbeatGain gain = deadbeat_gain(model);
      const Index p = smallest_lag_order(size);
      EXPECT_EQ(gain.steps, p) << name(size);
      set_gains(model, gain.G);
      double largest = 0.0;
      for (const Matrix& g : gain.G) largest = std::max(largest, g.norm());
      for (const double norm : deadbeat_products(model, p))
        EXPECT_LE(norm, 1e4 * epsilon * std::pow(1 + largest, double(p))) << name(size);
      // One step fewer does not do for p·m ≥ n > (p-1)·m.
      if (p > 1) {
        EXPECT_GT(deadbeat_products(model, p - 1)[10], 1e-3) << name(size);
      }
    }
}

TEST(Deadbeat, ErrorsOfAnyStepDieEvenWhereOutputsFailForAWhile) {
  Model model = random_system({3, 1, 1}, 30, 1.0, 91);
  for (size_t k = 10; k < 14; ++k) model.step[k].C().setZero();  // nothing is seen for four steps
  const DeadbeatGain gain = deadbeat_gain(model);
  EXPECT_EQ(gain.steps, 7);
  set_gains(model, gain.G);
  for (const double norm : deadbeat_products(model, 7)) EXPECT_LE(norm, 1e-8);
}

TEST(Deadbeat, StatesThatAreNeverSeenAreReported) {
  Model model = random_system({3, 1, 1}, 20, 1.0, 92);
  for (size_t k = 0; k < 20; ++k) {
    model.step[k].A().row(2) << 0, 0, 0.9;  // the third state lives by itself …
    model.step[k].A().col(2) << 0, 0, 0.9;
    model.step[k].C()(0, 2) = 0;  // … and out of sight
  }
  EXPECT_GT(deadbeat_gain(model).steps, 20);
}

TEST(Deadbeat, VaryingStateDimensions) {
  Model model = random_system({3, 1, 2}, 12, 1.0, 93);
  const Step first = model.step[0];  // rest: no state at all to begin with
  model.step[0] = Step(Matrix(3, 0), first.B(), Matrix(1, 0), first.D(), first.G());
  const DeadbeatGain gain = deadbeat_gain(model);
  EXPECT_EQ(gain.steps, 3);
  set_gains(model, gain.G);
  model.check();
  for (const double norm : deadbeat_products(model, 3)) EXPECT_LE(norm, 1e-8);
}

TEST(Deadbeat, ProductsOfNoStepsAreRefused) {
  EXPECT_THROW(deadbeat_products(random_system({2, 1, 1}, 5, 1.0, 94), 0), std::invalid_argument);
}

// Random covariances and gains; nothing is diagonal or equal from step to step.
Model random_noise(Model model, std::uint64_t seed, double process, double measurement) {
  Random random(seed);
  const auto covariance = [&](Index n, double size) -> Matrix {
    const Matrix f = size * random.matrix(n, n);
    return f * f.transpose();
  };
  for (Index k = model.k_begin; k < model.k_end(); ++k) {
    model.at(k).set_Q(covariance(model.n(k + 1), process));
    model.at(k).set_R(covariance(model.outputs, measurement));
  }
  model.x0_cov = covariance(model.n(model.k_begin), 1.0);
  return model;
}

// The conditional mean of x_k given y_0 … y_{k-1} and its covariance, from the joint covariance of all of them: no
// recursion, so that it shares nothing with the filter.
struct Conditional {
  Matrix P, gain;  // covariance of x_k before y_k, and the weight of y_k - ŷ_k in the estimate of x_k after it
};
Conditional conditional(const Model& model, Index k) {
  const Index m = model.outputs, n0 = model.n(model.k_begin);
  // x_k and y_0 … y_k as linear maps of the independent sources x_0, w_0 …, v_0 …
  Index sources = n0;
  for (Index j = 0; j <= k; ++j) sources += model.n(j + 1) + m;
  Matrix x = Matrix::Zero(n0, sources), y((k + 1) * m, sources), x_k;
  x.leftCols(n0) = *linalg::covariance_factor(model.x0_cov);
  Index column = n0;
  for (Index j = 0; j <= k; ++j) {
    if (j == k) x_k = x;
    y.middleRows(j * m, m) = model.step[size_t(j)].C() * x;
    y.block(j * m, column, m, m) += *linalg::covariance_factor(model.step[size_t(j)].R());
    column += m;
    x = model.step[size_t(j)].A() * x;
    const Index next = model.n(j + 1);
    x.middleCols(column, next) += *linalg::covariance_factor(model.step[size_t(j)].Q());
    column += next;
  }
  // What is left of x_k and of y_k when the earlier outputs are known.
  const Matrix past = y.topRows(k * m), now = y.bottomRows(m);
  const auto left = [&](const Matrix& a) -> Matrix {
    if (k == 0) return a;
    return a - a * past.transpose() * linalg::pseudo_inverse(past * past.transpose()) * past;
  };
  const Matrix xl = left(x_k), yl = left(now);
  return {xl * xl.transpose(), xl * yl.transpose() * (yl * yl.transpose()).inverse()};
}

TEST(Kalman, IsTheConditionalMeanGivenThePast) {
  for (const SystemSize size : {SystemSize{1, 1, 1}, {4, 2, 2}, {3, 1, 1}, {2, 3, 1}, {5, 2, 1}})
    for (const double growth : {0.9, 1.2}) {
      const Model model = random_noise(random_system(size, 8, growth, 100), 101, 0.3, 0.5);
      const KalmanFilter filter = kalman_filter(model);
      for (const Index k : {0, 1, 4, 7}) {
        const Conditional exact = conditional(model, k);
        // The joint covariance loses digits with its condition number, some 1e4 here.
        EXPECT_LE((filter.P[size_t(k)] - exact.P).norm(), 1e-10 * exact.P.norm()) << name(size) << " k " << k;
        EXPECT_LE((filter.K[size_t(k)] - exact.gain).norm(), 1e-9 * (1 + exact.gain.norm()))
            << name(size) << " k " << k;
      }
    }
}

TEST(Kalman, CovariancesStaySymmetricAndPositiveWhereTheTextbookFormFails) {
  // Exact outputs of an uncertain state: P falls by 24 orders of magnitude, and P - K C P would be all rounding errors.
  Model model = random_system({6, 2, 1}, 40, 1.0, 102);
  for (Index k = 0; k < 40; ++k) {
    model.at(k).set_Q(Matrix::Zero(6, 6));
    model.at(k).set_R(1e-12 * Matrix::Identity(2, 2));
  }
  model.x0_cov = 1e12 * Matrix::Identity(6, 6);
  const KalmanFilter filter = kalman_filter(model);
  for (size_t s = 0; s < filter.P.size(); ++s) {
    const Matrix& P = filter.P[s];
    EXPECT_EQ(P, P.transpose()) << s;
    EXPECT_TRUE(linalg::covariance_factor(P)) << s;  // no negative eigenvalue
    EXPECT_GT(P.trace(), 0) << s;
  }
  // n/m = 3 outputs tell the state to about the measurement noise, and nothing disturbs it later.
  EXPECT_LE(filter.P.back().trace(), 1e-6);
  for (const Matrix& K : filter.K) EXPECT_TRUE(K.allFinite());
}

TEST(Kalman, ReachesTheSteadyStateOfAConstantSystem) {
  Model model = constant_system({4, 2, 1}, 200, 1.0, 103);
  for (Index k = 0; k < 200; ++k) {
    model.at(k).set_Q(0.1 * Matrix::Identity(4, 4));
    model.at(k).set_R(0.2 * Matrix::Identity(2, 2));
  }
  const KalmanFilter filter = kalman_filter(model);
  const Matrix &P = filter.P.back(), &A = model.step[0].A(), &C = model.step[0].C();
  const Matrix E = C * P * C.transpose() + model.step[0].R();
  // The algebraic Riccati equation.
  const Matrix next =
      A * P * A.transpose() - A * P * C.transpose() * E.inverse() * C * P * A.transpose() + model.step[0].Q();
  EXPECT_LE((next - P).norm(), 100 * epsilon * P.norm());
  EXPECT_LE((filter.innovation_cov.back() - E).norm(), 100 * epsilon * E.norm());
}

TEST(Kalman, InnovationsOfTheTrueFilterAreWhiteAndAsLargeAsItSays) {
  const ExperimentOptions options{.experiments = 400, .seed = 104, .process_noise = 0.1, .measurement_noise = 0.3};
  const Model model = with_noise(oscillator(40), options);
  const Prediction prediction = predict(model, experiments(model, options));
  EXPECT_GT(whiteness_p(prediction.innovations, 5), 0.001);
  double sum = 0.0;
  for (Index k = 0; k < 40; ++k) {
    const Matrix whitened =
        prediction.innovations[size_t(k)] * linalg::whitener(model.step[size_t(k)].innovation_cov()).transpose();
    sum += whitened.squaredNorm();
  }
  // χ² with 400·40·2 degrees of freedom: its mean has a standard deviation of 0.8 %.
  EXPECT_NEAR(sum / (400 * 40 * 2), 1.0, 0.04);
  // Any other gain predicts worse.
  Model deadbeat = model;
  set_gains(deadbeat, all(oscillator(40), &Step::G));
  const Ensemble data = experiments(model, options);
  EXPECT_LT(validate(model, data).one_step.rmse(0), 0.8 * validate(deadbeat, data).one_step.rmse(0));
}

TEST(Kalman, DoesNotDependOnTheUnitsOfTheOutputs) {
  const Model model = random_noise(random_system({4, 2, 1}, 20, 1.0, 105), 106, 0.3, 0.3);
  Model scaled = model;
  const Vector unit{{1e9, 1e-9}};
  for (size_t s = 0; s < 20; ++s) {
    scaled.step[s].C() = unit.asDiagonal() * model.step[s].C();
    scaled.step[s].set_R(unit.asDiagonal() * model.step[s].R() * unit.asDiagonal());
  }
  const KalmanFilter a = kalman_filter(model), b = kalman_filter(scaled);
  for (size_t s = 0; s < 20; ++s) EXPECT_LE((a.K[s] - b.K[s] * unit.asDiagonal()).norm(), 1e-10 * a.K[s].norm()) << s;
}

// Where the innovations are singular, the gain of smallest norm, and not the rounding errors of their null space.
TEST(Kalman, SingularNoiseGetsTheGainOfSmallestNorm) {
  Random random(110);
  for (int trial = 0; trial < 100; ++trial) {
    // Each output twice, with the same noise: the gain of one copy, in equal parts.
    const Model once = random_noise(random_system({4, 2, 1}, 12, 1.0, 200 + std::uint64_t(trial)),
                                    300 + std::uint64_t(trial), 0.3, 0.5);
    Model twice = once;
    twice.outputs = 4;
    for (size_t s = 0; s < 12; ++s) {
      const Step& one = once.step[s];
      twice.step[s] = Step(one.A(), one.B(), one.C().replicate(2, 1), one.D().replicate(2, 1), Matrix::Zero(4, 4));
      twice.step[s].set_Q(one.Q());
      twice.step[s].set_R(one.R().replicate(2, 2));
    }
    const KalmanFilter a = kalman_filter(once), b = kalman_filter(twice);
    for (size_t s = 0; s < 12; ++s) {
      EXPECT_LE((b.K[s] - 0.5 * a.K[s].replicate(1, 2)).norm(), 1e-9 * (1 + a.K[s].norm())) << trial << " " << s;
      EXPECT_LE((b.P[s] - a.P[s]).norm(), 1e-10 * a.P[s].norm()) << trial << " " << s;
    }
    // Noise in one direction of the outputs only.
    Model line = random_noise(random_system({1, 3, 1}, 8, 1.0, 400 + std::uint64_t(trial)), 500, 0.3, 0.5);
    for (Step& step : line.step) {
      const Matrix g = random.matrix(3, 1);
      step.set_R(g * g.transpose());
    }
    for (const Matrix& K : kalman_filter(line).K) EXPECT_LE(K.norm(), 1e4) << trial;
  }
}

TEST(Kalman, FollowsVaryingStateDimensions) {
  Model model = random_system({3, 2, 1}, 10, 1.0, 111);
  const Step first = model.step[0];  // rest: no state at all to begin with
  model.step[0] = Step(Matrix(3, 0), first.B(), Matrix(2, 0), first.D(), first.G());
  model = random_noise(model, 112, 0.3, 0.5);
  const KalmanFilter filter = kalman_filter(model);
  EXPECT_EQ(filter.P[0].size(), 0);
  EXPECT_EQ(filter.K[0].rows(), 0);
  EXPECT_LE((filter.P[1] - model.step[0].Q()).norm(), 1e-14 * model.step[0].Q().norm());
  for (const Index k : {1, 2, 6}) {
    const Conditional exact = conditional(model, k);
    EXPECT_LE((filter.P[size_t(k)] - exact.P).norm(), 1e-10 * exact.P.norm()) << k;
  }
}

TEST(Kalman, WithoutAnyNoiseTheStateIsKnownAndNothingIsDivided) {
  const Model model = with_noise(oscillator(20), {});
  for (const Step& step : model.step) EXPECT_EQ(step.G(), Matrix::Zero(4, 2));
  const Ensemble data = experiments(model, {.experiments = 5});
  EXPECT_LE(output_error(data, predict(model, data).y), 1e-12);
  // Unknown initial states and exact outputs: the filter is deadbeat, for it knows the state as soon as the outputs do.
  Model unknown = with_noise(oscillator(20), {.initial_state = InitialState::unknown});
  EXPECT_LE(kalman_filter(unknown).P[2].norm(), 1e-12);
}

TEST(Kalman, WhatIsNoCovarianceIsRefused) {
  const Model good = random_noise(random_system({3, 2, 1}, 5, 1.0, 107), 108, 1, 1);
  const auto refused = [](const Model& model) { EXPECT_THROW(kalman_filter(model), std::invalid_argument); };
  refused(random_system({3, 2, 1}, 5, 1.0, 107));  // no noise given
  refused(Model{});
  Model bad = good;
  bad.step.back().forget_noise();
  refused(bad);
  bad = good;
  bad.step[2].set_R(-bad.step[2].R());
  refused(bad);
  bad = good;
  Matrix skew = bad.step[1].Q();
  skew(0, 1) += 1;
  bad.step[1].set_Q(skew);
  refused(bad);
  EXPECT_THROW(bad.step[3].set_R(Matrix::Identity(1, 1)), std::invalid_argument);
  bad = good;
  bad.x0_cov(0, 0) = std::numeric_limits<double>::quiet_NaN();
  refused(bad);
}

}  // namespace
}  // namespace tokid::testing
