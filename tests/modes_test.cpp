// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/modes.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <functional>
#include <numbers>
#include <numeric>

#include "modes/tracks.hpp"
#include "noisy.hpp"
#include "testing.hpp"
#include "tokid/identify.hpp"
#include "tokid/uncertainty.hpp"

namespace tokid::testing {
namespace {

using Complex = std::complex<double>;
using Continuous = std::function<Matrix(double)>;  // A(t) of ẋ = A x

// The transition over one step, by the fourth-order Runge-Kutta method in `parts` parts.
Matrix transition(const Continuous& a, double t, double dt, Index parts = 20) {
  const double h = dt / double(parts);
  Matrix x = Matrix::Identity(a(t).rows(), a(t).rows());
  for (Index i = 0; i < parts; ++i, t += h) {
    const Matrix k1 = a(t) * x, k2 = a(t + h / 2) * (x + h / 2 * k1), k3 = a(t + h / 2) * (x + h / 2 * k2),
                 k4 = a(t + h) * (x + h * k3);
    x += h / 6 * (k1 + 2 * k2 + 2 * k3 + k4);
  }
  return x;
}

// Oscillators with the frequencies w_i(t) [rad/s] and damping z. Each output shows all positions; forces act on all.
struct Oscillators {
  std::vector<std::function<double(double)>> w;
  double damping = 0.02;
  Matrix C;
  double dt = 0.05;

  Index n() const { return 2 * Index(w.size()); }
  Matrix rate(double t) const {
    const Index half = n() / 2;
    Matrix a = Matrix::Zero(n(), n());
    for (Index i = 0; i < half; ++i) {
      const double wi = w[size_t(i)](t);
      a(i, half + i) = 1;
      a(half + i, i) = -wi * wi;
      a(half + i, half + i) = -2 * damping * wi;
    }
    return a;
  }
  Model model(Index steps) const {
    Model result;
    result.inputs = 1;
    result.outputs = C.rows();
    result.dt = dt;
    result.method = "known";
    for (Index k = 0; k < steps; ++k) {
      Step& step = result.step.emplace_back(n(), n(), 1, C.rows());
      step.A() = transition([&](double t) { return rate(t); }, double(k) * dt, dt);
      step.B().bottomRows(n() / 2).setConstant(dt);
      step.C().leftCols(n() / 2) = C;
    }
    return result;
  }
};

Oscillators one(const std::function<double(double)>& w, double damping = 0.02) {
  return {{w}, damping, Matrix::Identity(1, 1)};
}

std::vector<Matrix> transformations(const Model& model, std::uint64_t seed) {
  Random random(seed);
  std::vector<Matrix> S;
  for (const Index n : state_dims(model))
    S.emplace_back(random.orthogonal(n) * (1 + random.matrix(n, 1).array().abs()).matrix().asDiagonal() *
                   random.orthogonal(n));
  return S;
}

// Condition number of the eigenvalues and of the windows of outputs: the factor of rounding errors.
double condition(const Model& model, Index window) {
  double result = 1.0;
  for (Index k = model.k_begin; k + window < model.k_end(); ++k) {
    const Vector sigma = linalg::singular_values(observability(model, k, window));
    const linalg::Eigensystem e = linalg::eigensystem(model.at(k).A());
    result = std::max(result, sigma(0) / sigma(sigma.size() - 1) * e.right.norm() * e.left.norm());
  }
  return result;
}

Eigen::VectorXcd row(const Eigen::MatrixXcd& poles, Index k) { return poles.row(k).transpose(); }

// The largest distance of two sets of poles over their largest size.
double distance(const Eigen::VectorXcd& a, const Eigen::VectorXcd& b) {
  return (matched(a, b) - b).cwiseAbs().maxCoeff() / b.cwiseAbs().maxCoeff();
}

const std::vector<SystemSize> sizes{{1, 1, 1}, {2, 1, 1}, {3, 2, 1}, {4, 2, 2}, {6, 2, 3}, {5, 5, 1}};

TEST(Assignment, HasTheSmallestCostOfAllPermutations) {
  Random random(1);
  for (const Index n : {1, 2, 3, 4, 5, 6})
    for (int repeat = 0; repeat < 10; ++repeat) {
      const Matrix cost = random.matrix(n, n);
      const auto total = [&](const std::vector<Index>& columns) {
        double sum = 0.0;
        for (Index i = 0; i < n; ++i) sum += cost(i, columns[size_t(i)]);
        return sum;
      };
      std::vector<Index> columns = range(0, n);
      double least = total(columns);
      while (std::next_permutation(columns.begin(), columns.end())) least = std::min(least, total(columns));
      std::vector<Index> found = modes_of::assignment(cost);
      EXPECT_NEAR(total(found), least, 10 * double(n) * epsilon * (1 + cost.norm()));
      std::sort(found.begin(), found.end());
      EXPECT_EQ(found, range(0, n));
    }
}

TEST(Modes, OfATimeInvariantSystemAreItsEigenvalues) {
  for (const SystemSize& size : sizes)
    for (const Index period : {0, 1}) {
      Model model = constant_system(size, 40, 1.0, 10 + std::uint64_t(size.n));
      model.dt = 0.3;
      model.period = period;
      if (period == 1) model.step.resize(1);
      const Modes found = modes(model);
      EXPECT_EQ(found.steps(), period == 1 ? 1 : 40 - found.window) << name(size);
      const Eigen::VectorXcd z = linalg::eigenvalues(model.step[0].A());
      Eigen::VectorXcd s(z.size());
      for (Index i = 0; i < z.size(); ++i) s(i) = std::log(z(i)) / 0.3;
      const double tolerance =
          1e3 * epsilon * condition(constant_system(size, 40, 1.0, 10 + std::uint64_t(size.n)), found.window);
      for (Index k = 0; k < found.steps(); ++k) {
        EXPECT_LE(distance(row(found.poles, k), s), tolerance) << name(size);
        for (Index i = 0; i < found.count(); ++i) {
          EXPECT_LE(found.variation(k, i) * std::abs(found.poles(k, i)), tolerance * s.cwiseAbs().maxCoeff() / 0.3);
          EXPECT_EQ(found.shapes[size_t(k)].col(i).cwiseAbs().maxCoeff(), 1.0);
        }
      }
    }
}

// The poles belong to the outputs alone: time-varying coordinates and units do not change them.
TEST(Modes, FirstOfAConjugatePairLeads) {
  Modes found;
  found.poles.resize(1, 4);
  found.poles << Complex(-1, 2), Complex(-1, -2), Complex(-3, 0), Complex(nan, nan);
  EXPECT_TRUE(found.leads(0, 0));
  EXPECT_FALSE(found.leads(0, 1));
  EXPECT_TRUE(found.leads(0, 2));
  EXPECT_TRUE(found.leads(0, 3));  // a mode that is not known has its row in tables
}

TEST(Modes, DoNotDependOnCoordinatesOrUnits) {
  for (const SystemSize& size : sizes) {
    const Model model = random_system(size, 30, 1.0, 20 + std::uint64_t(size.n));
    const std::vector<Matrix> S = transformations(model, 30);
    Model units = model;
    Random random(31);
    Vector y(size.m), u(size.r);
    for (double& value : y) value = std::pow(10.0, random.uniform(-4, 4));
    for (double& value : u) value = std::pow(10.0, random.uniform(-4, 4));
    for (Step& step : units.step) {
      step.B() = step.B() * u.asDiagonal();
      step.C() = y.asDiagonal() * step.C();
      step.D() = y.asDiagonal() * step.D() * u.asDiagonal();
    }
    const Modes found = modes(model), moved = modes(transform(model, S)), scaled = modes(units);
    ASSERT_EQ(found.steps(), moved.steps());
    // Maps of a window divide by the smallest singular value of the next windows, too.
    const double tolerance =
        1e3 * epsilon * std::pow(condition(model, found.window), 2) * condition(transform(model, S), found.window);
    for (Index k = 0; k < found.steps(); ++k) {
      EXPECT_LE(distance(row(moved.poles, k), row(found.poles, k)), tolerance) << name(size) << " step " << k;
      EXPECT_LE(distance(row(scaled.poles, k), row(found.poles, k)), tolerance) << name(size) << " step " << k;
    }
  }
}

TEST(Modes, OfASlowSystemInAnyCoordinatesFollowTheSameColumns) {
  const Oscillators plant{{[](double t) { return 3 + 0.1 * t; }, [](double t) { return 8 - 0.2 * t; }},
                          0.02,
                          (Matrix(2, 2) << 1, 0.5, -0.3, 1).finished()};
  const Model model = plant.model(80);
  const Modes found = modes(model), moved = modes(transform(model, transformations(model, 40)));
  const double tolerance = 1e3 * epsilon * std::pow(condition(model, found.window), 2);
  EXPECT_LE((found.poles - moved.poles).norm(), tolerance * found.poles.norm());
  for (size_t k = 0; k < found.shapes.size(); ++k)
    EXPECT_LE((found.shapes[k] - moved.shapes[k]).norm(), 10 * tolerance * found.shapes[k].norm());
  EXPECT_TRUE(found.valid.all());
  EXPECT_TRUE((found.valid == moved.valid).all());
}

// The frequency errs in second order and the damping ratio in first order of the rate of variation.
TEST(Modes, ErrAsDerivedForSlowVariation) {
  const auto errors = [](double rate) {
    const Oscillators plant{
        {[=](double t) { return 3 * (1 + rate * t); }, [=](double t) { return 5 * (1 - rate * t); }},
        0.02,
        (Matrix(1, 2) << 1, 1).finished()};
    const Modes found = modes(plant.model(60));
    const Matrix frequency = natural_frequencies(found), damping = damping_ratios(found);
    double of_frequency = 0.0, of_damping = 0.0;
    for (Index k = 0; k < found.steps(); ++k)
      for (const Index i : {0, 2}) {
        const double truth = plant.w[size_t(i / 2)](double(found.begin + k) * plant.dt);
        of_frequency = std::max(of_frequency, std::abs(frequency(k, i) / truth - 1));
        of_damping = std::max(of_damping, std::abs(damping(k, i) - plant.damping));
      }
    return std::pair(of_frequency, of_damping);
  };
  const auto [fast_frequency, fast_damping] = errors(0.04);
  const auto [slow_frequency, slow_damping] = errors(0.01);
  EXPECT_GT(fast_damping, 1e-4);                 // the order of zero is not known
  EXPECT_LT(slow_damping, 0.25 * fast_damping);  // a quarter of the rate
  // Damping makes a part of the frequency's error of first order: the damping ratio times the error of the damping.
  EXPECT_LT(slow_frequency, 0.0625 * fast_frequency + 0.02 * slow_damping);  // a sixteenth
  EXPECT_LT(fast_frequency, 0.04 / 3);  // the variation of the slower mode: below what errs in first order
}

// Outputs that grow like exp(gt) multiply the window of each step by exp(g dt): poles move by g, an error of first
// order.
TEST(Modes, MoveByTheGrowthOfTheSensors) {
  Model model = one([](double) { return 4.0; }).model(30);
  const Modes still = modes(model);
  const double growth = 0.3;
  for (Index k = 0; k < model.steps(); ++k) model.at(k).C() *= std::exp(growth * double(k) * model.dt);
  const Modes moved = modes(model);
  EXPECT_LE((moved.poles - still.poles - Eigen::MatrixXcd::Constant(still.steps(), 2, growth)).cwiseAbs().maxCoeff(),
            1e3 * epsilon * condition(model, still.window) / model.dt);
}

TEST(Modes, VariationIsTheChangeOverARadian) {
  const double rate = 0.15;
  const Modes found = modes(one([=](double t) { return 5 + rate * t; }, 0.01).model(100));
  for (Index k = 5; k + 5 < found.steps(); ++k) {
    const double w = 5 + rate * double(found.begin + k) * found.dt;
    // The frozen pole errs in second order, relative to which its change is of third order.
    EXPECT_NEAR(found.variation(k, 0), rate / (w * w), std::pow(rate / (w * w), 2));
  }
  EXPECT_TRUE(found.valid.all());
  const Modes fast = modes(one([](double t) { return 3 + 2 * std::sin(4 * t); }).model(100));
  EXPECT_LT(double(fast.valid.count()), 0.05 * double(fast.valid.size()));  // where the frequency turns round
  ModesOptions all;
  all.slow = 1e9;
  EXPECT_GT(modes(one([](double t) { return 3 + 2 * std::sin(4 * t); }).model(100), all).valid.count(),
            fast.valid.count());
}

// The frequency oscillates with the period over which the variation is taken: 1/|s| is 20 steps. The outermost steps
// are then equal to each other, and to the step between them half a period later.
TEST(Modes, VariationSeesOscillationsOfEveryPeriod) {
  for (const double steps : {10, 20, 40}) {
    const double w = 1.0, dt = 0.05, share = 0.2;
    const auto frequency = [=](double t) {
      return w * (1 + share * std::sin(2 * std::numbers::pi * t / (steps * dt)));
    };
    const Modes found = modes(one(frequency).model(120));
    const Matrix poles = natural_frequencies(found);
    Index valid = 0;
    for (Index k = 20; k + 20 < found.steps(); ++k) {
      // The window of four steps leaves most of the oscillation of the pole.
      const auto part = poles.col(0).segment(k - 20, 41);
      ASSERT_GT(part.maxCoeff() - part.minCoeff(), 0.1 * w);
      valid += found.valid(k, 0);
    }
    EXPECT_EQ(valid, 0) << steps;
  }
}

// The mean over a window of whole periods hides an oscillation; half the window shows it. The motion then has the
// frequency of the mean stiffness, which a small oscillation hardly changes.
TEST(Modes, AnotherWindowShowsWhatTheWindowHides) {
  const auto found = [](double share) {
    const auto frequency = [=](double t) { return 4 * (1 + share * std::sin(2 * std::numbers::pi * t / 0.4)); };
    ModesOptions options;
    options.window = 8;  // 0.4 s: the period
    return modes(one(frequency).model(120), options);
  };
  const Modes large = found(0.8), small = found(0.1);
  EXPECT_LT(large.variation.middleRows(10, 90).maxCoeff(), 0.1);
  EXPECT_EQ(large.valid.middleRows(10, 90).count(), 0);
  EXPECT_TRUE(small.valid.middleRows(10, 90).all());
  const double mean = 4 * std::sqrt(1 + 0.1 * 0.1 / 2);
  // A window of 0.4 s is 1.6 rad, so the mean differs within it by at most its square times the square of the share.
  EXPECT_NEAR(natural_frequencies(small)(50, 0), mean, 1.6 * 1.6 * 0.1 * 0.1 * mean);
}

TEST(Modes, KeepTheirColumnsWhereFrequenciesCross) {
  const Oscillators plant{
      {[](double t) { return 4 + 0.3 * t; }, [](double t) { return 5.03 - 0.3 * t; }}, 0.02, Matrix::Identity(2, 2)};
  const Modes found = modes(plant.model(70));
  const Matrix frequency = natural_frequencies(found);
  // The truth of each column is that of its first step, also after the crossing at t = 1.7 s. Frequencies err by the
  // damping ratio times the variation, 0.02 · 0.3/4².
  for (Index i = 0; i < 4; ++i) {
    const auto truth = [&](Index k, size_t mode) { return plant.w[mode](double(found.begin + k) * plant.dt); };
    const size_t mode = std::abs(frequency(0, i) - truth(0, 0)) < std::abs(frequency(0, i) - truth(0, 1)) ? 0 : 1;
    for (Index k = 0; k < found.steps(); ++k) EXPECT_NEAR(frequency(k, i), truth(k, mode), 4e-4 * truth(k, mode)) << k;
  }
  for (Index k = 0; k < found.steps(); ++k)
    for (Index i = 0; i < 4; i += 2) {
      EXPECT_GT(found.poles(k, i).imag(), 0);
      EXPECT_EQ(found.poles(k, i + 1), std::conj(found.poles(k, i)));
    }
}

// Both poles of a conjugate pair are one mode, also where the poles of another window are hard to match.
TEST(Modes, OfAConjugatePairAreValidTogether) {
  Index pairs = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const Modes found = modes(random_system({6, 2, 1}, 60, 0.98, seed));
    for (Index k = 0; k < found.steps(); ++k)
      for (Index i = 0; i < found.count(); ++i)
        for (Index j = i + 1; j < found.count(); ++j) {
          if (found.poles(k, i).imag() == 0 || found.poles(k, j) != std::conj(found.poles(k, i))) continue;
          ++pairs;
          EXPECT_EQ(found.valid(k, i), found.valid(k, j)) << seed << ' ' << k;
          if (std::isnan(found.window_change(k, i))) continue;
          EXPECT_EQ(found.window_change(k, i), found.window_change(k, j)) << seed << ' ' << k;
        }
  }
  EXPECT_GT(pairs, 1000);
}

// One output shows no shapes: only the course of the poles tells two modes apart.
TEST(Modes, AreFollowedByTheCourseOfTheirPoles) {
  Random random(45);
  std::vector<modes_of::StepModes> steps;
  const auto truth = [](Index k, Index mode) {
    const double t = 0.05 * double(k);
    const Complex upper = mode < 2 ? Complex(-0.1, 4 + 0.3 * t) : Complex(-0.3, 5.033 - 0.3 * t);
    return mode % 2 == 0 ? upper : std::conj(upper);
  };
  for (Index k = 0; k < 70; ++k) {
    std::vector<Index> order = range(0, 4);
    for (size_t i = 3; i > 0; --i) std::swap(order[i], order[size_t(random.uniform(0, double(i) + 0.999))]);
    modes_of::StepModes& step = steps.emplace_back(Eigen::VectorXcd(4), Eigen::MatrixXcd::Ones(1, 4));
    for (Index i = 0; i < 4; ++i) step.poles(i) = truth(k, order[size_t(i)]);
    if (k % 9 == 5) step.poles.setConstant(Complex(nan, nan));
  }
  modes_of::follow(steps);
  for (Index i = 0; i < 4; ++i) {
    Index mode = 0;
    while (steps[0].poles(i) != truth(0, mode)) ++mode;
    for (Index k = 0; k < 70; ++k) {
      if (k % 9 == 5)
        EXPECT_TRUE(std::isnan(steps[size_t(k)].poles(i).real()));
      else
        EXPECT_EQ(steps[size_t(k)].poles(i), truth(k, mode)) << k;
    }
  }
}

TEST(Modes, WithoutAContinuousSystemAreNotValid) {
  Model model = constant_system({2, 2, 1}, 12, 1.0, 50);
  for (Step& step : model.step) step.A() = (Matrix(2, 2) << -0.5, 0.1, 0, 0.8).finished();
  const Modes found = modes(model);
  for (Index k = 0; k < found.steps(); ++k)
    for (Index i = 0; i < 2; ++i) EXPECT_EQ(found.valid(k, i), found.poles(k, i).imag() == 0.0);
  EXPECT_EQ(found.valid.count(), found.steps());
}

TEST(Modes, AreNaNWhereTheOutputsDoNotShowTheState) {
  Model model = random_system({3, 1, 1}, 40, 1.0, 60);
  for (Index k = 10; k < 40; ++k) model.at(k).C().setZero();
  const Modes found = modes(model);
  EXPECT_TRUE(found.poles.row(0).allFinite());
  EXPECT_TRUE(found.poles.row(found.steps() - 1).real().array().isNaN().all());
  EXPECT_FALSE(found.valid.row(found.steps() - 1).any());
  EXPECT_EQ(message([&] { frozen_system(model, 30); }),
            "window: the outputs of the 6 steps around step 30 don't determine the state; a longer window needed");
}

// The mean of a step has windows of other steps. One of them alone may not determine the state.
TEST(Modes, AreNaNWhereAnyWindowOfTheMeanIsTooPoor) {
  Model plant = one([](double) { return 4.0; }).model(60);
  plant = transform(plant, transformations(plant, 52));  // so that rounding errors hide what is singular
  Model model = plant;
  const Index dead = 30, count = 3;
  for (Index k = dead; k < dead + count; ++k) model.at(k).C().setZero();
  const Modes found = modes(model), whole = modes(plant);
  ASSERT_EQ(found.window, 4);
  // The window of four steps from j on determines two states by two or more live steps.
  const auto poor = [&](Index j) {
    Index live = 0;
    for (Index i = j; i < j + 4; ++i) live += i < dead || i >= dead + count;
    return live < 2;
  };
  Index unknown = 0;
  for (Index k = 0; k < found.steps(); ++k) {
    const Index centre = found.begin + k - 2, reach = std::min({Index(2), k, found.steps() - 1 - k});
    bool expected = false, touched = false;
    for (Index j = centre - reach; j <= centre + reach + 1; ++j) expected = expected || poor(j);
    for (Index j = centre - reach; j <= centre + reach + 4; ++j) touched = touched || (j >= dead && j < dead + count);
    EXPECT_EQ(std::isnan(found.poles(k, 0).real()), expected) << k;
    EXPECT_FALSE(expected && found.valid(k, 0)) << k;
    if (!touched) {
      EXPECT_LE(distance(row(found.poles, k), row(whole.poles, k)), 1e3 * epsilon * std::pow(condition(plant, 4), 2));
    }
    unknown += expected;
  }
  EXPECT_GT(unknown, 2);
}

// A delay has z = 0: its frequency is that of rounding errors.
TEST(Modes, FasterThanTheSamplesAreNotValid) {
  Model model = constant_system({3, 1, 1}, 40, 1.0, 51);
  for (Step& step : model.step) {
    step.A() << 0, 0, 0, 1, 0, 0, 0, 1, 0.5;
    step.B() << 1, 0, 0;
    step.C() << 0, 0, 1;
  }
  const Modes delayed = modes(model);
  for (Index k = 0; k < delayed.steps(); ++k)
    for (Index i = 0; i < 3; ++i) EXPECT_EQ(delayed.valid(k, i), std::abs(delayed.poles(k, i)) < 1) << k << " " << i;
  EXPECT_EQ(delayed.valid.count(), delayed.steps());
}

TEST(Modes, OfAPeriodicModelRepeat) {
  for (const Index period : {1, 3, 7, 20}) {
    Model model = periodic_system({4, 2, 1}, 3 * period, period, 1.0, 70 + std::uint64_t(period));
    model.period = period;
    const Modes found = modes(model);
    EXPECT_EQ(found.steps(), period);
    EXPECT_EQ(found.begin, 0);
    Model shorter = model;
    shorter.step.resize(size_t(period));
    EXPECT_EQ(modes(shorter).poles, found.poles);
    for (Index first = 1; first < period; ++first) {
      const Modes later = modes(from_step(model, first));
      EXPECT_EQ(later.begin, first);
      const double tolerance = 1e3 * epsilon * std::pow(condition(model, found.window), 2);
      for (Index k = 0; k < period; ++k)
        EXPECT_LE(distance(row(later.poles, k), row(found.poles, (first + k) % period)), tolerance);
    }
  }
  // One output has no other output to which its size matters: far from the ends, the same as without a period.
  Model model = periodic_system({2, 1, 1}, 40, 5, 1.0, 75);
  const Modes without = modes(model);
  model.period = 5;
  const Modes found = modes(model);
  for (Index k = 10; k < 30; ++k)
    EXPECT_LE(distance(row(without.poles, k - without.begin), row(found.poles, k % 5)),
              1e3 * epsilon * std::pow(condition(model, found.window), 2));
}

// What a model does before its period has no modes that last.
TEST(Modes, OfAModelThatGoesOnAreThoseOfItsPeriod) {
  Model lasting = periodic_system({3, 2, 1}, 6, 3, 1.0, 76);
  lasting.period = 3;
  const Modes alone = modes(lasting);
  for (const Index first : {1, 3, 6}) {  // states of the first step
    Model model = lasting;
    Step begin(first, 3, 1, 2);
    begin.A().setOnes();
    begin.C().setOnes();
    model.step.insert(model.step.begin(), begin);
    const Modes found = modes(model);
    ASSERT_EQ(found.steps(), 3);
    ASSERT_EQ(found.count(), 3);
    EXPECT_EQ(found.begin, first == 3 ? 0 : 1);
    if (first != 3) {
      EXPECT_EQ(found.poles, alone.poles);
    }
    EXPECT_EQ(floquet_multipliers(model), floquet_multipliers(lasting));
  }
  // A period that the model does not reach is none.
  Model ends = random_system({3, 2, 1}, 12, 1.0, 77);
  const Modes without = modes(ends);
  ends.period = 13;
  EXPECT_EQ(modes(ends).poles, without.poles);
  EXPECT_EQ(modes(ends).begin, without.begin);
  // Within a period of two steps the state has two numbers, then one.
  Model changing = random_system({2, 2, 1}, 2, 1.0, 78);
  changing.step[0] = Step(2, 1, 1, 2);
  changing.step[1] = Step(1, 2, 1, 2);
  changing.period = 2;
  EXPECT_EQ(
      message([&] { modes(changing); }),
      "model: a number of states found that changes within its period of 2 steps, a constant one needed for modes");
}

TEST(Modes, HaveTheSameBitsForAnyNumberOfThreads) {
  const Model model = random_system({4, 2, 2}, 200, 1.0, 80);
  ModesOptions options;
  const Modes single = modes(model, options);
  options.execution.threads = 3;
  const Modes several = modes(model, options);
  EXPECT_TRUE((single.poles.array() == several.poles.array()).all());
  EXPECT_TRUE((single.variation.array() == several.variation.array()).all());
}

TEST(Modes, RefuseWrongOptions) {
  const Model model = random_system({4, 2, 1}, 10, 1.0, 90);
  ModesOptions options;
  options.window = 3;
  EXPECT_EQ(message([&] { modes(model, options); }),
            "window: 3 found, an even number of steps from 2 on needed for 4 states and 2 outputs");
  options.window = 10;
  EXPECT_EQ(message([&] { modes(model, options); }),
            "window: 10 steps found, the model has 10 with all states, 11 needed. State a shorter window");
  options = {};
  options.slow = nan;
  EXPECT_EQ(message([&] { modes(model, options); }), "slow: nan found, 0 or more needed");
  EXPECT_EQ(message([&] { modes(Model()); }), "model: no states found, at least 1 needed for modes");
  EXPECT_EQ(message([&] { frozen_system(model, 1); }), "step: 1 found, 2 to 7 needed with a window of 4 steps");
  EXPECT_EQ(message([&] { floquet_multipliers(model); }), "period: 0 found in a model of 10 steps, 1 to 10 needed");
  EXPECT_EQ(message([&] { frequency_response(Step(2, 3, 1, 1), 1.0, Vector::Ones(1)); }),
            "A: 3 x 2 found, a square matrix needed");
}

TEST(FrozenSystem, OfATimeInvariantModelHasItsPulseResponses) {
  for (const SystemSize& size : sizes) {
    const Model model = constant_system(size, 40, 1.0, 100 + std::uint64_t(size.n));
    const Model frozen = frozen_system(model, 20);
    const Model longer = continued(frozen, 20);
    const double tolerance = 1e3 * epsilon * std::pow(condition(model, modes(model).window), 2);
    EXPECT_LE((frozen.step[0].D() - model.step[0].D()).norm(), tolerance * model.step[0].D().norm());
    for (Index gap = 1; gap < 15; ++gap)
      EXPECT_LE((pulse_response(longer, gap, 0) - pulse_response(model, gap, 0)).norm(),
                tolerance * (1 + pulse_response(model, 1, 0).norm()))
          << name(size);
  }
}

TEST(FrozenSystem, OfSeveralStepsAreThoseOfEachStep) {
  const Model model = one([](double t) { return 4 + 0.2 * t; }).model(40);
  const std::vector<Index> steps{20, 2, 37, 20};
  const std::vector<Model> found = frozen_systems(model, steps);
  ASSERT_EQ(found.size(), steps.size());
  for (size_t i = 0; i < steps.size(); ++i) {
    const Step single = frozen_system(model, steps[i]).step[0], &several = found[i].step[0];
    EXPECT_EQ(several.A(), single.A());
    EXPECT_EQ(several.B(), single.B());
    EXPECT_EQ(several.C(), single.C());
    EXPECT_EQ(several.D(), single.D());
  }
  EXPECT_TRUE(frozen_systems(model, {}).empty());
  EXPECT_EQ(message([&] { frozen_systems(model, {20, 1}); }), "step: 1 found, 2 to 37 needed with a window of 4 steps");
}

// The static gain of an oscillator is c b/w² up to terms of dt², which a ratio cancels.
double static_gain(const Model& model, Index k, Index window) {
  ModesOptions options;
  options.window = window;
  const Step frozen = frozen_system(model, k, options).step[0];
  return frequency_response(frozen, model.dt, Vector::Zero(1))[0](0, 0).real();
}

// B and D are linear in the outputs, and symmetric means keep a linear course.
TEST(FrozenSystem, HasTheInputMatricesOfItsOwnStep) {
  const auto slope = [](Index k) { return 1 + 0.01 * double(k); };
  for (const Index window : {2, 4, 8, 12})
    for (const Index k : {20, 60, 70}) {
      const Model still = one([](double) { return 4.0; }).model(100);
      Model inputs = still, direct = still;
      for (Index i = 0; i < 100; ++i) inputs.at(i).B() *= slope(i), direct.at(i).D().setConstant(slope(i));
      const double gain = static_gain(still, k, window),
                   tolerance = 1e3 * epsilon * std::pow(condition(still, window), 2);
      EXPECT_NEAR(static_gain(inputs, k, window) / gain, slope(k), tolerance) << window << " " << k;
      EXPECT_NEAR(static_gain(direct, k, window) - gain, slope(k), tolerance * (1 + gain)) << window << " " << k;
    }
}

// A growing sensor moves the poles by its growth (MoveByTheGrowthOfTheSensors), and changes the gain by
// 2 damping growth/w. The gain of another step would differ by the growth over that time: 3 % per W/2 steps.
TEST(FrozenSystem, HasTheOutputMatrixOfItsOwnStep) {
  const double w = 4.0, growth = 0.1;
  const Oscillators plant = one([=](double) { return w; }, 0.01);
  const Model still = plant.model(100);
  Model sensors = still, both = still;
  for (Index i = 0; i < 100; ++i) {
    const double factor = std::exp(growth * double(i) * plant.dt);
    sensors.at(i).C() *= factor;
    both.at(i).C() *= factor;
    both.at(i).B() /= factor;
  }
  for (const Index window : {4, 8, 12})
    for (const Index k : {20, 60, 70}) {
      const double gain = static_gain(still, k, window), of_poles = growth * growth / (w * w) + 0.02 * growth / w;
      const double factor = std::exp(growth * double(k) * plant.dt);
      // Pulses answer one step later, so the gain of a step is uncertain by the growth over a step.
      const double tolerance = 2 * of_poles + 1.1 * growth * plant.dt;
      EXPECT_NEAR(static_gain(sensors, k, window) / gain / factor, 1.0, tolerance) << window << " " << k;
      EXPECT_NEAR(static_gain(both, k, window) / gain, 1.0, tolerance) << window << " " << k;
    }
}

// A delay has no inverse.
TEST(FrozenSystem, OfADelayHasItsPulseResponses) {
  Model model = constant_system({3, 1, 1}, 40, 1.0, 107);
  for (Step& step : model.step) {
    step.A() << 0, 0, 0, 1, 0, 0, 0, 1, 0.5;
    step.B() << 1, 0, 0;
    step.C() << 0, 0, 1;
  }
  const Model longer = continued(frozen_system(model, 20), 20);
  for (Index gap = 1; gap < 15; ++gap)
    // The windows of six steps have condition numbers below 10, and B is the solution of a fit to them.
    EXPECT_NEAR(pulse_response(longer, gap, 0)(0, 0), pulse_response(model, gap, 0)(0, 0), 1e3 * epsilon) << gap;
}

// Beside complex arithmetic: C (zI - A)⁻¹ B + D.
TEST(FrequencyResponse, IsThatOfTheTransferFunction) {
  for (const SystemSize& size : sizes) {
    const Step step = constant_system(size, 1, 0.9, 110 + std::uint64_t(size.n)).step[0];
    const Vector w = (Vector(4) << 0, 0.1, 2, std::numbers::pi / 0.2).finished();
    const std::vector<Eigen::MatrixXcd> found = frequency_response(step, 0.2, w);
    for (Index i = 0; i < w.size(); ++i) {
      const Complex z = std::exp(Complex(0, w(i) * 0.2));
      const Eigen::MatrixXcd resolvent = z * Eigen::MatrixXcd::Identity(size.n, size.n) - step.A().cast<Complex>();
      const Eigen::MatrixXcd expected =
          step.C().cast<Complex>() * resolvent.fullPivLu().solve(step.B().cast<Complex>()) + step.D().cast<Complex>();
      const Eigen::VectorXd sigma = resolvent.jacobiSvd().singularValues();
      EXPECT_LE((found[size_t(i)] - expected).norm(),
                100 * double(size.n) * epsilon * sigma(0) / sigma(size.n - 1) * (1 + expected.norm()));
    }
  }
}

TEST(Floquet, MultipliersDoNotDependOnCoordinatesOrTheFirstStep) {
  for (const Index period : {1, 2, 5, 12}) {
    Model model = periodic_system({3, 1, 1}, 3 * period, period, 1.0, 120 + std::uint64_t(period));
    model.period = period;
    Matrix product = Matrix::Identity(3, 3);
    for (Index k = 0; k < period; ++k) product = model.at(k).A() * product;
    const Eigen::VectorXcd found = floquet_multipliers(model);
    const linalg::Eigensystem e = linalg::eigensystem(product);
    const double tolerance = 1e3 * double(period) * epsilon * e.right.norm() * e.left.norm();
    EXPECT_LE(distance(found, e.values), tolerance);
    for (Index i = 0; i + 1 < 3; ++i) EXPECT_GE(std::abs(found(i)), std::abs(found(i + 1)));
    for (Index k = 1; k < period; ++k)
      EXPECT_LE(distance(floquet_multipliers(from_step(model, k)), found), 100 * tolerance);
    // A periodic change of coordinates.
    std::vector<Matrix> S = transformations(model, 130);
    for (size_t k = size_t(period); k < S.size(); ++k) S[k] = S[k - size_t(period)];
    EXPECT_LE(distance(floquet_multipliers(transform(model, S)), found), 100 * tolerance);
  }
}

// Multipliers far outside the range of numbers, and far apart: eigenvalues of one matrix S_{k+1} D S_k⁻¹ per step.
TEST(Floquet, ExponentsOfLongPeriodsKeepTheirDigits) {
  const Complex pair(0.7, 0.2);
  for (const Index period : {1, 7, 300, 3000}) {
    Model model = constant_system({5, 1, 1}, 2 * period, 1.0, 140);
    Matrix d = Matrix::Zero(5, 5);
    d.diagonal() << 1.9, pair.real(), pair.real(), 0.5, -0.49;
    d(1, 2) = pair.imag(), d(2, 1) = -pair.imag();
    for (Step& step : model.step) step.A() = d;
    std::vector<Matrix> S = transformations(model, 141);
    for (size_t k = size_t(period); k < S.size(); ++k) S[k] = S[k - size_t(period)];
    Model moved = transform(model, S);
    moved.period = period;
    moved.dt = 0.1;
    const Eigen::VectorXcd found = floquet_exponents(moved), multipliers = floquet_multipliers(moved);
    const Complex roots[] = {1.9, pair, std::conj(pair), 0.5, -0.49};
    // Each of the P products has rounding errors of the size of the condition number of S, at most 25.
    const double tolerance = 1e3 * double(period) * epsilon * 25;
    for (Index i = 0; i < 5; ++i) {
      EXPECT_NEAR(found(i).real() * 0.1, std::log(std::abs(roots[i])), tolerance / double(period))
          << period << " " << i;
      if (std::abs(roots[i]) == 0.5 && period < 7) continue;
      const Complex power = std::pow(roots[i] / std::abs(roots[i]), double(period));
      const double angle = std::abs(std::arg(std::exp(Complex(0, found(i).imag() * 0.1 * double(period))) / power));
      const double mirrored = std::abs(std::arg(std::exp(Complex(0, found(i).imag() * 0.1 * double(period))) * power));
      EXPECT_LE(std::min(angle, mirrored), tolerance) << period << " " << i;
      const double size = std::abs(multipliers(i)), log_size = double(period) * std::log(std::abs(roots[i]));
      // The largest number is e^709.8, the smallest one e^-745.
      if (log_size > 710) {
        EXPECT_EQ(size, std::numeric_limits<double>::infinity());
      }
      if (log_size < -746) {
        EXPECT_EQ(size, 0.0);
      }
      if (std::abs(log_size) < 700) {
        EXPECT_NEAR(std::log(size), log_size, tolerance);
      }
    }
  }
}

TEST(Floquet, MultipliersOfDelaysAreZero) {
  Model model = periodic_system({3, 1, 1}, 12, 4, 1.0, 145);
  model.period = 4;
  for (Step& step : model.step) step.A().row(2).setZero();
  const Eigen::VectorXcd found = floquet_multipliers(model), exponents = floquet_exponents(model);
  Matrix product = Matrix::Identity(3, 3);
  for (Index k = 8; k < 12; ++k) product = model.at(k).A() * product;
  EXPECT_LE(distance(found, linalg::eigenvalues(product)), 1e3 * epsilon);
  EXPECT_LE(std::abs(found(2)), 100 * epsilon * std::abs(found(0)));
  EXPECT_LE(exponents(2).real(), -7.0);  // 4 steps make at most log(ε)/4 from rounding errors
}

// Rounding errors of relative size ε in each matrix S_{k+1} D S_k⁻¹ change an eigenvalue d_i by the sum of ε
// ‖row i of S_{k+1}⁻¹‖ ‖S_{k+1}‖ ‖D‖ ‖S_k⁻¹‖ ‖column i of S_k‖ / |d_i| (Wilkinson's condition numbers).
TEST(Floquet, MultipliersInCoordinatesOfAMillionAreAsExactAsTheirCondition) {
  constexpr Index n = 5;
  for (const bool paired : {false, true})
    for (const Index period : {2, 8, 20, 60}) {
      Random random(200 + std::uint64_t(period));
      Matrix d = Matrix::Zero(n, n);
      d.diagonal() << 1.2, 0.9, 0.6, 0.5, 0.4;
      if (paired) d.block(1, 1, 2, 2) << 0.8, 0.3, -0.3, 0.8;
      std::vector<Matrix> S, inverse;
      for (Index k = 0; k < period; ++k) {
        const Vector size = Vector::LinSpaced(n, 0, -6).unaryExpr([](double x) { return std::pow(10.0, x); });
        const Matrix left = random.orthogonal(n), right = random.orthogonal(n);
        S.emplace_back(left * size.asDiagonal() * right);
        inverse.emplace_back(right.transpose() * size.cwiseInverse().asDiagonal() * left.transpose());
      }
      Model model = constant_system({n, 1, 1}, period, 1.0, 201);
      model.period = period;
      Vector tolerance = Vector::Zero(n), expected(n);
      for (Index k = 0; k < period; ++k) {
        const Matrix &to = S[size_t((k + 1) % period)], &back = inverse[size_t((k + 1) % period)];
        model.step[size_t(k)].A() = to * d * inverse[size_t(k)];
        for (Index i = 0; i < n; ++i) {
          const bool twin = paired && (i == 1 || i == 2);  // the pair has an orthonormal basis of two columns
          const Index first = twin ? 1 : i, count = twin ? 2 : 1;
          tolerance(i) += back.middleRows(first, count).norm() * to.norm() * d.norm() * inverse[size_t(k)].norm() *
                          S[size_t(k)].middleCols(first, count).norm() / d.row(i).norm();
        }
      }
      for (Index i = 0; i < n; ++i) expected(i) = double(period) * std::log(d.row(i).norm());
      tolerance *= double(n) * epsilon;
      ASSERT_LT(tolerance.maxCoeff(), 0.2);  // errors of first order
      const Floquet found = floquet(model);
      const Vector size = found.exponents.real() * double(period) * model.dt, error = (size - expected).cwiseAbs();
      for (Index i = 0; i < n; ++i) {
        EXPECT_LE(error(i), tolerance(i)) << paired << " " << period << " " << i;
        EXPECT_LE(found.error(i), 2 * tolerance(i)) << paired << " " << period << " " << i;
      }
      // Both runs rarely have nearly equal errors in all multipliers.
      EXPECT_LE(error.maxCoeff(), 10 * found.error.maxCoeff()) << paired << " " << period;
      EXPECT_EQ(found.exponents, floquet_exponents(model));
      EXPECT_EQ(found.multipliers, floquet_multipliers(model));
    }
}

TEST(Floquet, ErrorsOfWellConditionedMultipliersAreSmall) {
  for (const Index period : {1, 3, 30, 300}) {
    Random random(210 + std::uint64_t(period));
    Model model = constant_system({4, 1, 1}, period, 1.0, 211);
    model.period = period;
    std::vector<Matrix> Q;
    for (Index k = 0; k < period; ++k) Q.push_back(random.orthogonal(4));
    const Vector d = (Vector(4) << 1.5, 0.8, -0.7, 0.1).finished();
    for (Index k = 0; k < period; ++k)
      model.step[size_t(k)].A() = Q[size_t((k + 1) % period)] * d.asDiagonal() * Q[size_t(k)].transpose();
    const Floquet found = floquet(model);
    for (Index i = 0; i < 4; ++i) {
      const double tolerance = 10 * 4 * double(period) * epsilon * d.norm() / std::abs(d(i));
      EXPECT_NEAR(found.exponents(i).real() * model.dt, std::log(std::abs(d(i))), tolerance / double(period));
      EXPECT_LE(found.error(i), tolerance) << period << " " << i;
    }
  }
}

// With as many outputs as states, no shorter window exists: twice the window shows the error of freezing.
TEST(ModeBounds, IncludeTheErrorOfFreezingWithTheShortestWindow) {
  Oscillators plant = one([](double t) { return 6 + 2.5 * t; }, 0.1);
  Model system = plant.model(40);
  system.outputs = 2;
  for (Step& step : system.step) {
    Step both(2, 2, 1, 2);
    both.A() = step.A(), both.B() = step.B(), both.C() = Matrix::Identity(2, 2);
    step = both;
  }
  Ensemble data = with_noise(random_experiments(system, 40, 170), 1e-6, 171);
  data.dt = plant.dt;
  IdentifyOptions options;
  options.states = 2;
  const Model model = identify(data, options).model;
  ConfidenceOptions o;
  o.replicates = 10;
  ModesOptions shortest, longer;
  shortest.window = 2;
  const ModeBounds found = mode_bounds(model, data, shortest, o);
  longer.window = 4;
  const Modes other = modes(model, longer);
  const Index k = 20;
  const double change =
      natural_frequencies(other)(k - other.begin, 0) - found.frequency.estimate(k - found.modes.begin, 0);
  // The error is a third of the change with twice the window; noise of 1e-6 is far below it.
  EXPECT_GT(std::abs(change), 1e-4);
  EXPECT_GT(found.frequency.deviation(k - found.modes.begin, 0), 0.2 * std::abs(change));
  for (Index i = 0; i < found.modes.steps(); ++i) {
    EXPECT_GE(found.damping.lower(i, 0), -1);
    EXPECT_LE(found.damping.upper(i, 0), 1);
    EXPECT_TRUE(std::isfinite(found.frequency.upper(i, 0))) << i;
    // Velocities decay more slowly than positions by the variation.
    const double ratio = found.damping.estimate(i, 0), first_order = found.modes.variation(i, 0) * (1 - ratio * ratio);
    EXPECT_GE(found.damping.upper(i, 0), std::min(1.0, ratio + first_order));
    EXPECT_LE(found.damping.lower(i, 0), std::max(-1.0, ratio - first_order));
  }
}

TEST(ModeBounds, HoldTheTruthOfASlowSystem) {
  const Oscillators plant = one([](double t) { return 4 + 0.2 * t; }, 0.05);
  const Model system = plant.model(60);
  IdentifyOptions options;
  options.states = 2;
  double held = 0.0, all = 0.0, width = 0.0, square = 0.0;
  for (std::uint64_t seed = 0; seed < 6; ++seed) {
    Ensemble data = random_experiments(system, 30, 150 + seed);
    data = with_noise(std::move(data), 0.01, 160 + seed);
    data.dt = plant.dt;
    const Model model = identify(data, options).model;
    ConfidenceOptions o;
    o.replicates = 30;
    const ModeBounds found = mode_bounds(model, data, {}, o);
    EXPECT_EQ(found.replicates, 30);
    ASSERT_EQ(found.modes.count(), 2);
    EXPECT_EQ(found.frequency.estimate, natural_frequencies(found.modes));
    for (Index k = 0; k < found.modes.steps(); ++k) {
      const double truth = plant.w[0](double(found.modes.begin + k) * plant.dt);
      held += found.frequency.lower(k, 0) <= truth && truth <= found.frequency.upper(k, 0);
      width += (found.frequency.upper(k, 0) - found.frequency.lower(k, 0)) / 2;
      square += std::pow(found.frequency.estimate(k, 0) - truth, 2);
      all += 1;
    }
  }
  // Errors of neighbouring steps are correlated: the 48 steps of a model count like 4 independent ones (48 over the sum
  // of the autocorrelations of the errors, measured), those of six models like 24. The coverage of 24 intervals of 95 %
  // has a standard deviation of 4.4 %, and the limit is 1.6 of them below 95 %. Here the coverage is 90 %.
  EXPECT_GE(held, 0.88 * all);
  // Half widths of 95 % are about two standard errors; another half for the error of freezing the time.
  EXPECT_LE(width / all, 3 * std::sqrt(square / all));
}

TEST(ModeBounds, HoldTheFloquetExponentsOfAPeriodicSystem) {
  constexpr Index period = 10, seeds = 8;
  const Oscillators plant =
      one([](double t) { return 4 + std::sin(2 * std::numbers::pi * t / (double(period) * 0.05)); }, 0.05);
  Model system = plant.model(40);
  system.period = period;
  const Complex truth = floquet_exponents(system)(0);
  ASSERT_GT(truth.imag(), 0);
  IdentifyOptions options;
  options.states = 2;
  options.period = period;
  Index held_real = 0, held_imag = 0;
  double width = 0.0, square = 0.0;
  for (std::uint64_t seed = 0; seed < std::uint64_t(seeds); ++seed) {
    Ensemble data = with_noise(random_experiments(system, 30, 220 + seed), 0.01, 230 + seed);
    data.dt = plant.dt;
    const Model model = identify(data, options).model;
    ConfidenceOptions o;
    o.replicates = 30;
    const ModeBounds found = mode_bounds(model, data, {}, o);
    const Eigen::VectorXcd exponents = floquet_exponents(model);
    const Interval &real = found.exponents_real, &imag = found.exponents_imag;
    ASSERT_EQ(real.lower.size(), 2);
    EXPECT_EQ(real.estimate.col(0), exponents.real());
    EXPECT_EQ(imag.estimate.col(0), exponents.imag());
    const Index i = exponents(0).imag() > 0 ? 0 : 1;
    // A conjugate pair has mirrored intervals.
    EXPECT_NEAR(imag.upper(i), -imag.lower(1 - i), 1e-9);
    EXPECT_NEAR(real.upper(i), real.upper(1 - i), 1e-9);
    held_real += real.lower(i) <= truth.real() && truth.real() <= real.upper(i);
    held_imag += imag.lower(i) <= truth.imag() && truth.imag() <= imag.upper(i);
    width += (real.upper(i) - real.lower(i) + imag.upper(i) - imag.lower(i)) / 2;
    square += std::norm(exponents(i) - truth);
  }
  // Of eight intervals of 95 %, fewer than six hold the truth with a probability of 0.6 %.
  EXPECT_GE(held_real, 6);
  EXPECT_GE(held_imag, 6);
  // Half widths are about two standard errors of each part, in sum at most 2√2 times the root mean square of both. That
  // of eight ensembles varies by a quarter.
  EXPECT_LE(width / seeds, 1.5 * 2 * std::sqrt(2.0) * std::sqrt(square / seeds));
  EXPECT_TRUE(std::isfinite(width));
}

}  // namespace
}  // namespace tokid::testing
