// Control of the departures from the nominal trajectory: finite-horizon time-varying LQR and LQG, their expected cost,
// and the closed loop.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// The cost of the steps k = begin … end-1 (S of them), with departures from the nominal trajectory or from a reference:
//   J = Σ_k  δy_kᵀ Q_k δy_k + δu_kᵀ R_k δu_k + (δu_k - δu_{k-1})ᵀ S_k (δu_k - δu_{k-1}),   δy_k = C_k δx_k + D_k δu_k
// States are weighted only through outputs, because their coordinates are arbitrary.
struct CostWeights {
  std::vector<Matrix> output = {};      // Q (m × m): one for all steps, or one for each step
  std::vector<Matrix> input = {};       // R (r × r), likewise; empty: zero
  std::vector<Matrix> input_rate = {};  // S (r × r), likewise; empty: zero. δu is zero before the first step
  Matrix terminal = {};                 // (m × m) added to Q at the last step; empty: zero
};

// The expectation of J, part by part.
struct ExpectedCost {
  double outputs = 0.0, inputs = 0.0, input_rates = 0.0;  // with δy_k = C_k δx_k + D_k δu_k of the true system
  // What the noise that enters the outputs at the same step adds to the weighted outputs, tr(Q_k R_k), or
  // tr(Q_k S_k) in innovations form. No controller changes it.
  double measurement_noise = 0.0;
  // true: the model knows neither the initial state nor its distribution, and the observer is presumed to begin with
  // zero. Before it has estimated the state from some samples, the inputs of the real loop are nominal.
  bool presumes_zero_state = false;
  double total() const { return outputs + inputs + input_rates; }  // without measurement_noise
};

// A linear law of control for the steps begin … end-1:
//   u_k = ū_k + v_k - K_k x̂_k - L_k (u_{k-1} - ū_{k-1}),   ū_k: nominal input
// It uses the state x̂_k that an observer predicts from the outputs up to step k-1. The gains belong to the coordinates
// of the model: other functions refuse a controller with another model.
struct Controller {
  Index begin = 0;                  // first step
  Index outputs = 0;                // m of the model
  double dt = 1.0;                  // [s] of the model
  std::uint64_t system = 0;         // digest of A_k, B_k, C_k, D_k of the model at these steps
  Channels names;                   // of the model
  std::vector<Matrix> K;            // (S) r × n_k
  std::vector<Matrix> L;            // (S) r × r; empty without input-rate weights
  Matrix feedforward;               // (S × r) v_k; empty without a reference
  Matrix u_nominal, y_nominal;      // (S × r), (S × m): nominal trajectory of the model at these steps
  Matrix y_reference, u_reference;  // (S × m), (S × r) as stated; empty: zero
  CostWeights weights;              // as stated
  // For the reader of a file: the name of the model, and the expected cost with its observer and noise. Empty: not
  // stated. lqr() leaves both empty.
  std::string model_name = {};
  std::optional<ExpectedCost> predicted = {};

  Index steps() const { return Index(K.size()); }
  Index end() const { return begin + steps(); }

  // u_k (r) from x̂_k (n_k) and the last input u_{k-1} (r). Without input-rate weights, u_{k-1} does not matter. Before
  // the first step of the controller, inputs count as nominal.
  // \throws std::invalid_argument for another step or a wrong size
  Vector input(Index k, const Eigen::Ref<const Vector>& x, const Eigen::Ref<const Vector>& u_last) const;

  // \throws std::invalid_argument if the parts do not fit each other
  void check() const;
  // \throws std::invalid_argument if the controller was not designed from this model, or has a number that is not
  // finite
  void check(const Model& model) const;
};

// The cost of a controller, with the state known. V_k(z) = zᵀ P_k z - 2 p_kᵀ z + c_k is the smallest cost of the steps
// k … end-1 from z_k = δx_k, or from z_k = [δx_k; δu_{k-1}] with input-rate weights.
struct CostToGo {
  std::vector<Matrix> P;  // (S+1) symmetric, positive semidefinite
  std::vector<Vector> p;  // (S+1); empty without a reference
  Vector c;               // (S+1)
};

struct ControlOptions {
  Index begin = -1;  // -1: first step of the model
  Index end = -1;    // -1: end of the model; a periodic model goes on, also beyond it
  // Departures from the nominal trajectory that outputs (S × m) and inputs (S × r) shall have; empty: zero. The weights
  // then count for the departures from these references.
  Matrix y_reference = {}, u_reference = {};
};

struct Lqr {
  Controller controller;
  CostToGo cost_to_go;
};

// The finite-horizon LQR of a model, by a backward recursion of square roots: each step is one QR factorisation, so
// that P_k is a sum of squares. With the observer of the model it is the LQG controller, by the separation principle,
// if the gains G are those of the Kalman filter: after EM, or by kalman_observer(). Other gains make the loop costlier.
// \throws std::invalid_argument for weights of a wrong number or shape or that are no covariance, if R + S is singular
// at a step, or for steps outside the model; the message names the argument
Lqr lqr(const Model& model, const CostWeights& weights, const ControlOptions& options = {});

// The exact expected cost if the controller uses the observer (9) of `model`, and the outputs are those of `truth`.
// With truth = model, it is the cost that LQG predicts. The state of the observer is zero or x0_mean at the first step
// of its model. Before the first step of the controller, inputs are those of the nominal trajectory of the model. The
// noise is that of `truth`: Q and R, or else innovation_cov with the observer gain (innovations form), or none; its
// initial states have x0_mean and x0_cov if they are unknown and both are stated, else they are zero. \throws
// std::invalid_argument if numbers of channels disagree, if `model` is not the model of the controller, if `truth`
// begins after `model`, or if one of them does not have all steps of the controller
ExpectedCost expected_cost(const Controller& controller, const Model& model, const Model& truth);

// expected_cost() with truth = model: the cost that LQG predicts. Empty if the model has no noise. \throws as
// expected_cost()
std::optional<ExpectedCost> predicted_cost(const Controller& controller, const Model& model);

struct ClosedLoopSimulation {
  Ensemble data;  // inputs and measured outputs of the experiments, steps 0 … end-1; NaN before the system begins
  Vector cost;    // (N) J of each experiment, with δy_k without measurement noise as in ExpectedCost::total()
};

struct SimulateControlOptions {
  Index experiments = 1;  // N
  std::uint64_t seed = 1;
  bool noise = true;              // false: no noise, and initial states of x0_mean or zero
  Vector u_min = {}, u_max = {};  // (r) limits of the inputs; empty: none
  Matrix x0 = {};                 // (n × N) initial states of the true system; empty: as expected_cost()
};

// Simulates the closed loop with the observer of `model` step by step, as OnlineObserver runs it. While the observer
// does not know its state, inputs are those of the nominal trajectory. \throws as expected_cost(), for limits or x0 of
// a wrong shape or that are not finite, and for a lower limit above the upper one
ClosedLoopSimulation simulate_control(const Controller& controller, const Model& model, const Model& truth,
                                      const SimulateControlOptions& options = {});

}  // namespace tokid
