// How close models come to the Kalman filter of the true system, with the number of experiments, and what missing
// samples and unequal lengths cost: the tables of docs/math.md.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

#include "noisy.hpp"
#include "tokid/identify.hpp"

namespace {

using namespace tokid;
using namespace tokid::testing;

constexpr Index steps = 60;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

template <class Value>
double median_of_seeds(int seeds, Value&& value) {
  std::vector<double> values;
  for (int seed = 1; seed <= seeds; ++seed) values.push_back(value(std::uint64_t(seed)));
  std::nth_element(values.begin(), values.begin() + seeds / 2, values.end());
  return values[size_t(seeds / 2)];
}

double ratio(const Ensemble& data, const IdentifyOptions& options, const Model& system, std::uint64_t seed) {
  try {
    return ratio_to_kalman(identify(data, options).model, system, 1000 + seed);
  } catch (const std::invalid_argument&) {
    return nan;  // too few experiments
  }
}

Ensemble thinned(Ensemble e, double share, std::uint64_t seed) {
  Random random(seed);
  const auto drop = [&](double& value) {
    if (random.uniform(0, 1) < share) value = nan;
  };
  for (Index n = 0; n < e.experiments(); ++n)
    for (Index k = 0; k < e.steps(); ++k) {
      for (Index i = 0; i < e.inputs(); ++i) drop(e.u(n, k, i));
      for (Index j = 0; j < e.outputs(); ++j) drop(e.y(n, k, j));
    }
  return e;
}

Ensemble shortened(Ensemble e, std::uint64_t seed) {
  Random random(seed);
  e.length.assign(size_t(e.experiments()), e.steps());
  for (Index n = 0; n < e.experiments(); ++n) {
    const Index length = e.length[size_t(n)] = Index(random.uniform(double(e.steps()) / 2, double(e.steps()) + 1));
    for (Index k = length; k < e.steps(); ++k) {
      e.input(k).row(n).setConstant(nan);
      e.output(k).row(n).setConstant(nan);
    }
  }
  return e;
}

void by_experiments(int seeds, const std::vector<Index>& counts) {
  const Model system = oscillator(steps);
  fmt::print("one-step error over that of the Kalman filter, median of {} seeds\n", seeds);
  fmt::print("{:>5} {:>12} {:>12} {:>12}\n", "N", "automatic", "no refine", "tvera");
  for (const Index count : counts) {
    const auto column = [&](const IdentifyOptions& o) {
      return median_of_seeds(
          seeds, [&](std::uint64_t seed) { return ratio(noisy_experiments(system, count, seed), o, system, seed); });
    };
    fmt::print("{:>5} {:>12.3f} {:>12.3f} {:>12.3f}\n", count, column({}), column({.refine = false}),
               column({.method = Method::tvera}));
    std::fflush(stdout);
  }
}

void by_gaps(int seeds, Index count) {
  const Model system = oscillator(steps);
  fmt::print("N = {}: complete, 10 % of the samples missing, lengths from {} to {}\n", count, steps / 2, steps);
  for (int which = 0; which < 3; ++which) {
    const double value = median_of_seeds(seeds, [&](std::uint64_t seed) {
      Ensemble e = noisy_experiments(system, count, seed);
      if (which == 1) e = thinned(std::move(e), 0.1, seed);
      if (which == 2) e = shortened(std::move(e), seed);
      return ratio(e, {}, system, seed);
    });
    fmt::print("{:.3f}\n", value);
    std::fflush(stdout);
  }
}

}  // namespace

// tokid_noise [SEEDS [experiments|gaps]]
int main(int argc, char** argv) {
  const int seeds = argc > 1 ? std::max(1, std::atoi(argv[1])) : 5;
  const std::string table = argc > 2 ? argv[2] : "";
  if (table != "gaps") by_experiments(seeds, {15, 30, 50, 100, 400});
  if (table != "experiments") by_gaps(seeds, 200);
}
