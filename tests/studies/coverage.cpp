// How often 95 % intervals hold the truth, with the number of experiments: the tables of docs/evidence.md.
// SPDX-License-Identifier: BSD-3-Clause
#include "studies/coverage.hpp"

#include <fmt/format.h>

#include <cstdlib>

#include "tokid/example.hpp"
#include "tokid/identify.hpp"

namespace {

using namespace tokid;
using namespace tokid::testing;

struct Case {
  const char* name;
  SystemSize size;
  Index lags;
  std::uint64_t seed;
  double noise;
};

// All entries of a Markov band, of the outputs and of the spectrum in one vector, for the bootstrap.
struct Layout {
  const Model& reference;
  const Ensemble& inputs;
  Index band;
  ClosedLoopOptions loop;
  Spectrum spectrum;

  Vector operator()(const Model& model) const {
    std::vector<double> all;
    const auto put = [&](const Matrix& values) {
      for (const double value : values.reshaped()) all.push_back(value);
    };
    for (Index k = 0; k < reference.steps(); ++k) put(pulse_row(model, k, band));
    const Ensemble outputs = simulate(model, inputs);
    for (Index k = 0; k < reference.steps(); ++k) put(outputs.output(k));
    const Spectrum found = closed_loop_spectrum(model, loop);
    for (size_t i = 0; i < spectrum.eigenvalues.size(); ++i) {
      const Index at = spectrum.begin + Index(i) - found.begin;
      const Eigen::VectorXcd values =
          at >= 0 && at < Index(found.eigenvalues.size())
              ? matched(found.eigenvalues[size_t(at)], spectrum.eigenvalues[i])
              : Eigen::VectorXcd::Constant(spectrum.eigenvalues[i].size(), std::numeric_limits<double>::quiet_NaN());
      for (const std::complex<double>& value : values) all.insert(all.end(), {value.real(), value.imag()});
    }
    return Eigen::Map<const Vector>(all.data(), Index(all.size()));
  }
};

void study(const Case& c, double multiple, int runs, Index replicates, double spread) {
  const Index steps = 14, p = c.lags, band = 2 * p + 2;
  const Model system = turning_system(c.size, steps, c.seed);
  const Index L = minimum_experiments(c.size.r, c.size.m, p), N = Index(multiple * double(L));
  const TveraOptions o = blocks(p + 1, std::max(p, c.size.n) + 1, c.size.n);
  ClosedLoopOptions loop;
  loop.reference_step = c.size.n;
  loop.rows = p;
  Random random(1000 + c.seed);
  Ensemble given = innovation_experiments(system, 4, 0.0, random);
  const Ensemble truth = simulate(system, given);
  const Spectrum spectrum = closed_loop_spectrum(system, loop);
  Coverage markov_f, output_f, predicted, loop_f, markov_b, output_b, loop_b;
  for (int run = 0; run < runs; ++run) {
    const Ensemble data = innovation_experiments(system, N, c.noise, random);
    const GtvArx arx = regressions(data, p);
    const MarkovBounds mb = markov_bounds(arx, band);
    for (Index k = 0; k < steps; ++k) markov_f.add(pulse_row(system, k, band), mb.step[size_t(k)]);
    const OutputBounds ob = simulation_bounds(arx, given);
    for (Index k = 0; k < steps; ++k) output_f.add(truth.output(k), ob.step[size_t(k)]);
    const Ensemble fresh = innovation_experiments(system, 4, c.noise, random);
    const OutputBounds pb = prediction_bounds(arx, fresh);
    for (Index k = 0; k < steps; ++k) predicted.add(fresh.output(k), pb.step[size_t(k)]);
    try {
      const Model model = realised(arx, o);
      add_spectrum(spectrum, closed_loop_bounds(arx, model, o, loop), loop_f);
      if (replicates > 0) {
        const Layout layout{system, given, band, loop, closed_loop_spectrum(model, loop)};
        BootstrapOptions bo;
        bo.replicates = replicates;
        bo.spread = spread;
        bo.unknowns = L;
        bo.seed = std::uint64_t(run);
        const Bootstrap b = bootstrap(
            data, [&](const Ensemble& e) { return realised(regressions(e, p), o); }, layout, bo);
        const Vector right = layout(system);
        const Index nm = steps * c.size.m * (band + 1) * c.size.r, no = steps * 4 * c.size.m;
        for (Index i = 0; i < right.size(); ++i)
          (i < nm ? markov_b : i < nm + no ? output_b : loop_b).add(right(i), b.interval.lower(i), b.interval.upper(i));
      }
    } catch (const std::exception& error) {
      fmt::print("{}\n", error.what());
    }
  }
  fmt::print(
      "{:<12} {:5.2f} N={:<4} L={:<3} | {:5.2f} {:5.2f} {:5.2f} {:5.2f} (open {:4.1f} %) | {:5.2f} {:5.2f} {:5.2f}\n",
      c.name, c.noise, N, L, markov_f.percent(), output_f.percent(), predicted.percent(), loop_f.percent(),
      100 * loop_f.unbounded / (loop_f.unbounded + loop_f.judged), markov_b.percent(), output_b.percent(),
      loop_b.percent());
}

// The paper's oscillator with process and measurement noise. No observer of finite memory is exact there: intervals
// hold the limit of infinitely many experiments, and the system itself as far as the bias of that limit permits.
void oscillator_study(Index lags, Index experiments_count, int runs, Index replicates) {
  const Index steps = 60, band = 16;
  ExperimentOptions eo;
  eo.process_noise = 0.1;
  eo.measurement_noise = 0.3;
  eo.experiments = experiments_count;
  const Model system = with_noise(oscillator(steps), eo);
  const GtvArx limit_arx = regressions(expected_moments(system), lags);
  const TveraOptions o = blocks(lags + 1, 48, 4);
  const Model limit = realised(limit_arx, o);
  const MarkovBounds limit_markov = markov_bounds(limit_arx, band);
  ClosedLoopOptions loop;
  loop.reference_step = 30;
  loop.rows = lags;
  const Spectrum spectrum = closed_loop_spectrum(limit, loop), kalman = closed_loop_spectrum(system, loop);
  ExperimentOptions few = eo;
  few.experiments = 4;
  few.seed = 999;
  const Ensemble given = experiments(system, few);
  const Ensemble truth = simulate(system, given);
  const OutputBounds limit_outputs = simulation_bounds(limit_arx, given);
  Coverage markov_boot, markov_boot_true, output_boot, loop_boot, markov_limit, markov_true, output_limit, output_true,
      predicted, loop_limit, loop_true;
  for (int run = 0; run < runs; ++run) {
    eo.seed = std::uint64_t(run) + 1;
    const GtvArx arx = regressions(experiments(system, eo), lags);
    const MarkovBounds mb = markov_bounds(arx, band);
    const OutputBounds ob = simulation_bounds(arx, given), pb = prediction_bounds(arx, given);
    for (Index k = 0; k < steps; ++k) {
      const size_t at = size_t(k);
      markov_limit.add(limit_markov.step[at].estimate, mb.step[at]);
      markov_true.add(pulse_row(system, k, band), mb.step[at]);
      output_limit.add(limit_outputs.step[at].estimate, ob.step[at]);
      output_true.add(truth.output(k), ob.step[at]);
      predicted.add(given.output(k), pb.step[at]);
    }
    const Model model = realised(arx, o);
    const SpectrumBounds sb = closed_loop_bounds(arx, model, o, loop);
    add_spectrum(spectrum, sb, loop_limit);
    add_spectrum(kalman, sb, loop_true);
    if (replicates == 0) continue;
    const Layout layout{system, given, band, loop, closed_loop_spectrum(model, loop)};
    BootstrapOptions bo;
    bo.replicates = replicates;
    bo.seed = eo.seed;
    const Bootstrap b = bootstrap(
        experiments(system, eo), [&](const Ensemble& e) { return realised(regressions(e, lags), o); }, layout, bo);
    const Vector right = layout(limit), real = layout(system);
    const Index nm = steps * 2 * (band + 1) * 2, no = steps * 4 * 2;
    for (Index i = 0; i < right.size(); ++i)
      (i < nm        ? markov_boot
       : i < nm + no ? output_boot
                     : loop_boot)
          .add(right(i), b.interval.lower(i), b.interval.upper(i));
    for (Index i = 0; i < nm; ++i) markov_boot_true.add(real(i), b.interval.lower(i), b.interval.upper(i));
  }
  fmt::print(
      "oscillator p={:<2} N={:<4} | Markov {:5.2f} (true {:5.2f}) outputs {:5.2f} (true {:5.2f}) one-step {:5.2f} "
      "eigenvalues {:5.2f} (Kalman {:5.2f}, open {:4.1f} %) | bootstrap Markov {:5.2f} (true {:5.2f}) outputs {:5.2f} eigenvalues {:5.2f}\n",
      lags, experiments_count, markov_limit.percent(), markov_true.percent(), output_limit.percent(),
      output_true.percent(), predicted.percent(), loop_limit.percent(), loop_true.percent(),
      100 * loop_limit.unbounded / (loop_limit.unbounded + loop_limit.judged), markov_boot.percent(),
      markov_boot_true.percent(), output_boot.percent(), loop_boot.percent());
}

// Steps that share one model, in the whole way from the ensemble on: identify() with all its choices, confidence() by
// the bootstrap. The truth itself, with process and measurement noise.
void pooled_study(const SystemSize& size, Index states, Index experiments_count, int runs, Index replicates) {
  const Index band = 8, steps = 60;
  ExperimentOptions eo;
  eo.process_noise = 0.1;
  eo.measurement_noise = 0.3;
  eo.experiments = experiments_count;
  const Model system = with_noise(constant_system(size, steps, 0.9, 5), eo);
  IdentifyOptions o;
  o.period = 1;
  o.states = states;
  ConfidenceOptions co;
  co.method = BoundsMethod::bootstrap;
  co.replicates = replicates;
  co.band = band;
  Coverage markov, outputs;
  double found = 0.0;
  for (int run = 0; run < runs; ++run) {
    eo.seed = std::uint64_t(run) + 1;
    const Ensemble data = experiments(system, eo);
    const Model model = identify(data, o).model;
    found += double(model.states()) / double(runs);
    const Confidence c = confidence(model, data, co);
    const Ensemble truth = simulate(system, data);
    markov.add(pulse_row(system, steps / 2, band), c.markov.step[size_t(steps / 2)]);
    for (Index k = 0; k < steps; ++k) outputs.add(truth.output(k), c.simulated.step[size_t(k)]);
  }
  fmt::print("one model for all steps, n={} m={} r={} N={:<3} n {} {:.2f} | Markov {:5.2f} outputs {:5.2f}\n", size.n,
             size.m, size.r, experiments_count, states > 0 ? "given" : "found", found, markov.percent(),
             outputs.percent());
}

}  // namespace

int main(int argc, char** argv) {
  const int runs = argc > 1 ? std::atoi(argv[1]) : 100;
  const Index replicates = argc > 2 ? std::atoi(argv[2]) : 100;
  const double spread = argc > 3 ? std::atof(argv[3]) : 0.3;
  for (const SystemSize& size : {SystemSize{2, 1, 1}, SystemSize{3, 2, 2}})
    for (const Index N : {10, 20, 50})
      for (const Index states : {size.n, Index{0}}) pooled_study(size, states, N, runs / 2, replicates);
  for (const Index p : {2, 4, 8})
    for (const Index N : {100, 400, 1600}) oscillator_study(p, N, runs / 4, replicates);
  for (const Case& c : {Case{"n2m1r1p2", {2, 1, 1}, 2, 3, 0.1}, Case{"n4m2r2p2", {4, 2, 2}, 2, 3, 0.1},
                        Case{"n2m1r1p3", {2, 1, 1}, 3, 3, 0.1}, Case{"n4m2r2p2", {4, 2, 2}, 2, 3, 0.5}})
    for (const double multiple : {1.5, 2.0, 3.0, 6.0, 20.0}) study(c, multiple, runs, replicates, spread);
}
