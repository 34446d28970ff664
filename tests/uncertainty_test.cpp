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

// The gradient of eigenvalues against central differences through the whole chain of the estimate: with noise in one
// coefficient alone, the deviations of real and imaginary part are its derivatives times that noise.
TEST(Uncertainty, EigenvalueGradientsAreThoseOfTheWholeChain) {
  for (const SystemSize size : {SystemSize{4, 2, 2}, {2, 1, 1}, {4, 2, 1}}) {
    const Index steps = 16, p = smallest_lag_order(size);
    const Model system = turning_system(size, steps, 3);
    GtvArx exact = regressions(random_experiments(system, 40, 4), p);
    const TveraOptions o = blocks(p + 1, size.n + 1, size.n);
    for (Index k = 0; k < exact.steps(); ++k) {
      exact.residual_cov(k).setZero();
      exact.output_rms(k).setZero();
      exact.step[size_t(k)].freedom = 10;
    }
    Random random(5);
    ClosedLoopOptions options;
    options.reference_step = 6;
    const double noise = 1e-5;  // so small that no eigenvalue comes near another
    double largest = 0.0, worst = 0.0;
    for (int trial = 0; trial < 60; ++trial) {
      const Index s = Index(random.uniform(1, double(steps)));
      GtvArx arx = exact;
      const Index row = Index(random.uniform(0, double(size.m)));
      const Index col = Index(random.uniform(0, double(arx.regressors(s))));
      arx.residual_cov(s)(row, row) = noise * noise;
      arx.step[size_t(s)].rank = 1;
      arx.noise_shape(s) = Vector::Unit(arx.regressors(s), col);
      const SpectrumBounds bounds = closed_loop_bounds(arx, realised(arx, o), o, options);
      const double h = 1e-6;
      const auto spectrum = [&](double change) {
        arx.coefficients(s)(row, col) = exact.coefficients(s)(row, col) + change;
        return closed_loop_spectrum(realised(arx, o), options);
      };
      const Spectrum up = spectrum(h), down = spectrum(-h);
      for (size_t i = 0; i < bounds.step.size(); ++i) {
        const auto& found = bounds.step[i];
        const Eigen::VectorXcd slope =
            (matched(up.eigenvalues[i], found.eigenvalues) - matched(down.eigenvalues[i], found.eigenvalues)) / (2 * h);
        for (Index e = 0; e < size.n; ++e) {
          if (std::abs(found.eigenvalues(e)) < 1e-3) continue;  // those that the deadbeat observer makes zero
          largest = std::max(largest, std::abs(slope(e)));
          worst = std::max({worst, std::abs(std::abs(slope(e).real()) - found.real.deviation(e) / noise),
                            std::abs(std::abs(slope(e).imag()) - found.imaginary.deviation(e) / noise)});
        }
      }
    }
    EXPECT_GT(largest, 0.05) << size.n << size.m << size.r;
    // Differences over 2e-6 of eigenvalues near one lose ten digits of sixteen at most.
    EXPECT_LE(worst, 1e-5 * largest) << size.n << size.m << size.r;
  }
}

// Two of the eigenvalues are not the zeros of a deadbeat observer here, but near each other, and noise moves them past
// each other: hardly any is vouched for, and the zeros of noise-free data, which rounding alone tells apart, are not.
TEST(Uncertainty, NearlyRepeatedEigenvaluesAreFlagged) {
  const SystemSize size{2, 1, 1};
  const Model system = turning_system(size, 14, 3);
  const TveraOptions o = blocks(4, 4, 2);
  ClosedLoopOptions loop;
  loop.reference_step = 2;
  Random random(16);
  const GtvArx arx = regressions(innovation_experiments(system, 14, 0.5, random), 3);
  Index flagged = 0, total = 0;
  for (const SpectrumBounds::Step& step : closed_loop_bounds(arx, realised(arx, o), o, loop).step)
    for (Index e = 0; e < 2; ++e, ++total) {
      flagged += !step.simple(e);
      EXPECT_EQ(step.simple(e), std::isfinite(step.real.upper(e)));
      EXPECT_EQ(step.simple(e), std::isfinite(step.imaginary.lower(e)));
    }
  EXPECT_GT(3 * flagged, total);
}

// Both ways measure the same scatter: where the regressions are the model, standard errors agree to what 400 replicates
// and 200 experiments leave open, 4 % and 5 % for each, on average over all entries much less.
TEST(Uncertainty, BothWaysAgree) {
  const SystemSize size{2, 1, 1};
  const Model system = turning_system(size, 10, 3);
  const TveraOptions o = blocks(3, 3, 2);
  Random random(18);
  const Ensemble data = innovation_experiments(system, 200, 0.1, random);
  const GtvArx arx = regressions(data, 2);
  const MarkovBounds factors = markov_bounds(arx, 5);
  BootstrapOptions options;
  options.replicates = 400;
  options.unknowns = 5;
  const auto parameters = [](const Model& m) {
    Matrix all(6, 10);
    for (Index k = 0; k < 10; ++k) all.col(k) = pulse_row(m, k, 5).transpose();
    return Vector(all.reshaped());
  };
  const Bootstrap found = bootstrap(
      data, [&](const Ensemble& e) { return realised(regressions(e, 2), o); }, parameters, options);
  double sum = 0.0;
  Index count = 0;
  for (Index k = 0; k < 10; ++k)
    for (Index gap = 0; gap <= 5; ++gap) {
      const double from_factors = factors.step[size_t(k)].deviation(0, gap);
      const double by_bootstrap = found.interval.deviation(k * 6 + gap);
      EXPECT_EQ(std::isnan(from_factors), gap > k);
      if (gap > k) continue;
      sum += std::log(by_bootstrap / from_factors);
      ++count;
      EXPECT_NEAR(std::log(by_bootstrap / from_factors), 0.0, 0.3);
    }
  EXPECT_NEAR(sum / double(count), 0.0, 0.05);
}

TEST(Uncertainty, SameBitsForAnyNumberOfThreads) {
  const SystemSize size{4, 2, 2};
  const Model system = turning_system(size, 10, 3);
  Random random(19);
  const Ensemble data = innovation_experiments(system, 30, 0.1, random);
  const TveraOptions o = blocks(3, 5, 4);
  const GtvArx arx = regressions(data, 2);
  const Identifier f = [&](const Ensemble& e) { return realised(regressions(e, 2), o); };
  const Functional functional = [&](const Model& m) { return entries(m, data, 4); };
  std::vector<std::vector<Matrix>> results;
  for (const int threads : {1, 3}) {
    BoundsOptions options;
    options.execution.threads = threads;
    SimulationBoundsOptions simulation;
    simulation.execution.threads = threads;
    BootstrapOptions replicated;
    replicated.replicates = 70;
    replicated.execution.threads = threads;
    ClosedLoopOptions loop;
    loop.execution.threads = threads;
    results.push_back({markov_bounds(arx, 4, options).step[9].upper,
                       simulation_bounds(arx, data, simulation).step[9].upper,
                       prediction_bounds(arx, data, options).step[9].upper,
                       closed_loop_bounds(arx, realised(arx, o), o, loop).step[2].real.upper,
                       bootstrap(data, f, functional, replicated).interval.upper});
  }
  for (size_t i = 0; i < results[0].size(); ++i) {
    const auto known = (results[0][i].array() == results[0][i].array()).eval();
    EXPECT_TRUE(known.any());
    EXPECT_TRUE((known.select(results[0][i].array(), 0) == known.select(results[1][i].array(), 0)).all()) << i;
  }
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

// Experiments of a system in innovations form: x' = A x + B u - G e, y = C x + D u + e. If its observer is deadbeat,
// the errors of the ARX equations are the innovations e, and those of different steps are uncorrelated.
Ensemble with_innovations(const Model& system, Index experiments, double size, std::uint64_t seed) {
  Random random(seed);
  Ensemble data(experiments, system.steps(), system.inputs, system.outputs);
  data.initial_state = InitialState::zero;
  for (Index n = 0; n < experiments; ++n) {
    Vector x = Vector::Zero(system.n(0));
    for (Index k = 0; k < system.steps(); ++k) {
      const Step& step = system.at(k);
      const Vector u = random.matrix(system.inputs, 1), e = size * random.matrix(system.outputs, 1);
      data.input(k).row(n) = u.transpose();
      data.output(k).row(n) = (step.C() * x + step.D() * u + e).transpose();
      x = step.A() * x + step.B() * u - step.G() * e;
    }
  }
  return data;
}

// The limit holds for the stated part of data sets or more, and the RMS of the errors is the expected one.
TEST(Uncertainty, RelativeErrorsHaveTheirProbability) {
  Model system = turning_system({2, 1, 1}, 12, 3);
  set_gains(system, deadbeat_gain(system).G);
  constexpr int trials = 200;
  const Index band = 4;
  int held = 0;
  double squares = 0.0;
  for (int trial = 0; trial < trials; ++trial) {
    const Ensemble data = with_innovations(system, 60, 1e-3, 100 + std::uint64_t(trial));
    const GtvArx arx = regressions(data, 2);
    const MarkovBounds bounds = markov_bounds(arx, band);
    double error = 0.0, size = 0.0;
    for (Index k = bounds.k_begin; k < 12; ++k)
      for (Index lag = 0; lag <= std::min(band, k - bounds.k_begin); ++lag) {
        const double truth = lag == 0 ? system.at(k).D()(0, 0) : pulse_response(system, k, k - lag)(0, 0);
        const double h = bounds.step[size_t(k)].estimate(0, lag);
        error += (h - truth) * (h - truth);
        size += h * h;
      }
    const RelativeError limits = relative_error(bounds);
    const double relative = std::sqrt(error / size);
    held += relative <= limits.limit(0, 0);
    squares += (relative / limits.expected(0, 0)) * (relative / limits.expected(0, 0));
  }
  // Three standard deviations of a proportion of 95 % in 200 trials are 5 %.
  EXPECT_GE(held, int(0.90 * trials));
  // Squares of relative errors have standard deviations of at most √2 times their mean: 10 % for the mean of 200
  // trials, and these are three. The noise is so small that the bias, which grows with its square, does not count.
  EXPECT_NEAR(squares / trials, 1.0, 0.3);
}

TEST(Uncertainty, NoiseFreeDataAreKnownToRounding) {
  const SystemSize size{4, 2, 2};
  const Model system = turning_system(size, 12, 3);
  const Ensemble data = random_experiments(system, 30, 20);
  const MarkovBounds found = markov_bounds(regressions(data, 2), 4);
  for (const Interval& step : found.step)
    // Twenty degrees of freedom, residuals at rounding level of outputs of size ten, windows of condition 1e3.
    EXPECT_LE((step.deviation.array().isNaN().select(0, step.deviation.array())).maxCoeff(), 1e-10);
}

TEST(Uncertainty, NothingIsKnownWithoutDegreesOfFreedom) {
  const SystemSize size{2, 1, 1};
  const Model system = turning_system(size, 8, 3);
  Random random(21);
  const Ensemble data = innovation_experiments(system, 5, 0.1, random);  // as many as unknowns
  const GtvArx arx = regressions(data, 2);
  const Interval last = markov_bounds(arx, 3).step[7];
  EXPECT_TRUE(last.estimate.allFinite());
  EXPECT_EQ(last.upper.minCoeff(), std::numeric_limits<double>::infinity());
  EXPECT_EQ(last.lower.maxCoeff(), -std::numeric_limits<double>::infinity());
  const Interval first = markov_bounds(arx, 3).step[0];  // one unknown alone
  EXPECT_TRUE(std::isfinite(first.upper(0, 0)));
  EXPECT_TRUE(std::isnan(first.upper(0, 1)));
  const OutputBounds outputs = simulation_bounds(arx, data);
  EXPECT_TRUE(std::isinf(outputs.step[7].upper(0, 0)));
}

TEST(Uncertainty, MissingSamplesLeaveOutputsUnknown) {
  const SystemSize size{2, 1, 1};
  const Model system = turning_system(size, 8, 3);
  Random random(22);
  Ensemble data = innovation_experiments(system, 20, 0.1, random);
  const GtvArx arx = regressions(data, 2);
  data.u(3, 4, 0) = std::numeric_limits<double>::quiet_NaN();
  const OutputBounds simulated = simulation_bounds(arx, data), predicted = prediction_bounds(arx, data);
  for (Index k = 0; k < 8; ++k) {
    EXPECT_EQ(std::isnan(simulated.step[size_t(k)].upper(3, 0)), k >= 4) << k;
    EXPECT_EQ(std::isnan(predicted.step[size_t(k)].upper(3, 0)), k >= 4 && k <= 6) << k;
    EXPECT_TRUE(simulated.step[size_t(k)].upper.row(2).allFinite());
  }
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

TEST(Confidence, BothMethodsGiveBoundsOfEverything) {
  const Case c = noisy_oscillator(0.2, NominalChoice::mean);
  for (const BoundsMethod method : {BoundsMethod::factors, BoundsMethod::bootstrap}) {
    ConfidenceOptions options;
    options.method = method;
    options.replicates = 20;
    const Confidence found = confidence(c.found.model, c.data, options);
    EXPECT_EQ(found.experiments, 48);
    EXPECT_EQ(found.markov.band, 6);
    ASSERT_EQ(found.markov.step.size(), 20U);
    ASSERT_EQ(found.simulated.step.size(), 20U);
    EXPECT_EQ(found.simulated.step[5].estimate.rows(), 48);
    EXPECT_EQ(found.predicted.step.empty(), method == BoundsMethod::bootstrap);
    EXPECT_FALSE(found.spectrum.step.empty());
    EXPECT_TRUE(found.findings.empty()) << in_words(found.findings).front();
    // The regressions and the model that approximates them agree within the bounds of both, by and large.
    Coverage agreement;
    for (Index k = 0; k < 20; ++k) agreement.add(pulse_row(c.found.model, k, 6), found.markov.step[size_t(k)]);
    EXPECT_GT(agreement.percent(), 90);
    // Outputs are in the units of the data, the mean motion included.
    const Matrix y = c.data.subset({0}).output(10), estimate = found.simulated.step[10].estimate;
    EXPECT_LT((split(c.data, 0.2).training.output(10) - estimate).norm(), 0.2 * estimate.norm());
  }
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
  EXPECT_EQ(confidence(c.found.model, experiments(oscillator(20), o)).findings.size(), 1U);
  EXPECT_THROW(confidence(c.found.model, experiments(oscillator(21), o)), std::invalid_argument);
  EXPECT_THROW(confidence(oscillator(20), c.data), std::invalid_argument);  // was not identified
  Model unknown = cut(c.found.model, c.found.model.k_begin, c.found.model.k_begin + 1);
  unknown.initial_state = InitialState::unknown;
  const Ensemble one(60, unknown.k_end(), c.data.inputs(), c.data.outputs());
  const auto refusal = message([&] { confidence(unknown, one, {.method = BoundsMethod::factors}); });
  EXPECT_NE(refusal.find("found in the data, more than the lag order"), std::string::npos) << refusal;
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

bool has(const Findings& findings, Finding::Kind kind) {
  return std::any_of(findings.begin(), findings.end(), [&](const Finding& f) { return f.kind == kind; });
}

TEST(Confidence, AModelOfEmGetsFiniteBoundsOfItsOwn) {
  const Case c = refined_case(0.0, 3.0, 1);
  ConfidenceOptions options;
  options.replicates = 20;
  const Confidence found = confidence(c.found.model, c.data, options);
  EXPECT_EQ(found.method, BoundsMethod::bootstrap);
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

// With fewer experiments than unknowns of the states, nothing tells the scatter, and a sentence says so.
TEST(Confidence, TooFewExperimentsLeaveInfiniteBoundsAndAReason) {
  ExperimentOptions o;
  o.experiments = 3;
  o.measurement_noise = 0.3;
  const Ensemble data = experiments(jumping_oscillator(0.0), o);
  const Confidence found = confidence(identify(data, few_choices).model, data);
  EXPECT_EQ(found.method, BoundsMethod::factors);
  EXPECT_TRUE(has(found.findings, Finding::Kind::infinite_bounds));
}

// Half of the experiments are those of another system: the factors take the difference for noise of each sample.
TEST(Confidence, HalvesThatDisagreeAreReported) {
  ExperimentOptions o;
  o.experiments = 60;
  o.process_noise = 0.01;
  o.measurement_noise = 0.03;
  Ensemble data = experiments(oscillator(20), o);
  IdentifyOptions options;
  options.lags = 3;
  options.states = 4;
  options.method = Method::tvera;
  options.nominal = NominalChoice::none;
  EXPECT_TRUE(confidence(identify(data, options).model, data).findings.empty());
  for (Index n = 0; n < 60; n += 2)
    for (Index k = 0; k < 20; ++k) data.output(k).row(n) *= 1.2;
  const Findings found = confidence(identify(data, options).model, data).findings;
  ASSERT_TRUE(has(found, Finding::Kind::bounds_too_narrow));
  EXPECT_LT(found.front().numbers.at("agreement"), 85);
}

TEST(Uncertainty, WrongOptionsAreRefused) {
  const SystemSize size{2, 1, 1};
  const Model system = turning_system(size, 8, 3);
  const Ensemble data = random_experiments(system, 12, 23);
  const GtvArx arx = regressions(data, 2);
  const Model model = realised(arx, blocks(3, 3, 2));
  for (const double level : {0.0, 1.0, -0.5, 1.5, std::numeric_limits<double>::quiet_NaN()}) {
    EXPECT_THROW(markov_bounds(arx, 3, {level, {}}), std::invalid_argument);
    EXPECT_THROW(prediction_bounds(arx, data, {level, {}}), std::invalid_argument);
    EXPECT_THROW(simulation_bounds(arx, data, {level, false, {}}), std::invalid_argument);
    EXPECT_THROW(closed_loop_bounds(arx, model, blocks(3, 3, 2), {level, -1, 0, {}}), std::invalid_argument);
    ConfidenceOptions options;
    options.level = level;
    EXPECT_THROW(confidence(identify(data).model, data, options), std::invalid_argument);
  }
  EXPECT_THROW(markov_bounds(arx, 0), std::invalid_argument);
  const GtvArx lean = gtv_arx(data, {.lags = {2}, .noise_shape = false});
  EXPECT_THROW(markov_bounds(lean, 3), std::invalid_argument);
  EXPECT_THROW(prediction_bounds(lean, data), std::invalid_argument);
  EXPECT_THROW(simulation_bounds(lean, data), std::invalid_argument);
  EXPECT_THROW(closed_loop_bounds(lean, model, blocks(3, 3, 2)), std::invalid_argument);
  EXPECT_THROW(simulation_bounds(arx, Ensemble(3, 8, 2, 1)), std::invalid_argument);
  EXPECT_THROW(simulation_bounds(arx, Ensemble(3, 9, 1, 1)), std::invalid_argument);
  EXPECT_THROW(closed_loop_bounds(arx, turning_system({2, 2, 1}, 8, 3), blocks(3, 3, 2)), std::invalid_argument);
  EXPECT_THROW(closed_loop_bounds(arx, model, blocks(1, 3, 2)), std::invalid_argument);
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
  ConfidenceOptions o;
  o.method = BoundsMethod::bootstrap;
  o.replicates = 20;
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
