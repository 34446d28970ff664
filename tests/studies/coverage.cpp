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
  Coverage markov, outputs, eigenvalues;
  for (int run = 0; run < runs; ++run) {
    const Ensemble data = innovation_experiments(system, N, c.noise, random);
    try {
      const Layout layout{system, given, band, loop, closed_loop_spectrum(realised(regressions(data, p), o), loop)};
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
        (i < nm ? markov : i < nm + no ? outputs : eigenvalues).add(right(i), b.interval.lower(i), b.interval.upper(i));
    } catch (const std::exception& error) {
      fmt::print("{}\n", error.what());
    }
  }
  fmt::print("{:<12} {:5.2f} N={:<4} L={:<3} | {:5.2f} {:5.2f} {:5.2f}\n", c.name, c.noise, N, L, markov.percent(),
             outputs.percent(), eigenvalues.percent());
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
  const TveraOptions o = blocks(lags + 1, 48, 4);
  const Model limit = realised(regressions(expected_moments(system), lags), o);
  ClosedLoopOptions loop;
  loop.reference_step = 30;
  loop.rows = lags;
  ExperimentOptions few = eo;
  few.experiments = 4;
  few.seed = 999;
  const Ensemble given = experiments(system, few);
  Coverage markov, markov_true, outputs, eigenvalues;
  for (int run = 0; run < runs; ++run) {
    eo.seed = std::uint64_t(run) + 1;
    const Model model = realised(regressions(experiments(system, eo), lags), o);
    const Layout layout{system, given, band, loop, closed_loop_spectrum(model, loop)};
    BootstrapOptions bo;
    bo.replicates = replicates;
    bo.seed = eo.seed;
    const Bootstrap b = bootstrap(
        experiments(system, eo), [&](const Ensemble& e) { return realised(regressions(e, lags), o); }, layout, bo);
    const Vector right = layout(limit), real = layout(system);
    const Index nm = steps * 2 * (band + 1) * 2, no = steps * 4 * 2;
    for (Index i = 0; i < right.size(); ++i)
      (i < nm ? markov : i < nm + no ? outputs : eigenvalues).add(right(i), b.interval.lower(i), b.interval.upper(i));
    for (Index i = 0; i < nm; ++i) markov_true.add(real(i), b.interval.lower(i), b.interval.upper(i));
  }
  fmt::print("oscillator p={:<2} N={:<4} | Markov {:5.2f} (true {:5.2f}) outputs {:5.2f} eigenvalues {:5.2f}\n", lags,
             experiments_count, markov.percent(), markov_true.percent(), outputs.percent(), eigenvalues.percent());
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
