// A program of somebody else's: identifies a simulated ensemble in memory and checks the model on fresh experiments.
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <iostream>
#include <tokid/tokid.hpp>
#include <utility>

int main() {
  const tokid::Model system = tokid::oscillator(30);
  const tokid::Ensemble data = tokid::experiments(system, {.experiments = 20, .seed = 1});

  tokid::IdentifyOptions options;
  options.lags = 2;
  options.states = 4;
  tokid::Identification result = tokid::identify(data, options);
  const tokid::Model model = std::move(result.model);

  // The model agrees with the system on inputs it never saw: exactly, but for rounding (the system is of norm 1, and
  // the errors of 30 steps add up).
  const tokid::Ensemble fresh = tokid::experiments(system, {.experiments = 5, .seed = 2});
  const tokid::Ensemble computed = tokid::simulate(model, fresh);
  double difference = 0.0, size = 0.0;
  for (tokid::Index k = model.k_begin; k < model.k_end(); ++k) {
    difference += (fresh.output(k) - computed.output(k)).squaredNorm();
    size += fresh.output(k).squaredNorm();
  }
  const double error = std::sqrt(difference / size);
  std::cout << "tokid " << tokid::version << ": " << model.steps() << " steps, " << model.states()
            << " states, relative error of the outputs " << error << '\n';
  return model.steps() == 30 && model.states() == 4 && error < 1e-9 ? 0 : 1;
}
