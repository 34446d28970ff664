// Quick check of the coverage study: 95 % intervals hold the truth in 93 to 97 % of all entries.
// SPDX-License-Identifier: BSD-3-Clause
#include "studies/coverage.hpp"

#include <gtest/gtest.h>

namespace tokid::testing {
namespace {

// Entries of one ensemble are correlated, so that the scatter of a coverage is not that of its thousands of entries:
// with four other sets of seeds these coverages lay between 94.0 and 97.0 %.

void expect_nominal(const Coverage& coverage, const char* what, double multiple) {
  EXPECT_GT(coverage.judged, 2000) << what;
  EXPECT_GE(coverage.percent(), 93) << what << ", N = " << multiple << " L";
  EXPECT_LE(coverage.percent(), 97) << what << ", N = " << multiple << " L";
}

struct CoverageCase {
  SystemSize size;
  Index lags;
  double multiple;  // experiments over regressors
  InitialState initial;
};

TEST(Coverage, FactorsHoldTheTruthInNinetyFivePercent) {
  constexpr auto zero = InitialState::zero, unknown = InitialState::unknown;
  for (const CoverageCase& c : {CoverageCase{{2, 1, 1}, 2, 2, zero},
                                {{4, 2, 2}, 2, 2, zero},
                                {{4, 2, 2}, 2, 10, zero},
                                {{2, 1, 1}, 3, 3, zero},
                                {{4, 2, 2}, 2, 3, unknown}}) {
    const Index steps = 14, band = 6, runs = 120;
    const Model system = turning_system(c.size, steps, 3);
    const double initial = c.initial == unknown ? 1.0 : 0.0;
    const Index experiments = Index(c.multiple * double(minimum_experiments(c.size.r, c.size.m, c.lags)));
    Random random(11);
    Coverage parameters, outputs, measured, predicted;
    for (Index run = 0; run < runs; ++run) {
      const GtvArx arx =
          regressions(innovation_experiments(system, experiments, 0.1, random, initial), c.lags, c.initial);
      const Model truth = from_step(system, arx.k_begin);
      const MarkovBounds found = markov_bounds(arx, band);
      for (Index k = 0; k < steps; ++k) parameters.add(pulse_row(truth, k, band), found.step[size_t(k)]);

      // Fresh experiments. The mean output is that of experiments whose innovations vanish.
      const Ensemble clean = innovation_experiments(system, 3, 0.0, random, initial);
      const Ensemble noisy = innovation_experiments(system, 3, 0.1, random, initial);
      const OutputBounds mean = simulation_bounds(arx, clean), next = prediction_bounds(arx, noisy);
      SimulationBoundsOptions with_noise;
      with_noise.noise = true;
      const OutputBounds sample = simulation_bounds(arx, noisy, with_noise);
      for (Index k = arx.k_begin; k < steps; ++k) {
        outputs.add(clean.output(k), mean.step[size_t(k)]);
        measured.add(noisy.output(k), sample.step[size_t(k)]);
        predicted.add(noisy.output(k), next.step[size_t(k)]);
      }
    }
    expect_nominal(parameters, "Markov parameters", c.multiple);
    expect_nominal(outputs, "simulated outputs", c.multiple);
    expect_nominal(measured, "measured outputs", c.multiple);
    expect_nominal(predicted, "predictions", c.multiple);
    EXPECT_EQ(parameters.unbounded, 0);
  }
}

// The mean motion of the experiments is estimated too, and enters simulated outputs; with 2 L experiments it is a tenth
// of their variance.
TEST(Coverage, MeanMotionsCostWhatTheyAreWorth) {
  const SystemSize size{2, 1, 1};
  const Index steps = 12, experiments = 12, runs = 200;
  const Model system = turning_system(size, steps, 3);
  Random random(12);
  const Ensemble motion = random_experiments(system, 1, 13);
  Coverage outputs;
  for (Index run = 0; run < runs; ++run) {
    Ensemble data = innovation_experiments(system, experiments, 0.3, random);
    for (Index k = 0; k < steps; ++k) {
      data.input(k).rowwise() += motion.input(k).row(0);
      data.output(k).rowwise() += motion.output(k).row(0);
    }
    const Nominal nominal = nominal_trajectory(data);
    const GtvArx arx = regressions(departures(data, nominal), 2, InitialState::zero, 1);
    // As departures from the estimated motion, the true one included.
    const Ensemble truth = departures(random_experiments(system, 3, 14 + std::uint64_t(run)), nominal);
    const OutputBounds bounds = simulation_bounds(arx, truth);
    for (Index k = 0; k < steps; ++k) outputs.add(truth.output(k), bounds.step[size_t(k)]);
  }
  expect_nominal(outputs, "simulated outputs", 2.4);
}

TEST(Coverage, EigenvaluesHoldTheTruthInNinetyFivePercent) {
  for (const auto& [size, multiple] : {std::pair{SystemSize{2, 1, 1}, 3.0}, std::pair{SystemSize{4, 2, 2}, 6.0}}) {
    const Index steps = 14, p = smallest_lag_order(size);
    const Model system = turning_system(size, steps, 3);
    const Index experiments = Index(multiple * double(minimum_experiments(size.r, size.m, p)));
    const TveraOptions o = blocks(p + 1, size.n + 1, size.n);
    ClosedLoopOptions loop;
    loop.reference_step = size.n;
    loop.rows = p;
    const Spectrum truth = closed_loop_spectrum(system, loop);
    Random random(15);
    Coverage coverage;
    Index zeros = 0, steps_judged = 0;
    for (Index run = 0; run < 250; ++run) {
      const GtvArx arx = regressions(innovation_experiments(system, experiments, 0.1, random), p);
      const SpectrumBounds found = closed_loop_bounds(arx, realised(arx, o), o, loop);
      add_spectrum(truth, found, coverage);
      steps_judged += Index(found.step.size());
      for (const SpectrumBounds::Step& step : found.step)
        for (Index e = 0; e < size.n; ++e) zeros += step.simple(e) && step.real.upper(e) - step.real.lower(e) < 1e-6;
    }
    expect_nominal(coverage, "eigenvalues", multiple);
    // The m zeros of every deadbeat observer of p m = n are known to be zero, at each of the steps.
    EXPECT_EQ(zeros, steps_judged * size.m);
  }
}

TEST(Coverage, BootstrapHoldsTheTruthInNinetyFivePercent) {
  const SystemSize size{2, 1, 1};
  const Index steps = 10, p = 2, band = 5;
  const Model system = turning_system(size, steps, 3);
  const TveraOptions o = blocks(p + 1, 3, 2);
  const Identifier f = [&](const Ensemble& e) { return realised(regressions(e, p), o); };
  ClosedLoopOptions loop;
  loop.reference_step = 2;
  loop.rows = p;
  const Spectrum right = closed_loop_spectrum(system, loop);
  constexpr Index first = 2, count = 6;  // steps whose states are in the frame of every model
  for (const double multiple : {2.0, 8.0}) {
    const Index L = minimum_experiments(1, 1, p), experiments = Index(multiple * double(L));
    Random random(17);
    Coverage coverage, eigenvalues;
    for (Index run = 0; run < 150; ++run) {
      const Ensemble data = innovation_experiments(system, experiments, 0.1, random);
      const Ensemble given = innovation_experiments(system, 2, 0.0, random);
      // The larger of the two eigenvalues of every step; the other one is a zero of the deadbeat observer.
      const auto moving = [&](const Spectrum& s, Index i) {
        const Eigen::VectorXcd& e = s.eigenvalues[size_t(first + i - s.begin)];
        return (std::abs(e(0)) > std::abs(e(1)) ? e(0) : e(1)).real();
      };
      const Functional functional = [&](const Model& m) {
        const Vector others = entries(m, given, band);
        const Spectrum s = closed_loop_spectrum(m, loop);
        Vector all(others.size() + count);
        all.head(others.size()) = others;
        for (Index i = 0; i < count; ++i) all(others.size() + i) = moving(s, i);
        return all;
      };
      BootstrapOptions options;
      options.replicates = 60;
      options.unknowns = L;
      options.seed = std::uint64_t(run);
      const Bootstrap found = bootstrap(data, f, functional, options);
      EXPECT_EQ(found.replicates, 60);
      const Vector truth = entries(system, given, band);
      for (Index i = 0; i < truth.size(); ++i) coverage.add(truth(i), found.interval.lower(i), found.interval.upper(i));
      for (Index i = 0; i < count; ++i)
        eigenvalues.add(moving(right, i), found.interval.lower(truth.size() + i),
                        found.interval.upper(truth.size() + i));
    }
    expect_nominal(coverage, "parameters and outputs", multiple);
    EXPECT_GE(eigenvalues.percent(), 93) << multiple;
    EXPECT_LE(eigenvalues.percent(), 97) << multiple;
  }
}

}  // namespace
}  // namespace tokid::testing
