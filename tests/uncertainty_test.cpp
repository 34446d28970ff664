// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/uncertainty.hpp"

#include <gtest/gtest.h>

#include "studies/coverage.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"
#include "tokid/observer.hpp"
#include "tokid/refine_model.hpp"
#include "uncertainty/replicate.hpp"

namespace tokid::testing {
namespace {

TEST(Uncertainty, SameBitsForAnyNumberOfThreads) {
  const SystemSize size{4, 2, 2};
  const Model system = turning_system(size, 10, 3);
  Random random(19);
  const Ensemble data = innovation_experiments(system, 30, 0.1, random);
  const TveraOptions o = blocks(3, 5, 4);
  const Identifier f = [&](const Ensemble& e) { return realised(regressions(e, 2), o); };
  const Functional functional = [&](const Model& m) { return entries(m, data, 4); };
  std::vector<Matrix> results;
  for (const int threads : {1, 3})
    results.push_back(bootstrap(data, f, functional, {.replicates = 70, .execution = {threads, {}}}).interval.upper);
  const auto known = (results[0].array() == results[0].array()).eval();
  EXPECT_TRUE(known.any());
  EXPECT_TRUE((known.select(results[0].array(), 0) == known.select(results[1].array(), 0)).all());
}

TEST(Uncertainty, RelativeErrorsAreThoseOfAllResponses) {
  MarkovBounds bounds{.inputs = 2, .outputs = 1, .band = 1, .k_begin = 0, .step = {}};
  // Blocks of two inputs: h_kk, and h_{k,k-1}, which the first step does not have.
  const auto interval = [](const Matrix& estimate, const Matrix& deviation) {
    return Interval{estimate, deviation, estimate - 2 * deviation, estimate + 2 * deviation};
  };
  bounds.step.push_back(interval(Matrix{{3, 0, nan, nan}}, Matrix{{0.3, 0.1, nan, nan}}));
  bounds.step.push_back(interval(Matrix{{0, 0, 4, 0}}, Matrix{{0, 0.1, 0.4, 0.1}}));
  const RelativeError found = relative_error(bounds);
  // √(0.3² + 0.4²) / √(3² + 4²); rounding of six operations
  EXPECT_NEAR(found.expected(0, 0), 0.1, 6 * epsilon);
  EXPECT_NEAR(found.limit(0, 0), 0.2, 6 * epsilon);
  EXPECT_TRUE(std::isnan(found.expected(0, 1)) && std::isnan(found.limit(0, 1)));
}

TEST(Uncertainty, EigenvaluesFindTheirPlaces) {
  using Complex = std::complex<double>;
  Eigen::VectorXcd reference(3), found(3);
  reference << Complex(0.5, 0.1), Complex(0.5, -0.1), Complex(-0.2, 0);
  found << Complex(-0.25, 0), Complex(0.52, -0.12), Complex(0.48, 0.12);
  const Eigen::VectorXcd placed = matched(found, reference);
  EXPECT_EQ(placed(0), found(2));
  EXPECT_EQ(placed(1), found(1));
  EXPECT_EQ(placed(2), found(0));
  EXPECT_TRUE(std::isnan(matched(found.head(2), reference)(0).real()));
}

// ---- a model and its data in one call ----

struct Case {
  Ensemble data;
  Identification found;
};
Case noisy_oscillator(double hold_out = 0.0, std::optional<NominalChoice> nominal = {}) {
  ExperimentOptions o;
  o.experiments = 60;
  o.process_noise = 0.01;
  o.measurement_noise = 0.03;
  Case c{experiments(oscillator(20), o), {}};
  IdentifyOptions options;
  options.lags = 3;
  options.states = 4;
  options.method = Method::tvera;
  options.hold_out = hold_out;
  options.nominal = nominal;
  c.found = identify(c.data, options);
  return c;
}

bool has(const Findings& findings, Finding::Kind kind) {
  return std::any_of(findings.begin(), findings.end(), [&](const Finding& f) { return f.kind == kind; });
}

TEST(Confidence, GivesBoundsOfEverything) {
  const Case c = noisy_oscillator(0.2, NominalChoice::mean);
  const Confidence found = confidence(c.found.model, c.data, {.replicates = 20});
  EXPECT_EQ(found.experiments, 48);
  EXPECT_EQ(found.markov.band, 6);
  ASSERT_EQ(found.markov.step.size(), 20U);
  ASSERT_EQ(found.simulated.step.size(), 20U);
  EXPECT_EQ(found.simulated.step[5].estimate.rows(), 48);
  EXPECT_FALSE(found.spectrum.step.empty());
  EXPECT_TRUE(found.findings.empty()) << in_words(found.findings).front();
  Coverage truth;
  for (Index k = 0; k < 20; ++k) truth.add(pulse_row(oscillator(20), k, 6), found.markov.step[size_t(k)]);
  EXPECT_GT(truth.percent(), 85);  // 95 % expected; entries of one ensemble are correlated
  // Outputs are in the units of the data, the mean motion included.
  const Matrix estimate = found.simulated.step[10].estimate;
  EXPECT_LT((split(c.data, 0.2).training.output(10) - estimate).norm(), 0.2 * estimate.norm());
}

TEST(Confidence, LevelsAreNested) {
  const Case c = noisy_oscillator();
  ConfidenceOptions narrow, wide;
  narrow.level = 0.5;
  wide.level = 0.999;
  const Interval a = confidence(c.found.model, c.data, narrow).markov.step[12],
                 b = confidence(c.found.model, c.data, wide).markov.step[12];
  EXPECT_EQ(a.estimate, b.estimate);
  EXPECT_EQ(a.deviation, b.deviation);
  // Quantiles of Student's t with 36 to some hundred degrees of freedom: 0.68 and 3.3 to 3.6.
  const Matrix ratio = (b.upper - b.lower).cwiseQuotient(a.upper - a.lower);
  EXPECT_GE(ratio.minCoeff(), 4.8);
  EXPECT_LE(ratio.maxCoeff(), 5.4);
}

TEST(Confidence, OtherDataAreRefusedOrRemarkedOn) {
  const Case c = noisy_oscillator();
  EXPECT_THROW(confidence(c.found.model, c.data.subset({0, 1, 2, 3, 4, 5, 6, 7, 8, 9})), std::invalid_argument);
  ExperimentOptions o;
  o.experiments = 60;
  o.measurement_noise = 0.03;
  o.seed = 2;
  EXPECT_TRUE(has(confidence(c.found.model, experiments(oscillator(20), o), {.replicates = 10}).findings,
                  Finding::Kind::bounds_of_other_data));
  EXPECT_THROW(confidence(c.found.model, experiments(oscillator(21), o)), std::invalid_argument);
  EXPECT_THROW(confidence(oscillator(20), c.data), std::invalid_argument);  // was not identified
  EXPECT_THROW(confidence(c.found.model, Ensemble(60, 20, 1, 2)), std::invalid_argument);
}

// ---- smoothing over time, and EM ----

// Two outputs of an oscillator whose frequency jumps at step 20 of 40, or does not.
Model jumping_oscillator(double change) {
  Model system = constant_system({2, 2, 1}, 40, 0.95, 7);
  for (Index k = 0; k < 40; ++k) {
    const double angle = k < 20 ? 0.4 : 0.4 + change;
    system.at(k).A() << 0.95 * std::cos(angle), -0.95 * std::sin(angle), 0.95 * std::sin(angle), 0.95 * std::cos(angle);
  }
  return system;
}

const IdentifyOptions few_choices{
    .states = 2, .lags = 3, .smoothing = 1.0, .jumps = std::vector<Index>{}, .refine = false};

Case refined_case(double change, double smoothing, std::uint64_t seed) {
  ExperimentOptions o;
  o.experiments = 40;
  o.process_noise = 0.05;
  o.measurement_noise = 0.2;
  o.seed = seed;
  Case c{experiments(jumping_oscillator(change), o), {}};
  c.found = identify(c.data, few_choices);
  RefineModelOptions refinement;
  refinement.smoothing = smoothing;
  c.found.model = refine_model(c.found.model, c.data, refinement).refinement.model;
  return c;
}

TEST(Confidence, AModelOfEmGetsFiniteBoundsOfItsOwn) {
  const Case c = refined_case(0.0, 3.0, 1);
  ConfidenceOptions options;
  options.replicates = 20;
  const Confidence found = confidence(c.found.model, c.data, options);
  EXPECT_EQ(found.replicates, 20);
  EXPECT_EQ(found.smoothing, 3.0);
  EXPECT_TRUE(found.findings.empty()) << in_words(found.findings).front();
  for (Index k = 0; k < 40; ++k) {
    const Interval& step = found.markov.step[size_t(k)];
    const Matrix own = pulse_row(c.found.model, k, found.markov.band);
    for (Index i = 0; i < own.size(); ++i) {
      if (std::isnan(own.reshaped()(i))) continue;
      EXPECT_NEAR(step.estimate.reshaped()(i), own.reshaped()(i), 1e-9);
      EXPECT_TRUE(std::isfinite(step.upper.reshaped()(i) - step.lower.reshaped()(i)));
    }
  }
}

// Replicates that start from the model scatter as identifications of their own do.
TEST(Confidence, ReplicatesOfEmScatterAsWholeIdentifications) {
  const Case c = refined_case(0.2, 0.3, 2);
  RefineModelOptions refinement;
  refinement.smoothing = 0.3;
  const Identifier whole = [&](const Ensemble& e) {
    return refine_model(identify(e, few_choices).model, e, refinement).refinement.model;
  };
  const Functional functional = [](const Model& model) {
    Matrix all(2 * 7, 40);
    for (Index k = 0; k < 40; ++k) all.col(k) = pulse_row(model, k, 6).reshaped();
    return Vector(all.reshaped());
  };
  BootstrapOptions options;
  options.replicates = 40;
  options.unknowns = 3;
  const Vector expected = bootstrap(c.data, whole, functional, options).interval.deviation.col(0);
  const Identifier from_model = uncertainty::identifier(c.found.model, identify_options(c.found.model.provenance), 1.0);
  const Vector found = bootstrap(c.found.model, c.data, from_model, functional, options).interval.deviation.col(0);
  double sum = 0.0, count = 0.0;
  for (Index i = 0; i < expected.size(); ++i) {
    if (!(expected(i) > 0) || !(found(i) > 0)) continue;
    sum += std::log(found(i) / expected(i));
    count += 1;
  }
  ASSERT_GT(count, 400);
  EXPECT_NEAR(std::exp(sum / count), 1.0, 0.1);
}

// A jump that too much smoothing hides: the intervals widen there, and the text says where.
TEST(Confidence, BoundsContainTheBiasOfSmoothing) {
  const Case c = refined_case(0.6, 30.0, 3);
  const Model truth = jumping_oscillator(0.6);
  ConfidenceOptions options;
  options.replicates = 40;
  const Confidence found = confidence(c.found.model, c.data, options);
  Coverage near;
  for (Index k = 15; k < 26; ++k) near.add(pulse_row(truth, k, found.markov.band), found.markov.step[size_t(k)]);
  EXPECT_GE(near.percent(), 90);
  ASSERT_TRUE(has(found.findings, Finding::Kind::bounds_with_bias));
  const Finding& finding = found.findings.back();
  EXPECT_TRUE(std::find(finding.steps.begin(), finding.steps.end(), 20) != finding.steps.end());
  EXPECT_FALSE(std::find(finding.steps.begin(), finding.steps.end(), 3) != finding.steps.end());
  EXPECT_GT(found.bias(20), found.bias(5));
}

TEST(Confidence, AConstantSystemIsAnAssumption) {
  ExperimentOptions o;
  o.experiments = 12;
  o.measurement_noise = 0.3;
  const Ensemble data = experiments(constant_system({2, 2, 1}, 30, 0.9, 7), o);
  IdentifyOptions options = few_choices;
  RefineModelOptions constant;
  constant.smoothing = std::numeric_limits<double>::infinity();
  const Model found = refine_model(identify(data, options).model, data, constant).refinement.model;
  ASSERT_EQ(found.period, 1);
  ConfidenceOptions quick;
  quick.replicates = 10;
  EXPECT_TRUE(has(confidence(found, data, quick).findings, Finding::Kind::bounds_of_constant_system));
  options.smoothing = std::numeric_limits<double>::infinity();  // stated
  EXPECT_FALSE(
      has(confidence(identify(data, options).model, data, quick).findings, Finding::Kind::bounds_of_constant_system));
}

TEST(Uncertainty, WrongOptionsAreRefused) {
  const SystemSize size{2, 1, 1};
  const Model system = turning_system(size, 8, 3);
  const Ensemble data = random_experiments(system, 12, 23);
  for (const double level : {0.0, 1.0, -0.5, 1.5, std::numeric_limits<double>::quiet_NaN()})
    EXPECT_THROW(confidence(identify(data).model, data, {.level = level}), std::invalid_argument);
  // As many experiments as states, inputs and one for the scatter are needed.
  const Ensemble few = data.subset({0, 1, 2});
  EXPECT_THROW(confidence(identify(few, {.states = 2, .lags = 2, .smoothing = 1.0, .refine = false}).model, few),
               std::invalid_argument);
  EXPECT_THROW(weighted(data, Vector::Ones(11)), std::invalid_argument);
  EXPECT_THROW(weighted(data, -Vector::Ones(12)), std::invalid_argument);

  const Identifier f = [&](const Ensemble& e) { return realised(regressions(e, 2), blocks(3, 3, 2)); };
  const Functional functional = [](const Model& m) { return Vector(m.step[3].D().reshaped()); };
  const auto with = [&](auto&& change) {
    BootstrapOptions options;
    options.replicates = 4;
    change(options);
    return bootstrap(data, f, functional, options);
  };
  EXPECT_EQ(with([](BootstrapOptions&) {}).replicates, 4);
  EXPECT_THROW(with([](BootstrapOptions& o) { o.replicates = 1; }), std::invalid_argument);
  EXPECT_THROW(with([](BootstrapOptions& o) { o.level = 1; }), std::invalid_argument);
  EXPECT_THROW(with([](BootstrapOptions& o) { o.spread = 1; }), std::invalid_argument);
  EXPECT_THROW(with([](BootstrapOptions& o) { o.spread = 0; }), std::invalid_argument);
  EXPECT_THROW(with([](BootstrapOptions& o) { o.unknowns = -1; }), std::invalid_argument);
  EXPECT_THROW(with([](BootstrapOptions& o) { o.unknowns = 12; }), std::invalid_argument);
  Index calls = 0;
  const Identifier fails = [&](const Ensemble& e) {
    if (calls++ > 0) throw std::runtime_error("no");
    return f(e);
  };
  EXPECT_THROW(bootstrap(data, fails, functional, {}), std::runtime_error);
}

// The bounds of confidence(), entry by entry: the function lists Markov parameters.
TEST(FunctionBounds, AgreeWithConfidence) {
  const Model system = random_system({2, 1, 1}, 12, 0.9, 140);
  const Ensemble data = with_noise(random_experiments(system, 30, 141), 0.05, 142);
  IdentifyOptions options;
  options.states = 2;
  options.lags = 2;
  options.method = Method::tvera;
  options.smoothing = 0.0;
  const Model model = identify(data, options).model;
  ConfidenceOptions o{.replicates = 20};
  const Confidence whole = confidence(model, data, o);
  const auto last = [](const Model& m) {
    return Vector((Vector(2) << pulse_response(m, 9, 8)(0, 0), pulse_response(m, 9, 7)(0, 0)).finished());
  };
  const FunctionBounds found = function_bounds(model, data, last, o);
  EXPECT_EQ(found.replicates, whole.replicates);
  for (Index gap = 1; gap <= 2; ++gap) {
    const Interval& step = whole.markov.step[9];
    EXPECT_NEAR(found.interval.lower(gap - 1), step.lower(0, gap), 1e-10);
    EXPECT_NEAR(found.interval.upper(gap - 1), step.upper(0, gap), 1e-10);
  }
  EXPECT_EQ(message([&] { function_bounds(model, data, last, o, 3); }),
            "steps: 3 found, a divisor of the 2 entries of the function needed");
  EXPECT_EQ(message([&] {
              function_bounds(
                  model, data, [](const Model&) { return Vector(); }, o);
            }),
            "function: no values found, at least one needed");
  o.level = 1.0;
  EXPECT_EQ(message([&] { function_bounds(model, data, last, o); }), "level: 1 found, 0 < level < 1 needed");
}

}  // namespace
}  // namespace tokid::testing
