// Noisy experiments on a system, and how close a model comes to the best predictor of them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "testing.hpp"
#include "tokid/example.hpp"

namespace tokid::testing {

inline constexpr double process_noise = 0.1, measurement_noise = 0.3;

inline Ensemble noisy_experiments(const Model& system, Index count, std::uint64_t seed,
                                  InitialState initial = InitialState::zero) {
  return experiments(system, {.experiments = count,
                              .seed = seed,
                              .process_noise = process_noise,
                              .measurement_noise = measurement_noise,
                              .initial_state = initial});
}

// Root mean square of the one-step prediction errors over the steps begin … end-1.
inline double one_step_error(const Model& model, const Ensemble& data, Index begin, Index end) {
  const Prediction prediction = predict(model, data);
  double sum = 0.0;
  Index count = 0;
  for (Index k = begin; k < end; ++k) {
    sum += prediction.innovations[size_t(k)].squaredNorm();
    count += prediction.innovations[size_t(k)].size();
  }
  return std::sqrt(sum / double(count));
}

// RMS one-step error on fresh data over that of the Kalman filter of the true system, steps 10 to T-11: 1 is the best
// that any model can do.
inline double ratio_to_kalman(const Model& model, const Model& system, std::uint64_t seed) {
  const Ensemble fresh = noisy_experiments(system, 500, seed);
  const Model best = with_noise(system, {.process_noise = process_noise, .measurement_noise = measurement_noise});
  const Index end = system.steps() - 10;
  return one_step_error(model, fresh, 10, end) / one_step_error(best, fresh, 10, end);
}

// Matrices that go on with a period.
inline Model periodic_system(const SystemSize& size, Index steps, Index period, double growth, std::uint64_t seed) {
  Model model = random_system(size, steps, growth, seed);
  for (size_t k = size_t(period); k < model.step.size(); ++k) model.step[k] = model.step[k - size_t(period)];
  return model;
}

}  // namespace tokid::testing
