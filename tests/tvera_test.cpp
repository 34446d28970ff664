// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/tvera.hpp"

#include <gtest/gtest.h>

#include "testing.hpp"
#include "tokid/example.hpp"

namespace tokid::testing {
namespace {

struct Stage {
  Ensemble data;
  Markov parameters;
};

Stage stage(const Model& system, Index lags, Index experiments, Index band) {
  Stage s;
  s.data = random_experiments(system, experiments, 50);
  GtvArxOptions options;
  options.lags = {lags};
  s.parameters = markov(gtv_arx(s.data, options), band);
  return s;
}

// Lanes hold steps side by side, those at the ends with matrices of other shapes; and one matrix is beyond them.
TEST(Tvera, FactorsOfEveryStepAreThoseOfItsHankelMatrix) {
  const Model system = random_system({4, 2, 2}, 30, 1.0, 57);
  const Stage s = stage(system, 2, 20, 9);
  Markov parameters = s.parameters;
  parameters.system(20).setZero();  // some singular values are zero
  for (const TveraOptions& options : {TveraOptions{.rows = 3, .cols = 4}, TveraOptions{.rows = 2, .cols = 8}}) {
    const HankelFactors factors = hankel_factors(parameters, {}, options);
    ASSERT_EQ(factors.step.size(), 30u);
    for (Index k = 0; k < 30; ++k) {
      const Index rows = std::min<Index>(options.rows, 30 - k), cols = std::min<Index>(options.cols, k);
      Matrix h(rows * 2, cols * 2);
      for (Index a = 0; a < rows; ++a)
        for (Index b = 0; b < cols; ++b) h.block(2 * a, 2 * b, 2, 2) = parameters.h(k + a, k - 1 - b);
      const HankelFactor& factor = factors.step[size_t(k)];
      const linalg::Svd other = linalg::svd(h);
      const double unit = 20 * epsilon * double(rows * 2 + cols * 2) * std::max(1.0, h.norm());
      ASSERT_EQ(factor.singular_values.size(), other.s.size());
      EXPECT_LE((factor.singular_values - other.s).norm(), unit);
      EXPECT_LE((factor.u * (factor.u.transpose() * h) - h).norm(), unit);
      EXPECT_LE((factor.u.transpose() * factor.u - Matrix::Identity(factor.u.cols(), factor.u.cols())).norm(), unit);
    }
  }
}

TEST(Tvera, IsTheSameForAnyNumberOfThreads) {
  const Model system = random_system({4, 2, 2}, 37, 1.0, 58);
  const Stage s = stage(system, 2, 20, 9);
  TveraOptions options{.rows = 3, .cols = 7};
  const Model alone = tvera(s.parameters, {}, options);
  for (const int threads : {2, 3, 8}) {
    options.execution.threads = threads;
    const Model shared = tvera(s.parameters, {}, options);
    EXPECT_EQ(all(shared, &Step::A), all(alone, &Step::A));
    EXPECT_EQ(all(shared, &Step::B), all(alone, &Step::B));
    EXPECT_EQ(all(shared, &Step::C), all(alone, &Step::C));
    EXPECT_EQ(all(shared, &Step::G), all(alone, &Step::G));
    EXPECT_EQ(shared.step, alone.step);
  }
}

// Factors are held for a few thousand steps at a time: neighbours at a boundary have the same coordinates.
TEST(Tvera, IsTheSameAsFromTheFactorsOfAllSteps) {
  const Model system = random_system({2, 1, 1}, 8200, 1.0, 59);
  const Stage s = stage(system, 2, 8, 5);
  const TveraOptions options{.rows = 3, .cols = 3};
  const Model model = tvera(s.parameters, {}, options);
  EXPECT_EQ(model.step, realise(s.parameters, hankel_factors(s.parameters, {}, options), options).step);
  EXPECT_TRUE(kinematically_similar(model, system, 1e-6, 6).similar);
}

TEST(Tvera, StateDimensionGrowsFromZeroAndShrinksAtTheEnd) {
  const Model system = random_system({4, 2, 1}, 30, 1.0, 51);
  const Stage s = stage(system, 2, 20, 6);
  const Model model = tvera(s.parameters, {}, {.rows = 3, .cols = 4});
  model.check();
  ASSERT_EQ(model.steps(), 30);
  std::vector<Index> expected;
  for (Index k = 0; k <= 30; ++k) expected.push_back(std::min<Index>({k * 1, 4, (30 - k) * 2}));
  EXPECT_EQ(state_dims(model), expected);
  EXPECT_TRUE(kinematically_similar(model, system, 1e-9).similar);
}

TEST(Tvera, FreeResponsesGiveTheFullStateFromTheFirstStep) {
  Model system = oscillator(40);
  ExperimentOptions options;
  options.experiments = 20;
  options.free_responses = 6;
  const Ensemble e = experiments(system, options);
  GtvArxOptions arx_options;
  arx_options.lags = {2};
  const Markov parameters = markov(gtv_arx(e, arx_options), 4);
  FreeResponse free = e.free;
  free.y *= 1e6;  // the size of the free states does not matter
  const Model model = tvera(parameters, free, {.rows = 3, .cols = 2});
  for (Index k = 0; k <= 38; ++k) EXPECT_EQ(model.n(k), 4) << k;
  EXPECT_EQ(model.n(39), 2);  // two outputs are left to see the state by
  EXPECT_LE(kinematically_similar(model, system).max_difference, 1e-9);
  // A free response that lacks a sample is left out, and too few of them leave the first state short.
  free.y(0, 1) = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(tvera(parameters, free, {.rows = 3, .cols = 2}).n(0), 4);
  free.y.rightCols(free.y.cols()).bottomRows(3).setConstant(std::numeric_limits<double>::quiet_NaN());
  EXPECT_EQ(tvera(parameters, free, {.rows = 3, .cols = 2}).n(0), 2);
}

TEST(Tvera, AnOrderThatIsAskedForIsAnUpperBound) {
  const Model system = random_system({4, 2, 2}, 24, 1.0, 52);
  const Stage s = stage(system, 3, 40, 8);
  EXPECT_EQ(tvera(s.parameters, {}, {.rows = 4, .cols = 4, .states = 3}).states(), 3);
  // Noise-free data have no fifth state to give: rounding errors are not taken for states.
  const Model model = tvera(s.parameters, {}, {.rows = 4, .cols = 4, .states = 6});
  EXPECT_EQ(model.states(), 4);
  EXPECT_TRUE(kinematically_similar(model, system, 1e-9).similar);
}

TEST(Tvera, SystemsWhoseOrderChangesAreFollowed) {
  // The second pair of states is cut off from inputs and outputs in the first half.
  Model system = random_system({4, 2, 2}, 40, 1.0, 53);
  for (size_t k = 0; k < 20; ++k) {
    system.step[k].A().topRightCorner(2, 2).setZero();
    system.step[k].A().bottomLeftCorner(2, 2).setZero();
    system.step[k].B().bottomRows(2).setZero();
    system.step[k].C().rightCols(2).setZero();
  }
  const Stage s = stage(system, 2, 40, 5);
  const Model model = tvera(s.parameters, {}, {.rows = 3, .cols = 2});
  EXPECT_EQ(model.n(12), 2);
  EXPECT_EQ(model.n(30), 4);
  EXPECT_LE(kinematically_similar(model, system).max_difference, 1e-9);
}

TEST(Tvera, RefusesBlocksBeyondTheBand) {
  const Stage s = stage(random_system({2, 1, 1}, 20, 1.0, 54), 2, 20, 3);
  EXPECT_NO_THROW(tvera(s.parameters, {}, {.rows = 2, .cols = 2}));
  EXPECT_THROW(tvera(s.parameters, {}, {.rows = 3, .cols = 2}), std::invalid_argument);
  EXPECT_THROW(tvera(s.parameters, {}, {.rows = 0, .cols = 2}), std::invalid_argument);
  FreeResponse free{2, 5, Matrix::Zero(2, 7)};
  EXPECT_THROW(tvera(s.parameters, free, {.rows = 2, .cols = 2}), std::invalid_argument);
}

TEST(Tvera, RefusesFactorsOfOtherMarkovParameters) {
  const Stage s = stage(random_system({2, 2, 1}, 20, 1.0, 55), 2, 20, 4);
  const TveraOptions options{.rows = 3, .cols = 2};
  const HankelFactors factors = hankel_factors(s.parameters, {}, options);
  EXPECT_NO_THROW(realise(s.parameters, factors, options));
  const auto refuses = [&](auto&& change) {
    HankelFactors changed = factors;
    change(changed);
    EXPECT_THROW(realise(s.parameters, changed, options), std::invalid_argument);
  };
  refuses([](HankelFactors& f) { f.step.pop_back(); });
  refuses([](HankelFactors& f) { f.k_begin = 1; });
  refuses([](HankelFactors& f) { f.step[7].u.conservativeResize(4, Eigen::NoChange); });
  refuses([](HankelFactors& f) { f.step[7].singular_values.conservativeResize(1); });
  refuses([](HankelFactors& f) { f.rows = 5; });
  EXPECT_THROW(realise(s.parameters, factors, {.output_size = Vector::Ones(3)}), std::invalid_argument);
  EXPECT_THROW(realise(s.parameters, factors, {.input_size = Vector::Zero(1)}), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
