// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include <gtest/gtest.h>

#include "base/random.hpp"
#include "model/comparison.hpp"
#include "model/expected_errors.hpp"
#include "model/outlying_samples.hpp"
#include "noisy.hpp"
#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing {
namespace {

TEST(Fit, IsOneHundredPercentLessTheRelativeError) {
  Ensemble y(1, 4, 1, 1), computed = y;
  const double values[] = {1, 2, 3, 6};
  for (Index k = 0; k < 4; ++k) y.y(0, k, 0) = computed.y(0, k, 0) = values[k];
  EXPECT_EQ(fit(y, computed).fit(0), 100.0);
  computed.y(0, 3, 0) = 5;  // error 1; spread about the mean 3: 4 + 1 + 0 + 9
  EXPECT_DOUBLE_EQ(fit(y, computed).fit(0), 100 * (1 - std::sqrt(1.0 / 14)));
  EXPECT_DOUBLE_EQ(fit(y, computed).rmse(0), 0.5);
  computed.y(0, 0, 0) = nan;  // only what is known on both sides counts: spread about 11/3
  EXPECT_EQ(fit(y, computed).samples, 3);
  const Matrix nominal = Matrix::Constant(4, 1, 2.0);  // spread of 2, 3, 6 about it: 0 + 1 + 16
  EXPECT_DOUBLE_EQ(fit(y, computed, nominal).fit(0), 100 * (1 - std::sqrt(1.0 / 17)));
  for (Index k = 0; k < 4; ++k) computed.y(0, k, 0) = nan;
  EXPECT_TRUE(std::isnan(fit(y, computed).fit(0)));
  EXPECT_THROW(fit(y, Ensemble(2, 4, 1, 1)), std::invalid_argument);
}

TEST(Validate, TrueModelsFitNoiseFreeDataCompletely) {
  const Model system = oscillator(40);
  for (const InitialState state : {InitialState::zero, InitialState::unknown}) {
    ExperimentOptions options;
    options.experiments = 8;
    options.initial_state = state;
    const Validation v = validate(system, experiments(system, options), {.horizon = 4});
    for (const Fit* fit : {&v.simulation, &v.one_step, &v.horizon})
      for (const double f : fit->fit) EXPECT_GT(f, 100 - 1e-9);
    EXPECT_TRUE(std::isnan(v.whiteness_p));  // rounding errors are no innovations
    EXPECT_EQ(v.first_predicted, state == InitialState::zero ? 0 : 2);
    EXPECT_TRUE(v.findings.empty());
  }
}

TEST(Fit, BeginsAtTheGivenStep) {
  Ensemble y(2, 6, 1, 1), computed = y;
  Random random(3);
  for (Index k = 0; k < 6; ++k)
    for (Index n = 0; n < 2; ++n) {
      y.y(n, k, 0) = random.normal();
      computed.y(n, k, 0) = k < 2 ? nan : random.normal();
    }
  EXPECT_EQ(fit(y, computed, {}, 2).fit(0), fit(y, computed).fit(0));
  Ensemble late = computed;
  for (Index n = 0; n < 2; ++n) late.y(n, 2, 0) = nan;
  EXPECT_EQ(fit(y, computed, {}, 3).fit(0), fit(y, late).fit(0));
  EXPECT_EQ(fit(y, computed, {}, 3).samples, 6);
}

// A model that is wrong before the first step of the fits, and one that begins late, have the fits of the whole model.
TEST(Validate, FitsBeginAtTheGivenStep) {
  const Model system = oscillator(40);
  ExperimentOptions options;
  options.experiments = 8;
  const Ensemble data = with_noise(experiments(system, options), 0.1, 1);
  const ValidateOptions late{.horizon = 4, .first_step = 20};
  const Validation all = validate(system, data), v = validate(system, data, late);
  EXPECT_EQ(v.first_predicted, 20);
  EXPECT_EQ(v.first_simulated, 20);
  EXPECT_EQ(v.one_step.samples, 8 * 20);
  EXPECT_EQ(v.whiteness_p, all.whiteness_p);  // the tests take all steps
  EXPECT_EQ(v.simulation.fit(0), fit(data, simulate_data(system, data), {}, 20).fit(0));
  EXPECT_EQ(v.one_step.fit(0), fit(data, predict(system, data).y, {}, 20).fit(0));
  EXPECT_EQ(v.horizon.fit(0), fit(data, predict(system, data, {4}).y, {}, 20).fit(0));
  Model off = system;
  for (Index k = 0; k < 20; ++k) off.at(k).C() *= 2, off.at(k).D() *= 2;
  EXPECT_EQ(validate(off, data, late).simulation.fit(0), v.simulation.fit(0));
  EXPECT_LT(validate(off, data).simulation.fit(0), v.simulation.fit(0));
}

TEST(Validate, FirstStepsOfFitsAreChecked) {
  const Model system = oscillator(40);
  ExperimentOptions options;
  options.experiments = 8;
  Ensemble data = with_noise(experiments(system, options), 0.1, 1);
  const std::string words = "first_step: 40 found, 0 to 39 needed";
  EXPECT_NE(message([&] { validate(system, data, {.first_step = 40}); }).find(words), std::string::npos);
  EXPECT_NE(message([&] { experiment_fits(system, data, {.first_step = 40}); }).find(words), std::string::npos);
  EXPECT_NE(message([&] { fit(data, data, {}, 40); }).find(words), std::string::npos);
  EXPECT_THROW(validate(system, data, {.first_step = -1}), std::invalid_argument);
  EXPECT_THROW(fit(data, data, {}, -1), std::invalid_argument);
  // No outputs are left for the fits. Predictions exist all the same, and no finding says otherwise.
  for (Index k = 30; k < 40; ++k) data.output(k).setConstant(nan);
  const Validation v = validate(system, data, {.first_step = 31});
  EXPECT_EQ(v.first_predicted, 31);
  EXPECT_EQ(v.one_step.samples, 0);
  EXPECT_EQ(mentions(v.findings, "no step could be predicted"), 0);
}

// Each row must be what fit() says of this experiment alone.
TEST(ExperimentFits, AreTheFitsOfSingleExperiments) {
  const Model system = random_system({3, 2, 2}, 30, 1.0, 5);
  Ensemble data = with_noise(random_experiments(system, 7, 6, 1.0), 0.1, 7);
  data.initial_state = InitialState::unknown;
  for (Index k = 5; k < 12; ++k) data.y(2, k, 1) = nan;
  for (Index k = 0; k < 30; ++k) data.y(4, k, 0) += 3 * std::cos(k);
  Model nominal = system;
  nominal.u_nominal = Random(8).matrix(30, 2);
  nominal.y_nominal = Random(9).matrix(30, 2);
  for (const Model* model : {&system, static_cast<const Model*>(&nominal)})
    for (const Index first : {0, 11}) {
      ValidateOptions options;
      options.first_step = first;
      const ExperimentFits found = experiment_fits(*model, data, options);
      const Ensemble predicted = predict(*model, data).y, simulated = simulate_data(*model, data);
      for (Index n = 0; n < 7; ++n) {
        const Fit one = fit(data.subset({n}), predicted.subset({n}), model->y_nominal, first),
                  all = fit(data.subset({n}), simulated.subset({n}), model->y_nominal, first);
        for (Index j = 0; j < 2; ++j) {
          // Both sum up to 60 squares, in another order: relative errors of the sums below 60 ε, and the fit is
          // 100 times a root of their quotient.
          const double tolerance = 60 * epsilon;
          EXPECT_NEAR(found.one_step_rmse(n, j), one.rmse(j), tolerance * one.rmse(j));
          EXPECT_NEAR(found.simulation_rmse(n, j), all.rmse(j), tolerance * all.rmse(j));
          EXPECT_NEAR(found.one_step_fit(n, j), one.fit(j), tolerance * (200 + std::abs(one.fit(j))));
          EXPECT_NEAR(found.simulation_fit(n, j), all.fit(j), tolerance * (200 + std::abs(all.fit(j))));
        }
      }
      EXPECT_EQ(found.worst_first.size(), 7u);
      if (model == &nominal) continue;  // a trajectory that does not belong to the data spoils all experiments
      EXPECT_EQ(found.worst_first.front(), 4);
      EXPECT_EQ(found.over_median(4, 0), found.over_median.maxCoeff());
    }
}

// The pooled errors against a formula of their own: all samples of an experiment, each relative to the spread of its
// output. The fits that a comparison has are those of the function that keeps no outputs.
TEST(ExperimentFits, PoolTheOutputsAndMarkOutlyingExperiments) {
  const Model system = random_system({3, 2, 2}, 30, 1.0, 5);
  Ensemble data = with_noise(random_experiments(system, 9, 6, 1.0), 0.1, 7);
  data.initial_state = InitialState::zero;
  for (Index k = 5; k < 12; ++k) data.y(2, k, 1) = nan;
  for (Index k = 0; k < 30; ++k) data.y(4, k, 0) *= -1, data.y(4, k, 1) += 100;  // a large output with a large spread
  Model nominal = system;
  nominal.u_nominal = Matrix::Zero(30, 2);
  nominal.y_nominal = Matrix::Constant(30, 2, 0.3);
  for (const Model* model : {&system, static_cast<const Model*>(&nominal)})
    for (const Index first : {0, 11}) {
      ValidateOptions options;
      options.first_step = first;
      const ExperimentFits found = experiment_fits(*model, data, options);
      const Comparison compared = compare(*model, data, options);
      const Vector spread = output_spread(*model, data);
      Vector excess = Vector::Zero(9);
      for (const bool one_step : {true, false}) {
        const Ensemble& computed = one_step ? compared.prediction.y : compared.simulated;
        const Vector& error = one_step ? found.one_step_error : found.simulation_error;
        const auto& samples = one_step ? found.one_step_samples : found.simulation_samples;
        std::vector<double> errors;
        for (Index n = 0; n < 9; ++n) {
          double squares = 0.0;
          Index count = 0;
          for (Index k = first; k < 30; ++k)
            for (Index j = 0; j < 2; ++j)
              if (const double e = (data.y(n, k, j) - computed.y(n, k, j)) / spread(j); !std::isnan(e))
                squares += e * e, ++count;
          EXPECT_EQ(samples.row(n).sum(), count);
          // 60 squares in another order, of differences whose rounding errors are those of outputs up to 100.
          EXPECT_NEAR(error(n), std::sqrt(squares / double(count)),
                      60 * epsilon * error(n) + 100 * epsilon / spread.minCoeff());
          errors.push_back(error(n));
        }
        std::sort(errors.begin(), errors.end());
        const double limit = one_step ? found.one_step_limit : found.simulation_limit;
        EXPECT_EQ(limit, std::max(0.05, 10 * errors[4]));
        excess = excess.cwiseMax(error / limit);
      }
      EXPECT_EQ(found.excess, excess);
      for (Index n = 0; n < 9; ++n) EXPECT_EQ(found.outlying(n), n == 4) << n << " " << found.excess(n);
      EXPECT_EQ(found.worst_first.front(), 4);
      EXPECT_EQ(compared.experiments.worst_first, found.worst_first);
      EXPECT_EQ(compared.experiments.one_step_samples, found.one_step_samples);
      EXPECT_LE((compared.experiments.excess - found.excess).cwiseAbs().maxCoeff(),
                60 * epsilon * found.excess.maxCoeff() + 100 * epsilon / spread.minCoeff());
    }
}

// One or two experiments have no usual error, unless one of two overflows.
TEST(ExperimentFits, MarkNoneOfTwoAndThoseThatOverflow) {
  const Model system = oscillator(20);
  ExperimentOptions options;
  options.experiments = 6;
  const Ensemble data = with_noise(experiments(system, options), 0.1, 1);
  Ensemble far = data.subset({0, 1});
  for (Index k = 0; k < 20; ++k) far.output(k).row(0) *= -1;
  EXPECT_FALSE(experiment_fits(system, far).outlying(0));
  Ensemble over = data.subset({0, 1});
  over.u(1, 5, 0) = 1e200;
  EXPECT_FALSE(experiment_fits(system, over).outlying(0));
  EXPECT_TRUE(experiment_fits(system, over).outlying(1));
  EXPECT_FALSE(experiment_fits(system, over.subset({1})).outlying(0));  // alone
  Ensemble huge = data;
  huge.u(3, 5, 0) = 1e200;  // the squares of the outputs of the model are infinite
  const ExperimentFits found = experiment_fits(system, huge);
  EXPECT_TRUE(std::isinf(found.simulation_error(3)) && std::isinf(found.excess(3)));
  EXPECT_EQ(found.worst_first.front(), 3);
  for (Index n = 0; n < 6; ++n) EXPECT_EQ(found.outlying(n), n == 3) << n;
}

// An observer of output 0 that predicts the last sample. After a jump of experiment 3, one prediction of this output is
// wrong, but the simulation of all later steps. Output 1 has errors in between.
TEST(ExperimentFits, NameTheOutputOfTheErrorThatGivesTheExcess) {
  Model system = constant_system({1, 2, 1}, 30, 1.0, 5);
  for (Step& step : system.step) {
    step.A()(0, 0) = 1.0, step.B()(0, 0) = 1.0, step.C() << 1.0, 0.0, step.D() << 0.0, 1.0, step.G() << -1.0, 0.0;
  }
  system.initial_state = InitialState::zero;
  Ensemble data = with_noise(random_experiments(system, 9, 6), 0.01, 7);
  data.initial_state = InitialState::zero;
  for (Index k = 5; k < 30; ++k) data.y(3, k, 0) += 100;
  for (Index k = 0; k < 30; ++k) data.y(3, k, 1) += k % 2 == 0 ? 30 : -30;
  for (Index k = 0; k < 30; ++k) data.y(6, k, 1) *= -1;
  for (Index k = 0; k < 30; ++k) data.y(8, k, 0) = data.y(8, k, 1) = nan;
  const ExperimentFits found = experiment_fits(system, data);
  EXPECT_GT(found.over_median(3, 1), found.over_median(3, 0));
  EXPECT_EQ(found.excess(3), found.simulation_error(3) / found.simulation_limit);
  EXPECT_EQ(found.worst_output[3], Index(0));
  EXPECT_EQ(found.worst_output[6], Index(1));
  EXPECT_EQ(found.worst_output[8], std::nullopt);
}

// Models that begin late or go on, and experiments of other lengths.
TEST(ExperimentFits, CoverTheStepsThatAreThere) {
  Model period = random_system({2, 2, 1}, 6, 1.0, 5);
  period.period = 6;
  const Model whole = cut(period, 0, 30), late = from_step(whole, 9);
  Ensemble data = with_noise(random_experiments(whole, 5, 6), 0.1, 7);
  data.initial_state = InitialState::zero;
  set_length(data, {30, 30, 20, 30, 30});
  const ExperimentFits found = experiment_fits(whole, data), of_late = experiment_fits(late, data);
  EXPECT_EQ(experiment_fits(period, data).one_step_rmse, found.one_step_rmse);
  const Fit of_short = fit(data.subset({2}), predict(whole, data).y.subset({2}));
  EXPECT_EQ(of_short.samples, 20);
  // Sums of 20 squares in another order.
  EXPECT_NEAR(found.one_step_rmse(2, 1), of_short.rmse(1), 20 * epsilon * of_short.rmse(1));
  EXPECT_NEAR(of_late.one_step_rmse(2, 1), fit(data.subset({2}), predict(late, data).y.subset({2})).rmse(1),
              20 * epsilon * of_short.rmse(1));
}

TEST(ExperimentFits, PutExperimentsWithoutOutputsLast) {
  const Model system = oscillator(20);
  ExperimentOptions options;
  options.experiments = 4;
  Ensemble data = with_noise(experiments(system, options), 0.1, 1);
  for (Index k = 0; k < 20; ++k) data.y(0, k, 0) = data.y(0, k, 1) = nan;
  const ExperimentFits found = experiment_fits(system, data);
  EXPECT_EQ(found.worst_first.back(), 0);
  EXPECT_TRUE(std::isnan(found.one_step_fit(0, 0)) && std::isnan(found.over_median(0, 0)));
  EXPECT_TRUE(std::isnan(found.excess(0)) && !found.outlying(0));
  EXPECT_FALSE(found.over_median.bottomRows(3).array().isNaN().any());
  EXPECT_FALSE(found.excess.tail(3).array().isNaN().any());
}

TEST(Validate, SaysWhenNothingCanBePredicted) {
  const Model system = oscillator(40);
  ExperimentOptions options;
  options.initial_state = InitialState::unknown;
  Ensemble e = experiments(oscillator(2), options);  // two steps: as many as the state needs
  const Validation v = validate(system, e);
  EXPECT_TRUE(std::isnan(v.one_step.fit(0)));
  ASSERT_FALSE(v.findings.empty());
  EXPECT_NE(in_words(v.findings)[0].find("no step could be predicted"), std::string::npos);
  EXPECT_THROW(validate(from_step(system, 10), e), std::invalid_argument);
}

std::vector<Index> outlying_steps(const Validation& v, Index experiment, Index output) {
  for (const OutlyingSamples& o : v.outlying)
    if (o.experiment == experiment && o.output == output) return o.steps;
  return {};
}

// Neither those that a fault leaves behind in the observer, nor less.
TEST(OutlyingSamples, AreFoundWhereTheyAre) {
  for (const InitialState initial : {InitialState::zero, InitialState::unknown})
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      const Model system = random_system({3, 2, 2}, 61, 0.95, seed);
      Ensemble e = noisy_experiments(system, 12, seed, initial);
      e.y(7, 4, 1) += 100;  // soon after the first prediction from unknown states
      e.y(7, 20, 1) += 100;
      e.y(7, 21, 1) += 100;
      e.y(7, 41, 1) -= 200;
      e.y(3, 60, 0) += 100;  // the last step
      const Validation v = validate(system, e, {.initial_state = initial});
      EXPECT_EQ(v.outlying.size(), 2) << "seed " << seed;
      EXPECT_EQ(outlying_steps(v, 7, 1), (std::vector<Index>{4, 20, 21, 41})) << "seed " << seed;
      EXPECT_EQ(outlying_steps(v, 3, 0), std::vector<Index>{60}) << "seed " << seed;
      for (const OutlyingSamples& o : v.outlying)  // without the fault it is within five standard deviations
        EXPECT_NEAR(o.error, o.experiment == 7 ? 200 : 100, 5 * o.usual / 0.67);
      ASSERT_EQ(v.findings.size(), 2);
      EXPECT_NE(in_words(v.findings).back().find("experiment 7, output"), std::string::npos);
      EXPECT_EQ(validate(system, e, {.initial_state = initial, .misfits = {"7"}}).outlying.size(), 1);
    }
}

// Steps without an error of consequence are skipped, until one follows.
TEST(OutlyingSamples, OfDataWithoutNoiseDoNotDependOnTheStepsBefore) {
  const Model system = oscillator(60);
  ExperimentOptions options;
  options.experiments = 30;  // medians over 14 steps
  Ensemble e = experiments(system, options);
  e.y(3, 45, 1) += 10.0;
  const Validation skipped = validate(system, e);
  ASSERT_EQ(skipped.outlying.size(), 1);
  EXPECT_EQ(outlying_steps(skipped, 3, 1), std::vector<Index>{45});
  EXPECT_NEAR(skipped.outlying.front().error, 10.0, 1e-6);
  e.y(9, 0, 0) += 10.0;  // from the first step on nothing is skipped
  const Validation all = validate(system, e);
  ASSERT_EQ(all.outlying.size(), 2);
  EXPECT_EQ(outlying_steps(all, 3, 1), std::vector<Index>{45});
  EXPECT_EQ(outlying_steps(all, 9, 0), std::vector<Index>{0});
  EXPECT_EQ(all.outlying.front().usual, skipped.outlying.front().usual);
}

TEST(OutlyingSamples, AreFoundInASingleRecordUpToItsEnd) {
  const Model system = constant_system({2, 1, 1}, 321, 0.9, 2);
  Ensemble e = noisy_experiments(system, 1, 2);
  e.y(0, 100, 0) += 50;
  e.y(0, 320, 0) += 50;
  EXPECT_EQ(outlying_steps(validate(system, e), 0, 0), (std::vector<Index>{100, 320}));
}

// Outputs that are missing at every other step, and outputs far from zero.
TEST(OutlyingSamples, AreFoundBesideOutputsOfAnotherRate) {
  Model system = random_system({3, 2, 1}, 60, 0.95, 4);
  Ensemble e = noisy_experiments(system, 20, 4);
  for (Index k = 1; k < 60; k += 2) e.output(k).col(1).setConstant(nan);
  e.y(5, 31, 0) += 100;
  EXPECT_EQ(outlying_steps(validate(system, e), 5, 0), std::vector<Index>{31});
  constexpr double offset = 1e6;
  for (Index k = 0; k < 60; ++k) e.output(k).array() += offset;
  system.u_nominal = Matrix::Zero(60, 1);
  system.y_nominal = Matrix::Constant(60, 2, offset);
  EXPECT_EQ(outlying_steps(validate(system, e), 5, 0), std::vector<Index>{31});
}

// Of identify() in the rows of all data, whatever part of them is held out, or left out as a copy.
TEST(OutlyingSamples, OfAnIdentificationHaveTheRowsOfTheData) {
  const Model system = random_system({2, 1, 1}, 40, 0.9, 6);
  Ensemble e = noisy_experiments(system, 40, 6);
  for (Index k = 0; k < 40; ++k) e.u(3, k, 0) = e.u(1, k, 0), e.y(3, k, 0) = e.y(1, k, 0);
  for (Index n = 10; n < 20; ++n) e.y(n, n + 5, 0) += 100;
  for (const double share : {0.0, 0.2}) {
    const Identification found = identify(e, {.hold_out = share});
    EXPECT_EQ(found.validation.outlying.size(), 10) << share;
    for (const OutlyingSamples& o : found.validation.outlying) {
      EXPECT_TRUE(o.experiment >= 10 && o.experiment < 20 && o.name.empty()) << o.experiment << ' ' << o.name;
      EXPECT_EQ(o.steps, std::vector<Index>{o.experiment + 5});
    }
  }
}

// Experiment 0 begins 5 standard deviations of the other initial states away. Only its fault at step 30 is a fault. The
// model is the truth, because such a state makes the errors of an identified model visible too.
TEST(OutlyingSamples, AreNoneOfAnUnusualInitialState) {
  Index others = 0;  // validations that find more
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Model system = random_system({3, 2, 2}, 61, 0.95, seed);
    ExperimentOptions options{.process_noise = 0.02, .measurement_noise = 0.05, .initial_state = InitialState::unknown};
    const Model model = with_noise(system, options);
    ASSERT_TRUE(has_initial_estimate(model, InitialState::unknown));
    Ensemble at_rest(1, 61, 2, 2);
    for (Index k = 0; k < 61; ++k) at_rest.input(k).setZero();
    const Ensemble free = simulate(system, at_rest, Matrix::Constant(3, 1, 5.0));
    for (const Index count : {1, 20})
      for (const Index begin : {30, 0}) {  // a fault of one sample, or of a sensor from the start
        options.experiments = count;
        options.seed = seed + 100;
        Ensemble e = experiments(system, options);
        for (Index k = 0; k < e.steps(); ++k) e.output(k).row(0) += free.output(k).row(0);
        for (Index k = begin; k < (begin == 0 ? 61 : begin + 1); ++k) e.y(0, k, 1) += 3;
        const Validation v = validate(model, e);
        if (begin == 0) {
          EXPECT_TRUE(count == 1 || !v.outlying.empty()) << seed;  // one experiment has no others beside it
          continue;
        }
        EXPECT_EQ(std::ranges::count(outlying_steps(v, 0, 1), 30), 1) << count << ' ' << seed;
        others += v.outlying.size() > 1 || v.outlying[0].steps.size() > 1;
      }
  }
  EXPECT_LE(others, 2);  // of 20; 5 % expected
}

// Normal errors, of few experiments and many, from unknown states, and behind gaps.
TEST(OutlyingSamples, AreNoneOfNormalErrors) {
  for (const Index count : {1, 4, 20, 200})
    for (const InitialState initial : {InitialState::zero, InitialState::unknown})
      for (const double missing : {0.0, 0.05})
        for (std::uint64_t seed = 1; seed <= 5; ++seed) {
          const Model system = random_system({3, 2, 1}, 100, 0.95, seed);
          Ensemble e = noisy_experiments(system, count, seed, initial);
          RandomNumbers random(seed);
          for (Index n = 0; n < count; ++n)
            for (Index k = 0; k < e.steps(); ++k)
              if (random.uniform() < missing) e.y(n, k, 0) = nan;
          if (missing > 0 && count > 1)
            for (Index k = 30; k < 60; ++k) e.y(1, k, 0) = e.y(1, k, 1) = nan;
          for (const OutlyingSamples& o : validate(system, e).outlying)
            ADD_FAILURE() << count << ' ' << missing << ' ' << seed << ": experiment " << o.experiment << ", output "
                          << o.output << ", step " << o.steps.front() << ", error " << o.error << ", usual " << o.usual;
        }
}

// Mean squares of what the simulations and predictions of true models leave, over their expectations. Of N experiments
// the standard deviation is √(2/N); the largest of some hundred means lies within five of them.
TEST(ExpectedErrors, AreThoseOfTrueModels) {
  constexpr Index N = 4000, T = 30;
  for (const bool unstable : {false, true})
    for (const InitialState state : {InitialState::zero, InitialState::unknown})
      for (const bool estimate : {true, false}) {
        const ExperimentOptions options{
            .experiments = N, .seed = 5, .process_noise = 0.1, .measurement_noise = 0.3, .initial_state = state};
        Model model = with_noise(unstable ? random_system({3, 2, 1}, T, 1.3, 8) : oscillator(T), options);
        const Ensemble data = experiments(model, options);
        // Without them the first samples tell the initial states.
        if (!estimate) model.x0_mean.resize(0), model.x0_cov.resize(0, 0);
        const Matrix expected = expected_simulation_errors(model, all(model, &Step::innovation_cov), state, T);
        const Ensemble simulated = simulate_data(model, data, state);
        for (Index k = 0; k < T; ++k)
          for (Index j = 0; j < model.outputs; ++j) {
            const double found = (data.output(k).col(j) - simulated.output(k).col(j)).squaredNorm() / double(N);
            EXPECT_EQ(std::isnan(expected(k, j)), std::isnan(found)) << k;
            // As many samples as states leave rounding errors.
            if (std::isfinite(found)) {
              EXPECT_NEAR(found, expected(k, j), 5 * std::sqrt(2.0 / N) * expected(k, j) + 1e-20) << k;
            }
          }
        if (state == InitialState::unknown) continue;
        constexpr Index horizons = 6;
        const Matrix ahead = expected_prediction_errors(model, all(model, &Step::innovation_cov), 0, T, horizons);
        for (Index h = 1; h <= horizons; ++h) {
          const Ensemble predicted = predict(model, data, {h}).y;
          Vector found = Vector::Zero(model.outputs);
          for (Index k = h - 1; k < T; ++k)
            found += (data.output(k) - predicted.output(k)).colwise().squaredNorm().transpose();
          found /= double(N) * double(T - h + 1);
          for (Index j = 0; j < model.outputs; ++j)
            EXPECT_NEAR(found(j) / ahead(h - 1, j), 1.0, 5 * std::sqrt(2.0 / N)) << h;
        }
      }
}

TEST(Conclusions, SayWhatWasNotTested) {
  const Model system = oscillator(40);
  const Conclusions exact = conclusions(validate(system, experiments(system)), system.names);
  for (const Conclusion& c : exact.all()) {
    EXPECT_EQ(c.result, TestResult::untested);
    EXPECT_EQ(c.reason, Conclusion::Reason::rounding_level);
    EXPECT_EQ(in_words(c), "not tested (the innovations are at rounding level)");
  }
}

// An effect that is a hundredth of the outputs, known to 200 %, is no confirmation of the model to 200 %.
TEST(Conclusions, NameInputsWhoseEffectIsLostInTheNoise) {
  Validation v;
  v.noisy = true;
  Channels names;
  names.input_names = {"torque", "brake"};
  v.gains = {Vector::Zero(2), (Vector(2) << 0.01, 0.8).finished(), (Vector(2) << 0.9, 0.01).finished()};
  const Conclusion found = conclusions(v, names).gains;
  EXPECT_EQ(found.result, TestResult::nothing);
  EXPECT_EQ(found.reason, Conclusion::Reason::gains_confirmed);
  EXPECT_EQ(found.channels, (std::vector<Finding::Channel>{{false, 1, "brake"}}));
  EXPECT_EQ(
      in_words(found),
      "the outputs respond to the other inputs as strongly as the model says (± 2.6 %); the response to brake is too "
      "small to be seen in the noise");
  v.gains.deviation(0) = 0.8, v.gains.share(0) = 0.01;
  EXPECT_EQ(conclusions(v, names).gains.reason, Conclusion::Reason::gains_lost_in_noise);
  EXPECT_EQ(in_words(conclusions(v, names).gains),
            "the response to torque, brake is too small to be seen in the noise");
}

}  // namespace
}  // namespace tokid::testing
