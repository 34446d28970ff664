// From arrays to a model: fill an ensemble, identify, simulate experiments that the model never saw.
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <cstdio>
#include <random>
#include <tokid/tokid.hpp>

// A pendulum whose string is pulled in and let out: two states, one input, one output, at rest at first.
tokid::Ensemble measure(tokid::Index experiments, unsigned seed) {
  const double dt = 0.1;
  tokid::Ensemble data(experiments, 60, 1, 1, dt);  // N, T, r, m
  data.initial_state = tokid::InitialState::zero;
  std::mt19937 random(seed);
  std::normal_distribution<double> normal;
  for (tokid::Index n = 0; n < data.experiments(); ++n) {
    double angle = 0, rate = 0;
    for (tokid::Index k = 0; k < data.steps(); ++k) {
      data.u(n, k, 0) = normal(random);
      data.y(n, k, 0) = angle + 0.002 * normal(random);
      const double length = 1 + 0.5 * std::sin(0.3 * double(k) * dt * 2 * 3.14159);
      rate += dt * (-9.81 / length * angle - 0.2 * rate + data.u(n, k, 0));
      angle += dt * rate;
    }
  }
  return data;
}

int main() {
  const tokid::Identification result = tokid::identify(measure(200, 1));
  const tokid::Ensemble fresh = measure(20, 2), simulated = tokid::simulate(result.model, fresh);
  for (const std::string& warning : tokid::in_words(result.findings)) std::printf("warning: %s\n", warning.c_str());
  std::printf("%td states, lag order %td, fit of the simulation %.2f %%\n", result.model.states(), result.plan.lags,
              tokid::fit(fresh, simulated).fit(0));
  return tokid::fit(fresh, simulated).fit(0) > 90 ? 0 : 1;
}
