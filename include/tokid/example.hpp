// Systems with known answers, and ensembles of experiments on them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "tokid/model.hpp"

namespace tokid {

// The paper's example (77), (78): four states, two inputs, two outputs; A_k = exp(A_c(t_k)·dt), t_k = k·dt.
// Off-diagonal stiffness -1; with dt = 0.05 s, k = 35 is the paper's k = 36.
Model oscillator(Index steps, double dt = 0.05);

// A point mass on a spring in a tube that rotates at θ'(t): x'' = (θ'(t)² - k(t)/m) x + u, position measured. Here
// θ' = 3 sin(t/2) rad/s and k/m = 4 + 2 sin t s⁻², so that the origin is stable at some times and unstable at others.
// A_k and B_k are the exact discretisation with the coefficients frozen at t_k = k·dt and the input held.
Model rotating_tube(Index steps, double dt = 0.1);

struct ExperimentOptions {
  Index experiments = 50;
  std::uint64_t seed = 1;
  double process_noise = 0.0;                       // standard deviation, on each state and step
  double measurement_noise = 0.0;                   // standard deviation, on each output and step
  Index free_responses = 0;                         // Nf
  InitialState initial_state = InitialState::zero;  // unknown: independent unit Gaussian states at k = 0
};

// Simulated experiments with unit Gaussian inputs, the same for the same seed on every machine.
Ensemble experiments(const Model& system, const ExperimentOptions& options = {});

// The system with the covariances of the noise in those experiments and its Kalman filter as observer: no other
// predicts experiments(system, options) better. \throws std::invalid_argument for negative standard deviations
Model with_noise(Model system, const ExperimentOptions& options);

// An ensemble whose second moments are those that infinitely many experiments on the system tend to, with white inputs
// of covariance I and the noise Q, R, x0_cov of the system: one experiment for each independent source, which alone is
// not zero in it. Regressions on it have the coefficients of the limit N → ∞, and its residual covariances.
// \throws std::invalid_argument where Q or R is missing, one of the three is no covariance, or the system does not
// begin at step 0
Ensemble expected_moments(const Model& system);

}  // namespace tokid
