// How close models come to the Kalman filter of the true system, with the number of experiments; what missing samples
// and unequal lengths cost; how close they come where the matrices jump: the tables of docs/evidence.md.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <unsupported/Eigen/MatrixFunctions>

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

// The oscillator, (77) and (78), whose stiffness, damping and inputs are others from step `jump` on.
Model oscillator_with_jump(Index all_steps, Index jump) {
  Model system = oscillator(all_steps);
  for (Index k = jump; k < all_steps; ++k) {
    const double t = system.dt * double(k);
    Matrix continuous = Matrix::Zero(4, 4);
    continuous.topRightCorner(2, 2).setIdentity();
    continuous.bottomLeftCorner(2, 2) << 4 + 3 * std::sin(10 * t), -1, -1, 7 + 3 * std::cos(10 * t);
    continuous.bottomLeftCorner(2, 2) *= -2.2;
    continuous.bottomRightCorner(2, 2) = -0.8 * Matrix::Identity(2, 2);
    system.at(k).A() = Matrix(continuous * system.dt).exp();
    system.at(k).B() *= 0.5;
  }
  return system;
}

// The error near the jump is the largest of a single step.
void by_jumps(int seeds, const std::vector<Index>& counts) {
  constexpr Index all_steps = 80, jump = 40, around = 5;
  const Model system = oscillator_with_jump(all_steps, jump), smooth = oscillator(all_steps);
  const Model best = with_noise(system, {.process_noise = process_noise, .measurement_noise = measurement_noise});
  fmt::print("a jump at step {}: one-step error over that of the Kalman filter, median of {} seeds\n", jump, seeds);
  fmt::print("{:>5} {:>8} {:>9} {:>9} {:>9} {:>9} {:>9} {:>8}\n", "N", "no jump", "automatic", "largest", "at jump",
             "stated", "at jump", "found");
  for (const Index count : counts) {
    int found = 0;
    double largest = 0.0;
    const auto at_jump = [&](const Model& model, std::uint64_t seed) {
      const Ensemble fresh = noisy_experiments(system, 500, 1000 + seed);
      double worst = 0.0;
      for (Index k = jump - around; k <= jump + around; ++k)
        worst = std::max(worst, one_step_error(model, fresh, k, k + 1) / one_step_error(best, fresh, k, k + 1));
      return worst;
    };
    std::vector<std::vector<double>> columns(5);
    for (std::uint64_t seed = 1; seed <= std::uint64_t(seeds); ++seed) {
      const Ensemble data = noisy_experiments(system, count, seed);
      columns[0].push_back(ratio(noisy_experiments(smooth, count, seed), {}, smooth, seed));
      const Identification automatic = identify(data), stated = identify(data, {.jumps = std::vector<Index>{jump}});
      columns[1].push_back(ratio_to_kalman(automatic.model, system, 1000 + seed));
      largest = std::max(largest, columns[1].back());
      columns[2].push_back(at_jump(automatic.model, seed));
      columns[3].push_back(ratio_to_kalman(stated.model, system, 1000 + seed));
      columns[4].push_back(at_jump(stated.model, seed));
      const std::vector<Jump>& jumps = automatic.refinement.jumps;
      const auto near = [&](const Jump& j) { return std::abs(j.step - jump) <= 1; };
      found += !jumps.empty() && std::all_of(jumps.begin(), jumps.end(), near);
    }
    for (std::vector<double>& column : columns)
      std::nth_element(column.begin(), column.begin() + seeds / 2, column.end());
    const auto median = [&](size_t i) { return columns[i][size_t(seeds / 2)]; };
    fmt::print("{:>5} {:>8.3f} {:>9.3f} {:>9.3f} {:>9.3f} {:>9.3f} {:>9.3f} {:>8}\n", count, median(0), median(1),
               largest, median(2), median(3), median(4), fmt::format("{} of {}", found, seeds));
    std::fflush(stdout);
  }
}

}  // namespace

// tokid_noise [SEEDS [experiments|gaps|jumps]]
int main(int argc, char** argv) {
  const int seeds = argc > 1 ? std::max(1, std::atoi(argv[1])) : 5;
  const std::string table = argc > 2 ? argv[2] : "";
  const auto asked = [&](const char* name) { return table.empty() || table == name; };
  if (asked("experiments")) by_experiments(seeds, {15, 30, 50, 100, 400});
  if (asked("gaps")) by_gaps(seeds, 200);
  if (asked("jumps")) by_jumps(seeds, {30, 100});
}
