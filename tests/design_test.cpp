// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/design.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/identify.hpp"

namespace tokid {
namespace {

using testing::epsilon;
using testing::SystemSize;

constexpr InputKind model_free[] = {InputKind::gaussian, InputKind::binary, InputKind::multisine,
                                    InputKind::orthogonal};

PlanOptions options_for(const SystemSize& size, Index steps, Index experiments = 0) {
  PlanOptions options;
  options.states = size.n;
  options.inputs = size.r;
  options.outputs = size.m;
  options.steps = steps;
  options.experiments = experiments;
  return options;
}

PlanOptions oscillator_options(Index experiments = 10) { return options_for({4, 2, 2}, 80, experiments); }

// Columns of the inputs of the window at step k, of unit norm.
Matrix window_columns(const Ensemble& inputs, Index k, Index p) {
  Matrix u(inputs.experiments(), (std::min(p, k) + 1) * inputs.inputs());
  for (Index j = k - std::min(p, k), at = 0; j <= k; ++j, at += inputs.inputs())
    u.middleCols(at, inputs.inputs()) = inputs.input(j);
  u.colwise().normalize();
  return u;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

// The largest condition number over the steps: as the regression measures it, and of the singular values of the windows
// themselves from step p + ⌈n/r⌉ on, where the inputs have moved all states.
struct Worst {
  double scaled = 0.0, plain = 0.0;
};
Worst worst_condition(const Model& system, const Ensemble& inputs, Index p) {
  const Ensemble data = simulate(system, inputs);
  GtvArxOptions options;
  options.lags = {p};
  Worst worst;
  for (const GtvArxStep& step : gtv_arx(data, options).step) worst.scaled = std::max(worst.scaled, step.condition);
  for (Index k = p + (system.states() + system.inputs - 1) / system.inputs; k < data.steps(); ++k) {
    const Vector s = linalg::singular_values(data.window(k, p));
    worst.plain = std::max(worst.plain, s(0) / s(s.size() - 1));
  }
  return worst;
}

template <class Inputs>
Worst median_worst(Index seeds, Inputs&& inputs) {
  const Model system = oscillator(80);
  std::vector<double> scaled, plain;
  for (Index seed = 1; seed <= seeds; ++seed) {
    const Worst worst = worst_condition(system, inputs(std::uint64_t(seed)), 2);
    scaled.push_back(worst.scaled);
    plain.push_back(worst.plain);
  }
  return {median(scaled), median(plain)};
}

Worst gaussian_ensembles() {
  static const Worst worst = median_worst(200, [](std::uint64_t seed) {
    ExperimentOptions options;
    options.experiments = 10;
    options.seed = seed;
    return experiments(oscillator(80), options);
  });
  return worst;
}

bool mentions(const std::vector<std::string>& texts, const std::string& word) {
  return std::any_of(texts.begin(), texts.end(), [&](const auto& t) { return t.find(word) != std::string::npos; });
}

std::string complaint(const PlanOptions& options, const Model* model = nullptr) {
  try {
    model ? plan(*model, options) : plan(options);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(Design, GaussianEnsemblesOfTheOscillatorAreAsIllConditionedAsPublished) {
  // 2.4e4; the median of 200 draws from a distribution with so heavy a tail is known within a fifth or so.
  EXPECT_NEAR(gaussian_ensembles().plain, 2.4e4, 0.25 * 2.4e4);
  EXPECT_NEAR(gaussian_ensembles().scaled, 2.8e4, 0.25 * 2.8e4);
}

// 200 seeds gave factors of 4.2 and 4.3, and 40 of them deviate by no more than a third.
TEST(Design, OrthogonalInputsHalveTheConditionKnowingOnlyTheSizes) {
  const Worst worst = median_worst(100, [](std::uint64_t seed) {
    PlanOptions options = oscillator_options();
    options.seed = seed;
    return plan(options).inputs;
  });
  EXPECT_LT(worst.scaled, gaussian_ensembles().scaled / 2);
  EXPECT_LT(worst.plain, gaussian_ensembles().plain / 2);
}

// Ten seeds gave factors of 259 and 168.
TEST(Design, AModelMakesTheConditionSmallerByFar) {
  const Model system = oscillator(80);
  const Worst worst = median_worst(5, [&](std::uint64_t seed) {
    PlanOptions options = oscillator_options();
    options.seed = seed;
    return plan(system, options).inputs;
  });
  EXPECT_LT(worst.scaled, gaussian_ensembles().scaled / 100);
  EXPECT_LT(worst.plain, gaussian_ensembles().plain / 50);
}

TEST(Design, AModelWithErrorsOfFivePercentIsGoodEnough) {
  const Worst worst = median_worst(5, [](std::uint64_t seed) {
    testing::Random random(seed);
    Model wrong = oscillator(80);
    // The same relative errors at all steps: of what A does beyond holding the state, and of B, C and D.
    const auto spoil = [&](std::vector<Matrix>& list, const Matrix& held) {
      const Matrix factor = (1 + 0.05 * random.matrix(held.rows(), held.cols()).array()).matrix();
      for (Matrix& a : list) a = held + (a - held).cwiseProduct(factor);
    };
    spoil(wrong.A, Matrix::Identity(4, 4));
    spoil(wrong.B, Matrix::Zero(4, 2));
    spoil(wrong.C, Matrix::Zero(2, 4));
    spoil(wrong.D, Matrix::Zero(2, 2));
    PlanOptions options = oscillator_options();
    options.seed = seed;
    return plan(wrong, options).inputs;
  });
  EXPECT_LT(worst.scaled, gaussian_ensembles().scaled / 50);
  EXPECT_LT(worst.plain, gaussian_ensembles().plain / 50);
}

TEST(Design, NumbersHaveTheirReasons) {
  Plan p = plan(oscillator_options(0));
  EXPECT_EQ(p.lags, 2);
  EXPECT_EQ(p.unknowns, 10);
  EXPECT_EQ(p.minimum, 10);
  EXPECT_EQ(p.recommended, 15);  // 10 (11/9)² = 14.9
  EXPECT_EQ(p.inputs.experiments(), 15);
  EXPECT_DOUBLE_EQ(p.excess, 10.0 / 4.0);
  EXPECT_TRUE(mentions(p.reasons, "2 + 2·4 = 10"));
  EXPECT_TRUE(mentions(p.reasons, "with noise 111"));

  PlanOptions noisy = oscillator_options(0);
  noisy.noise = NoiseLevel{0.0, 0.1};
  p = plan(noisy);
  EXPECT_EQ(p.recommended, 111);  // 10 / (111 - 10 - 1) = 0.1
  EXPECT_NEAR(p.excess, 0.1, 1e-15);
  EXPECT_TRUE(std::isnan(p.markov_error));
  noisy.nominal = true;
  p = plan(noisy);
  EXPECT_EQ(p.minimum, 11);
  EXPECT_EQ(p.recommended, 112);
  EXPECT_NEAR(p.excess, 0.1, 1e-15);
  noisy.nominal = false;
  noisy.lags = 3;
  p = plan(noisy);
  EXPECT_EQ(p.minimum, 14);
  EXPECT_TRUE(mentions(p.warnings, "p·m = 6 exceeds n = 4"));

  PlanOptions unknown = oscillator_options();
  unknown.initial_state = InitialState::unknown;
  p = plan(unknown);
  EXPECT_EQ(p.first_step, 2);
  EXPECT_TRUE(std::isnan(p.input_condition[1]) && p.input_condition[2] >= 1);
  EXPECT_TRUE(mentions(p.reasons, "steps 0 to 1 serve as lags only"));
  EXPECT_TRUE(mentions(p.warnings, "no degree of freedom"));
  EXPECT_EQ(p.inputs.initial_state, InitialState::unknown);
}

TEST(Design, EveryKindKeepsItsLimitsAndIsTheSameAgain) {
  const Model system = oscillator(30);
  for (const InputKind kind :
       {InputKind::gaussian, InputKind::binary, InputKind::multisine, InputKind::orthogonal, InputKind::optimised}) {
    SCOPED_TRACE(to_string(kind));
    PlanOptions options = options_for({4, 2, 2}, 30, 13);
    options.kind = kind;
    options.amplitude = {0.3, 7.0};
    const auto make = [&] { return kind == InputKind::optimised ? plan(system, options) : plan(options); };
    const Plan first = make();
    EXPECT_EQ(first.inputs.outputs(), 0);
    EXPECT_EQ(first.inputs.missing(), 0);
    for (Index i = 0; i < 2; ++i) {
      double peak = 0.0;
      for (Index k = 0; k < 30; ++k) peak = std::max(peak, first.inputs.input(k).col(i).cwiseAbs().maxCoeff());
      EXPECT_LE(peak, options.amplitude[size_t(i)]);  // to the last bit
      EXPECT_EQ(peak, first.peak(i));
      EXPECT_GT(first.rms(i), 0.2 * options.amplitude[size_t(i)]);
    }
    EXPECT_TRUE(first.inputs.samples() == make().inputs.samples());
    options.execution.threads = 3;
    EXPECT_TRUE(first.inputs.samples() == make().inputs.samples());
    options.seed = 2;
    EXPECT_FALSE(first.inputs.samples() == make().inputs.samples());
  }
}

TEST(Design, InputsOfAWindowAreIndependent) {
  for (const SystemSize size :
       {SystemSize{1, 1, 1}, {2, 1, 1}, {4, 1, 1}, {4, 2, 2}, {6, 2, 1}, {3, 1, 2}, {6, 3, 2}, {4, 4, 3}, {5, 2, 3}}) {
    SCOPED_TRACE(testing::name(size));
    const Index p = testing::smallest_lag_order(size), minimum = minimum_experiments(size.r, size.m, p);
    for (const Index extra : {Index(0), Index(1), Index(2), minimum, 40 * minimum})
      for (const InputKind kind : model_free) {
        SCOPED_TRACE(to_string(kind));
        PlanOptions options = options_for(size, 40, minimum + extra);
        options.kind = kind;
        const Plan result = plan(options);
        for (Index k = 0; k < 40; ++k) {
          const Vector s = linalg::singular_values(window_columns(result.inputs, k, p));
          EXPECT_NEAR(result.input_condition[size_t(k)] / (s(0) / s(s.size() - 1)), 1, 1e-9);
          // Orthogonal: to rounding of a few products of unit columns. The others: not yet singular; many experiments
          // make them nearly orthogonal.
          if (kind == InputKind::orthogonal) {
            EXPECT_NEAR(result.input_condition[size_t(k)], 1, 1e-12);
          } else if (extra > 2) {
            EXPECT_LT(result.input_condition[size_t(k)], extra > minimum ? 2.5 : 1e3);
          }
        }
      }
  }
}

TEST(Design, OrthogonalInputsOfDeparturesHaveMeanZero) {
  PlanOptions options = oscillator_options(12);
  options.nominal = true;
  const Plan result = plan(options);
  for (Index k = 0; k < 80; ++k)
    EXPECT_LT(result.inputs.input(k).colwise().sum().cwiseAbs().maxCoeff(), 100 * epsilon) << k;
  // A descent may leave the mean, but not the condition without it.
  const Plan better = plan(oscillator(80), options);
  EXPECT_LT(*std::max_element(better.condition.begin(), better.condition.end()), better.start_condition / 2);
  // Those that are none don't look like a mean motion either.
  const Ensemble data = simulate(oscillator(80), plan(oscillator_options(12)).inputs);
  EXPECT_FALSE(test_nominal(data).significant);
}

TEST(Design, PlannedExperimentsIdentifyTheSystem) {
  for (const SystemSize size : {SystemSize{2, 1, 1}, {4, 2, 2}, {6, 3, 2}, {3, 1, 2}}) {
    SCOPED_TRACE(testing::name(size));
    const Model system = testing::random_system(size, 30, 1.0, 5);
    for (const bool with_model : {false, true}) {
      // Two more than the minimum: the orders are stated, and a random system is no worse than 1e6 then.
      const Index p = testing::smallest_lag_order(size);
      PlanOptions options = options_for(size, 30, minimum_experiments(size.r, size.m, p) + 2);
      const Plan result = with_model ? plan(system, options) : plan(options);
      const Ensemble data = simulate(system, result.inputs);
      IdentifyOptions how;
      how.lags = p;
      how.states = size.n;
      how.nominal = NominalChoice::none;
      const Identification identified = identify(data, how);
      const Ensemble fresh = testing::random_experiments(system, 5, 77);
      // Rounding, times the condition of the regressions, times what the recursions add.
      EXPECT_LT(testing::output_error(fresh, simulate(identified.model, fresh)), 1e-8);
    }
  }
}

TEST(Design, ForecastsAgreeWithTheRegression) {
  const Model system = oscillator(80);
  PlanOptions options = oscillator_options(12);
  const Plan result = plan(system, options);
  EXPECT_EQ(result.kind, InputKind::optimised);
  EXPECT_DOUBLE_EQ(*std::max_element(result.condition.begin(), result.condition.end()),
                   worst_condition(system, result.inputs, 2).scaled);
  EXPECT_LT(*std::max_element(result.condition.begin(), result.condition.end()), result.start_condition);
  EXPECT_EQ(result.rank[0], 2);
  EXPECT_EQ(result.rank[79], 10);
  const Ensemble data = simulate(system, result.inputs);
  double peak = 0.0;
  for (Index k = 0; k < 80; ++k) peak = std::max(peak, data.output(k).col(1).cwiseAbs().maxCoeff());
  EXPECT_NEAR(result.output_peak(1), peak, 1e-12 * peak);
}

// Markov parameters up to p steps apart, estimated from noisy experiments on the planned inputs.
TEST(Design, ErrorsUnderNoiseAreAsForecast) {
  const Model system = oscillator(80);
  PlanOptions options = oscillator_options(60);
  options.noise = NoiseLevel{0.02, 0.05};
  for (const InputKind kind : {InputKind::orthogonal, InputKind::optimised}) {
    SCOPED_TRACE(to_string(kind));
    options.kind = kind;
    const Plan result = plan(system, options);
    double error = 0.0, size = 0.0;
    for (std::uint64_t seed = 1; seed <= 5; ++seed) {
      testing::Random random(seed);
      Ensemble acting = result.inputs;
      for (Index k = 0; k < 80; ++k) acting.input(k) += options.noise->input * random.matrix(60, 2);
      Ensemble data = simulate(system, acting);
      for (Index k = 0; k < 80; ++k) {
        data.input(k) = result.inputs.input(k);
        data.output(k) += options.noise->output * random.matrix(60, 2);
      }
      GtvArxOptions how;
      how.lags = {2};
      const GtvArx arx = gtv_arx(data, how);
      for (Index k = 2; k < 80; ++k)
        for (Index i = k - 2; i <= k; ++i) {
          // The answer of the regression to a pulse at step i: inputs 1, outputs as the system gives them.
          Matrix window = Matrix::Zero(10, 2);
          window.middleRows((i - k + 2) * 4, 2).setIdentity();
          for (Index j = i; j < k; ++j)
            window.middleRows((j - k + 2) * 4 + 2, 2) = j == i ? system.D[size_t(i)] : pulse_response(system, j, i);
          const Matrix truth = i == k ? system.D[size_t(k)] : pulse_response(system, k, i);
          error += (arx.step[size_t(k)].coefficients * window - truth).squaredNorm();
          size += truth.squaredNorm();
        }
    }
    // 5 × 78 steps average the scatter down to a few percent; regressors with noise are no Gaussian sample given in
    // advance, and the coefficients of least error are not those of the pulses: a third is left for that.
    EXPECT_NEAR(std::sqrt(error / size) / result.markov_error, 1, 0.33);
    EXPECT_GT(result.noise_floor, 0);
    EXPECT_LT(result.noise_floor, 0.5);
  }
}

TEST(Design, MoreNoiseWantsMoreExperiments) {
  const Model system = oscillator(80);
  PlanOptions options = oscillator_options(0);
  options.kind = InputKind::gaussian;
  options.noise = NoiseLevel{0.0, 0.01};
  EXPECT_EQ(plan(system, options).recommended, 111);
  options.noise = NoiseLevel{0.0, 0.2};
  const Plan result = plan(system, options);
  EXPECT_GT(result.recommended, 200);
  EXPECT_TRUE(mentions(result.reasons, "Markov parameters"));
  // Another draw than the one that the number came from.
  EXPECT_NEAR(result.markov_error, 0.1, 0.02);
}

TEST(Design, WrongCallsSayWhatIsNeeded) {
  const auto contains = [](const std::string& text, const std::string& part) {
    return text.find(part) != std::string::npos ? ::testing::AssertionSuccess() : ::testing::AssertionFailure() << text;
  };
  PlanOptions options = oscillator_options(9);
  EXPECT_TRUE(contains(complaint(options), "experiments: 9 found, at least 10 needed"));
  options.experiments = 10;
  options.nominal = true;
  EXPECT_TRUE(contains(complaint(options), "at least 11 needed"));
  options = oscillator_options();
  options.states = 0;
  EXPECT_TRUE(contains(complaint(options), "states: 0 found"));
  options = oscillator_options();
  options.lags = 1;
  EXPECT_TRUE(contains(complaint(options), "lags: 1 found, at least 2 needed"));
  options = oscillator_options();
  options.steps = 2;
  EXPECT_TRUE(contains(complaint(options), "steps: 2 found, at least 3 needed"));
  options = oscillator_options();
  options.amplitude = {1.0, 2.0, 3.0};
  EXPECT_TRUE(contains(complaint(options), "amplitude: 3 limits found"));
  options.amplitude = {-1.0};
  EXPECT_TRUE(contains(complaint(options), "amplitude: -1 found"));
  options = oscillator_options();
  options.noise = NoiseLevel{-1.0, 0.0};
  EXPECT_TRUE(contains(complaint(options), "noise"));
  options = oscillator_options();
  options.kind = InputKind::optimised;
  EXPECT_TRUE(contains(complaint(options), "preliminary model"));
  options = oscillator_options();
  options.dt = 0.0;
  EXPECT_TRUE(contains(complaint(options), "dt"));

  const Model system = oscillator(40);
  options = oscillator_options();
  EXPECT_TRUE(contains(complaint(options, &system), "steps: 80 found, the model ends after 40"));
  options.steps = 40;
  options.outputs = 1;
  EXPECT_TRUE(contains(complaint(options, &system), "outputs: 1 found, the model has 2"));
  options.outputs = 2;
  const Model unstable = testing::random_system({4, 2, 2}, 3000, 2.0, 1);
  PlanOptions all;
  EXPECT_TRUE(contains(complaint(all, &unstable), "grow beyond all numbers"));
  options.states = 6;
  EXPECT_TRUE(contains(complaint(options, &system), "states: 6 found, the model has 4"));
}

TEST(Design, AModelThatBeginsLaterPlansItsOwnSteps) {
  const Model late = from_step(oscillator(40), 5);
  PlanOptions options;
  options.experiments = 12;
  const Plan result = plan(late, options);
  EXPECT_EQ(result.inputs.steps(), 40);
  EXPECT_EQ(result.first_step, 7);
  EXPECT_TRUE(std::isnan(result.condition[6]));
  EXPECT_GE(result.condition[7], 1);
}

}  // namespace
}  // namespace tokid
