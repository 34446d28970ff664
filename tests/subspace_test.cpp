// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/subspace.hpp"

#include <gtest/gtest.h>

#include "noisy.hpp"
#include "tokid/observer.hpp"
#include "tokid/validate.hpp"

namespace tokid::testing {
namespace {

SubspaceOptions noise_free(TimeVariation variation = {}) {
  SubspaceOptions o;
  o.noisy = false;
  o.variation = variation;
  return o;
}

GtvArx arx_of(const Ensemble& e, Index lags, InitialState initial, TimeVariation variation = {}) {
  SmoothArxOptions o;
  o.lags = lags;
  o.initial_state = initial;
  o.variation = variation;
  return smooth_arx(e, o);
}

// Noise-free recovery on random systems, whose matrices are independent from step to step.
struct Case {
  SystemSize size;
  double growth;  // largest singular value of A_k: the origin is stable below 1, unstable above about 1.2
};

class SubspaceRecovery : public ::testing::TestWithParam<Case> {
 protected:
  template <class Check>
  void for_each_lag_order(double initial, Check&& check) {
    const SystemSize size = GetParam().size;
    for (const Index extra : {0, 1, 4}) {
      const Index p = smallest_lag_order(size) + extra, steps = std::max<Index>(24, 3 * p + size.n);
      SCOPED_TRACE("p = " + std::to_string(p));
      const Model system =
          random_system(size, steps, GetParam().growth, std::uint64_t(size.n + 10 * size.m + 100 * size.r));
      const Index count = minimum_experiments(size.r, size.m, p) + 5;
      check(system, p, random_experiments(system, count, 1, initial), random_experiments(system, 20, 2, initial));
    }
  }
};

TEST_P(SubspaceRecovery, FromUnknownInitialStatesTheStateIsFullAsSoonAsTheSamplesTellIt) {
  for_each_lag_order(30.0, [](const Model& system, Index p, const Ensemble& e, const Ensemble& fresh) {
    Model model = subspace(e, arx_of(e, p, InitialState::unknown), noise_free());
    model.initial_state = InitialState::unknown;
    model.check();
    const Index n = system.states(), seen = smallest_lag_order({n, system.outputs, system.inputs});
    EXPECT_EQ(model.k_begin, p);
    for (Index k = p; k <= system.steps() - seen; ++k) EXPECT_EQ(model.n(k), n) << k;
    const Prediction prediction = predict(model, fresh);
    for (Index k = 2 * p; k < system.steps(); ++k) EXPECT_TRUE(prediction.y.output(k).allFinite()) << k;
    EXPECT_LE(output_error(fresh, prediction.y), 1e-9);
    // Where the regressions are unique, their observer has forgotten an error of the state after p steps (76); else the
    // solutions of smallest norm have one that at least forgets (measured: 0.56 at most).
    for (const double product : deadbeat_products(model, p)) EXPECT_LE(product, p * system.outputs == n ? 1e-8 : 0.8);
    EXPECT_LE(kinematically_similar(model, from_step(system, p)).max_difference, 1e-9);
  });
}

TEST_P(SubspaceRecovery, FromRestEveryStepHasAModel) {
  for_each_lag_order(0.0, [](const Model& system, Index p, const Ensemble& e, const Ensemble& fresh) {
    const Model model = subspace(e, arx_of(e, p, InitialState::zero), noise_free());
    model.check();
    EXPECT_EQ(model.k_begin, 0);
    EXPECT_EQ(model.states(), system.states());
    EXPECT_LE(kinematically_similar(model, system).max_difference, 1e-9);
    EXPECT_LE(output_error(fresh, simulate(model, fresh)), 1e-9);
    EXPECT_LE(output_error(fresh, predict(model, fresh).y), 1e-9);
  });
}

INSTANTIATE_TEST_SUITE_P(
    Grid, SubspaceRecovery,
    ::testing::Values(Case{{1, 1, 1}, 0.9}, Case{{1, 1, 1}, 1.3}, Case{{2, 1, 1}, 0.9}, Case{{2, 1, 1}, 1.3},
                      Case{{3, 1, 1}, 1.0}, Case{{4, 2, 2}, 0.9}, Case{{4, 2, 2}, 1.3}, Case{{3, 2, 1}, 1.3},
                      Case{{2, 3, 1}, 0.9}, Case{{2, 3, 1}, 1.3}, Case{{2, 1, 4}, 0.9}, Case{{2, 1, 4}, 1.3},
                      Case{{5, 2, 3}, 1.0}, Case{{4, 1, 2}, 1.3}, Case{{4, 3, 1}, 1.0}, Case{{6, 1, 1}, 1.0},
                      Case{{12, 3, 2}, 0.9}, Case{{12, 4, 4}, 0.9}, Case{{12, 4, 4}, 1.3}, Case{{12, 2, 1}, 0.9},
                      Case{{12, 2, 1}, 1.3}, Case{{12, 1, 1}, 0.9}, Case{{12, 1, 2}, 1.0}),
    [](const auto& test) { return name(test.param.size) + "growth" + std::to_string(int(10 * test.param.growth)); });

// Later periods repeat the steps of the first, and take no memory for their numbers.
void expect_shared(const Model& model) {
  for (size_t k = size_t(model.period); k < model.step.size(); ++k) {
    const Step &step = model.step[k], &before = model.step[k - size_t(model.period)];
    EXPECT_TRUE(step == before);
    EXPECT_EQ(step.A().data(), before.A().data());
  }
}

TEST(Subspace, OneRecordOfATimeInvariantSystemIsEnough) {
  for (const InitialState initial : {InitialState::zero, InitialState::unknown}) {
    const double size = initial == InitialState::zero ? 0.0 : 5.0;
    const Model system = constant_system({4, 2, 1}, 200, 0.95, 20);
    const TimeVariation invariant{0.0, 1};
    const Ensemble record = random_experiments(system, 1, 21, size), first = stretch(record, 0, 120);
    Model model = subspace(first, arx_of(first, 3, initial, invariant), noise_free(invariant));
    model.check();
    model.initial_state = initial;
    EXPECT_EQ(model.period, 1);
    EXPECT_EQ(model.states(), 4);
    expect_shared(model);
    // It goes on behind the data that it was identified from.
    EXPECT_LE(output_error(record, predict(continued(model, 200), record).y), 1e-9);
    EXPECT_LE(kinematically_similar(model, constant_system({4, 2, 1}, 120, 0.95, 20)).max_difference, 1e-9);
  }
}

TEST(Subspace, OneRecordOfAPeriodicSystemIsEnough) {
  const Model system = periodic_system({4, 2, 1}, 260, 3, 0.95, 22);
  const TimeVariation periodic{0.0, 3};
  const Ensemble record = random_experiments(system, 1, 23), first = stretch(record, 0, 200);
  const Model model = subspace(first, arx_of(first, 3, InitialState::zero, periodic), noise_free(periodic));
  model.check();
  EXPECT_EQ(model.period, 3);
  EXPECT_EQ(model.states(), 4);
  expect_shared(model);
  EXPECT_LE(output_error(record, simulate(continued(model, 260), record)), 1e-9);
}

// PO-MOESP
TEST(Subspace, ProjectionsAreExactWithoutNoise) {
  for (const Index period : {1, 3})
    for (const InitialState initial : {InitialState::zero, InitialState::unknown}) {
      SCOPED_TRACE(period);
      const Model system = periodic_system({4, 2, 1}, 400, period, 0.95, 22);
      SubspaceOptions o = noise_free({0.0, period});
      o.weighting = Weighting::projection;
      Ensemble record = random_experiments(system, 2, 23, initial == InitialState::zero ? 0.0 : 5.0);
      // A missing input ends a stretch that is simulated, a missing output is left out.
      Ensemble first = stretch(record, 0, 300);
      first.u(0, 120, 0) = first.y(1, 50, 1) = std::numeric_limits<double>::quiet_NaN();
      Model model = subspace(first, arx_of(first, 3, initial, o.variation), o);
      model.check();
      model.initial_state = initial;
      EXPECT_EQ(model.period, period);
      EXPECT_EQ(model.states(), 4);
      expect_shared(model);
      EXPECT_LE(output_error(record, predict(continued(model, 400), record).y), 1e-9);
      EXPECT_LE(output_error(record, simulate_data(continued(model, 400), record)), 1e-9);
    }
}

// What the projections are for: simulation where the noise has a memory that the lags of the ARX model don't cover.
TEST(Subspace, ProjectionsSimulateBetterInColouredNoise) {
  for (const std::uint64_t seed : {1, 2, 3, 4}) {
    const Model system = constant_system({3, 1, 1}, 2000, 0.9, 40 + seed);
    Ensemble record = random_experiments(system, 1, 50 + seed);
    const Ensemble fresh = random_experiments(system, 1, 60 + seed);
    Random random(70 + seed);
    double noise = 0.0;
    for (Index k = 0; k < record.steps(); ++k) {
      noise = 0.98 * noise + 0.2 * random.normal();
      record.y(0, k, 0) += noise;
    }
    const TimeVariation invariant{0.0, 1};
    const GtvArx arx = arx_of(record, 6, InitialState::zero, invariant);
    const auto error = [&](Weighting weighting) {
      SubspaceOptions o;
      o.states = 3;
      o.variation = invariant;
      o.weighting = weighting;
      const Model model = subspace(record, arx, o);
      EXPECT_LT(linalg::eigenvalues(model.at(100).closed_loop()).cwiseAbs().maxCoeff(), 1.0);
      return output_error(fresh, simulate(model, fresh));
    };
    // Measured: 0.16 to 0.73.
    EXPECT_LT(error(Weighting::projection), 0.8 * error(Weighting::one_step)) << seed;
  }
}

// All six outputs depend on two of them, so that four block rows show only eight of the 13 states.
TEST(Subspace, DependentOutputsNeedMoreBlockRows) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    Model system = constant_system({13, 6, 1}, 100, 0.95, seed);
    Random random(seed);
    const Matrix mixing = random.matrix(4, 2);
    for (Step& step : system.step) {
      step.C().bottomRows(4) = mixing * step.C().topRows(2);
      step.D().bottomRows(4) = mixing * step.D().topRows(2);
    }
    const Ensemble e = with_noise(random_experiments(system, 19, seed + 10), 1e-6, seed + 20);
    const TimeVariation one_model{0.0, 1};
    SubspaceOptions o;
    o.states = 13;
    o.variation = one_model;
    const Model model = subspace(e, arx_of(e, 16, InitialState::zero, one_model), o);
    EXPECT_GT(validate(model, e).one_step.fit.minCoeff(), 99.9) << seed;
  }
}

TEST(Subspace, StatesAskedForAreAnUpperBound) {
  const Model system = random_system({4, 2, 2}, 30, 0.9, 24);
  const Ensemble e = random_experiments(system, 40, 25, 5.0);
  SubspaceOptions o = noise_free();
  for (const Index states : {1, 2, 3, 4, 9}) {
    o.states = states;
    const Model model = subspace(e, arx_of(e, 4, InitialState::unknown), o);
    model.check();
    EXPECT_EQ(model.states(), std::min<Index>(states, 4));
  }
}

TEST(Subspace, SameBitsForAnyNumberOfThreads) {
  const Ensemble e = noisy_experiments(oscillator(30), 40, 26);
  for (const TimeVariation& variation : {TimeVariation{0.0, 0}, {1.0, 0}, {0.0, 1}, {0.0, 4}}) {
    const GtvArx arx = arx_of(e, 4, InitialState::zero, variation);
    SubspaceOptions o;
    o.variation = variation;
    o.states = 4;
    const Model reference = subspace(e, arx, o);
    for (const int threads : {2, 3, 8}) {
      o.execution.threads = threads;
      const Model model = subspace(e, arx, o);
      ASSERT_EQ(model.steps(), reference.steps());
      for (size_t k = 0; k < model.step.size(); ++k) {
        EXPECT_EQ(model.step[k].A(), reference.step[k].A());
        EXPECT_EQ(model.step[k].B(), reference.step[k].B());
        EXPECT_EQ(model.step[k].C(), reference.step[k].C());
        EXPECT_EQ(model.step[k].D(), reference.step[k].D());
        EXPECT_EQ(model.step[k].G(), reference.step[k].G());
      }
    }
  }
}

TEST(Subspace, SmoothModelsHaveAllStatesAtAllSteps) {
  const Ensemble e = noisy_experiments(oscillator(30), 20, 27);
  SubspaceOptions o;
  o.variation.smoothing = 1.0;
  o.states = 4;
  const Model model = subspace(e, arx_of(e, 4, InitialState::zero, o.variation), o);
  model.check();
  EXPECT_EQ(model.frame, "smooth");
  for (Index k = 0; k <= 30; ++k) EXPECT_EQ(model.n(k), 4);
}

// Noisy data of three systems: slow, at times unstable, and one that does not vary.
struct NoisyCase {
  const char* name;
  Model system;
  TimeVariation variation;
  double bound;  // of the one-step error over that of the Kalman filter
};

std::vector<NoisyCase> noisy_cases() {
  return {{"oscillator", oscillator(60), {1.0, 0}, 1.22},
          {"tube", rotating_tube(60), {1.0, 0}, 1.10},
          {"constant", constant_system({3, 2, 1}, 60, 0.95, 28), {0.0, 1}, 1.02}};
}

TEST(Subspace, NoisyModelsPredictNearlyAsWellAsTheKalmanFilter) {
  for (const NoisyCase& c : noisy_cases())
    for (const std::uint64_t seed : {1, 2, 3}) {
      const Ensemble e = noisy_experiments(c.system, 100, seed);
      SubspaceOptions o;
      o.variation = c.variation;
      o.states = c.system.states();
      const Model model = subspace(e, arx_of(e, 8, InitialState::zero, c.variation), o);
      EXPECT_LE(ratio_to_kalman(model, c.system, seed + 100), c.bound) << c.name << " " << seed;
    }
}

TEST(Subspace, ObserversAreStableHoweverNoisyTheData) {
  for (const NoisyCase& c : noisy_cases())
    for (const Index experiments : {8, 100}) {
      const Ensemble e = noisy_experiments(c.system, experiments, 29);
      SubspaceOptions o;
      o.variation = c.variation;
      o.states = c.system.states();
      const Model model = subspace(e, arx_of(e, 8, InitialState::zero, c.variation), o);
      Matrix product = Matrix::Identity(o.states, o.states);
      for (Index k = 0; k < 60; ++k) product = model.at(k).closed_loop() * product;
      EXPECT_LT(product.norm(), 1e-2) << c.name << " " << experiments;
    }
}

// Weightings of noisy data, by the TimeVariation that goes with each.
const std::vector<std::pair<Weighting, TimeVariation>> weightings{{Weighting::one_step, {0.0, 0}},
                                                                  {Weighting::one_step, {1.0, 0}},
                                                                  {Weighting::many_steps, {0.0, 0}},
                                                                  {Weighting::one_step, {0.0, 1}},
                                                                  {Weighting::projection, {0.0, 1}}};

// A pressure in Pa beside an angle in rad: their noise is 1e9 apart, and its variances 1e18.
TEST(Subspace, GainsDoNotDependOnUnits) {
  const Model system = constant_system({3, 2, 1}, 60, 0.95, 71);
  const Ensemble e = noisy_experiments(system, 60, 72);
  for (const auto& [weighting, variation] : weightings)
    for (const double unit : {1e-9, 1e-7, 1e9}) {
      const Vector units = (Vector(2) << (unit == 1e-7 ? 1e7 : 1.0), unit).finished();
      Ensemble other = e;
      for (Index k = 0; k < e.steps(); ++k) other.output(k) = e.output(k) * units.asDiagonal();
      SubspaceOptions o;
      o.states = 3;
      o.variation = variation;
      o.weighting = weighting;
      const auto predicted = [&](const Ensemble& data) {
        return predict(subspace(data, arx_of(data, 4, InitialState::zero, variation), o), data).y;
      };
      Ensemble in_first_units = predicted(other);
      for (Index k = 0; k < e.steps(); ++k)
        in_first_units.output(k) = in_first_units.output(k) * units.cwiseInverse().asDiagonal();
      // Rounding times the conditions of two regressions on 60 experiments, of at most some hundreds each.
      EXPECT_LT(output_error(predicted(e), in_first_units), 1e5 * epsilon)
          << int(weighting) << ", lambda " << variation.smoothing << ", unit " << unit;
    }
}

// A command that is recorded among the outputs, or an output at rest: what is exact tells nothing of the errors of the
// states, and must neither get gains, read off rounding errors, nor hide the noisy outputs.
TEST(Subspace, OutputsWithoutNoiseSpoilNoOthers) {
  const Model system = constant_system({3, 2, 1}, 60, 0.95, 73);
  const auto with = [&](Ensemble e, bool at_rest) {
    Ensemble all(e.experiments(), e.steps(), 1, 3, e.dt);
    for (Index k = 0; k < e.steps(); ++k) {
      all.input(k) = e.input(k);
      all.output(k).leftCols(2) = e.output(k);
      all.output(k).col(2).setZero();
      if (!at_rest && k > 0) all.output(k).col(2) = 0.7 * e.input(k - 1).col(0);
    }
    return all;
  };
  const Ensemble e = noisy_experiments(system, 60, 74), fresh = noisy_experiments(system, 200, 75);
  const auto errors = [](const Ensemble& truth, const Ensemble& found) {
    double sum = 0.0;
    for (Index k = 8; k < truth.steps() - 8; ++k)
      sum += (truth.output(k).leftCols(2) - found.output(k).leftCols(2)).squaredNorm();
    return std::sqrt(sum);
  };
  for (const auto& [weighting, variation] : weightings)
    for (const bool at_rest : {false, true}) {
      SubspaceOptions o;
      o.states = at_rest ? 3 : 4;
      o.variation = variation;
      o.weighting = weighting;
      const auto model_of = [&](const Ensemble& data) {
        return subspace(data, arx_of(data, 4, InitialState::zero, variation), o);
      };
      const Model plain = model_of(e), model = model_of(with(e, at_rest));
      for (const Step& step : model.step)
        EXPECT_LE(step.G().col(2).norm(), 1e3 * step.G().leftCols(2).norm()) << int(weighting);
      const Ensemble judged = with(fresh, at_rest);
      EXPECT_LT(errors(judged, predict(model, judged).y), 1.1 * errors(fresh, predict(plain, fresh).y))
          << int(weighting) << ", lambda " << variation.smoothing << ", at rest " << at_rest;
    }
}

// An output with little noise beside a noisy one keeps the gains that it has alone.
TEST(Subspace, QuietOutputsArePredictedAsWellAsAlone) {
  const Index steps = 60;
  const auto part = [&](std::uint64_t seed) { return constant_system({2, 1, 1}, steps, 0.97, seed); };
  const auto runs = [](const Model& system, Index count, double noise, std::uint64_t seed) {
    return experiments(system,
                       {.experiments = count, .seed = seed, .process_noise = noise, .measurement_noise = noise});
  };
  const auto beside = [&](const Ensemble& loud, const Ensemble& quiet) {
    Ensemble both(loud.experiments(), steps, 2, 2, loud.dt);
    for (Index k = 0; k < steps; ++k) {
      both.input(k) << loud.input(k), quiet.input(k);
      both.output(k) << loud.output(k), quiet.output(k);
    }
    return both;
  };
  const auto error = [](const Ensemble& truth, Index j, const Ensemble& found, Index own) {
    double sum = 0.0;
    for (Index k = 8; k < truth.steps() - 8; ++k)
      sum += (truth.output(k).col(j) - found.output(k).col(own)).squaredNorm();
    return std::sqrt(sum);
  };
  for (const double noise : {1e-3, 1e-4, 1e-5})
    for (const auto& [weighting, variation] : weightings) {
      SubspaceOptions o;
      if (weighting == Weighting::projection && noise < 1e-4) continue;  // which weighs outputs by their sizes alone
      o.variation = variation;
      o.weighting = weighting;
      const auto predicted = [&](const Ensemble& data, const Ensemble& judged, Index states) {
        o.states = states;
        return predict(subspace(data, arx_of(data, 4, InitialState::zero, variation), o), judged).y;
      };
      const Ensemble quiet = runs(part(81), 80, noise, 82), fresh = runs(part(81), 200, noise, 83);
      const Ensemble both = beside(runs(part(84), 80, 0.5, 85), quiet);
      const Ensemble judged = beside(runs(part(84), 200, 0.5, 86), fresh);
      EXPECT_LT(error(judged, 1, predicted(both, judged, 4), 1), 1.5 * error(fresh, 0, predicted(quiet, fresh, 2), 0))
          << noise << ", " << int(weighting) << ", lambda " << variation.smoothing << ", period " << variation.period;
    }
}

TEST(Subspace, FactorsSplitThePredictor) {
  const Ensemble e = noisy_experiments(oscillator(30), 60, 30);
  const GtvArx arx = arx_of(e, 4, InitialState::zero);
  SubspaceOptions o;
  o.future = 3;
  for (const Weighting weighting : {Weighting::one_step, Weighting::many_steps}) {
    o.weighting = weighting;
    const PredictorFactors factors = predictor_factors(e, arx, o);
    EXPECT_EQ(factors.lags, 4);
    EXPECT_EQ(factors.future, 3);
    ASSERT_EQ(factors.group.size(), 30u);
    // The first block row weighs the regression itself: the same map of the past, and the same with both weightings.
    const PredictorFactor& f = factors.group[12];
    const Matrix expected = linalg::whitener(arx.residual_cov(12)) * arx.coefficients(12).leftCols(4 * 4);
    EXPECT_LE((f.observability.topRows(2) * f.state - expected).norm(), 1e-10 * expected.norm());
    // State samples have the covariance diag(σ).
    Matrix z(60, 16);
    z = e.samples().middleCols(8 * 4, 16);
    const Matrix x = z * f.state.transpose(), covariance = x.transpose() * x / 60.0;
    EXPECT_LE((covariance - Matrix(f.singular_values.head(x.cols()).asDiagonal())).norm(), 1e-9 * f.singular_values(0));
  }
}

TEST(Subspace, MistakesAreNamed) {
  const Ensemble e = noisy_experiments(oscillator(20), 20, 31), shorter = stretch(e, 0, 15);
  EXPECT_THROW(subspace(shorter, arx_of(e, 2, InitialState::zero)), std::invalid_argument);
  SubspaceOptions o;
  o.variation.period = 19;  // p + P samples are needed to see x after every phase
  const TimeVariation long_period{0.0, 19};
  try {
    subspace(e, arx_of(e, 2, InitialState::zero, long_period), o);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "steps: 20 found, at least 21 needed (lag order and period)");
  }
  o.weighting = Weighting::projection;
  try {
    subspace(e, arx_of(e, 2, InitialState::zero, long_period), o);
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    EXPECT_STREQ(error.what(), "steps: 20 found, at least 22 needed (twice the lag order, and the period)");
  }
  o.variation = {};
  EXPECT_THROW(subspace(e, arx_of(e, 2, InitialState::zero), o), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
