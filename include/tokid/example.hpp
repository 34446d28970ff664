// Example systems with known matrices, and ensembles of experiments on them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "tokid/model.hpp"

namespace tokid {

// The paper's example (77), (78): four states, two inputs, two outputs; A_k = exp(A_c(t_k)·dt), t_k = k·dt.
// Off-diagonal stiffness -1; with dt = 0.05 s, k = 35 is the paper's k = 36.
Model oscillator(Index steps, double dt = 0.05);

// A point mass on a spring in a tube that rotates at the rate θ'(t): x'' = (θ'(t)² - k(t)/m) x + u, with measured
// position. Here θ' = 3 sin(t/2) rad/s and k/m = 4 + 2 sin t s⁻², so that the origin is stable at some times and
// unstable at others. A_k and B_k are the exact discretisation with the coefficients held at their values at t_k =
// k·dt, and with the input held.
Model rotating_tube(Index steps, double dt = 0.1);

struct ExperimentOptions {
  Index experiments = 50;
  std::uint64_t seed = 1;
  double process_noise = 0.0;                       // standard deviation, on each state and step
  double measurement_noise = 0.0;                   // standard deviation, on each output and step
  Index free_responses = 0;                         // Nf
  InitialState initial_state = InitialState::zero;  // unknown: independent unit Gaussian states at k = 0
};

// Simulated experiments with unit Gaussian inputs. The same seed gives the same experiments on every machine.
Ensemble experiments(const Model& system, const ExperimentOptions& options = {});

// The system with the noise covariances of those experiments, and with its Kalman filter as observer. No other observer
// predicts experiments(system, options) better. \throws std::invalid_argument for negative standard deviations
Model with_noise(Model system, const ExperimentOptions& options);

// An ensemble with the second moments of infinitely many experiments on the system. The inputs are white with
// covariance I; the noise has Q, R and x0_cov of the system. There is one experiment for each independent source, and
// all other sources are zero in it. Regressions on this ensemble give the coefficients and the residual covariances of
// the limit N → ∞.
// \throws std::invalid_argument where Q or R is missing, one of the three is not a covariance, or the system does not
// begin at step 0
Ensemble expected_moments(const Model& system);

}  // namespace tokid
