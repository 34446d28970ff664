// Example systems with known matrices, and ensembles of experiments on them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "tokid/model.hpp"

namespace tokid {

// The paper's example (77), (78): four states, two inputs, two outputs; A_k = exp(A_c(t_k)·dt), t_k = k·dt.
// Off-diagonal stiffness -1; with dt = 0.05 s, step k = 35 here is step k = 36 in the paper.
Model oscillator(Index steps, double dt = 0.05);

// A point mass on a spring in a tube that rotates at the rate θ'(t): x'' = (θ'(t)² - k(t)/m) x + u, with measured
// position. Here θ' = 3 sin(t/2) rad/s and k/m = 4 + 2 sin t s⁻², so that the origin is stable at some times and
// unstable at others. A_k and B_k are the exact discretisation for coefficients and inputs that are constant between
// t_k = k·dt and t_{k+1}.
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

// The same with the given inputs, for example those of a plan: options.experiments is not used. Missing inputs give
// missing outputs from their step on.
// \throws std::invalid_argument where inputs or steps of the ensemble and of the system differ in number
Ensemble experiments(const Model& system, const Ensemble& inputs, const ExperimentOptions& options = {});

// The system with the noise covariances of experiments(system, options), and with the Kalman filter as observer. This
// observer has the smallest prediction errors in these experiments. \throws std::invalid_argument for negative standard
// deviations
Model with_noise(Model system, const ExperimentOptions& options);

// An ensemble with the second moments of infinitely many experiments on the system. The inputs are white with
// covariance I; the noise has Q, R and x0_cov of the system. The sources are each input and noise at each step, and
// each initial state. In each experiment of the ensemble, one source acts and all other sources are zero. Regressions
// on this ensemble therefore give the coefficients and the residual covariances of the limit N → ∞.
// \throws std::invalid_argument where Q or R is missing, one of the three is not a covariance, or the system does not
// begin at step 0
Ensemble expected_moments(const Model& system);

}  // namespace tokid
