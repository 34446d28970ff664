// The model sequence A_k, B_k, C_k, D_k, G_k: simulation, prediction, pulse responses, coordinates.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"
#include "tokid/step.hpp"

namespace tokid {

struct Model {
  Index inputs = 0, outputs = 0;  // r, m
  Index k_begin = 0;              // first step with a model
  double dt = 1.0;                // sample time [s]
  std::vector<Step> step;         // (S) the first is that of k_begin; n_{k+1} of each is n_k of the next

  // P: the matrices of the steps k and k+P are the same, and go on so behind the last step; 1: time-invariant; 0: the
  // model ends with its last step.
  Index period = 0;

  std::string frame = "raw";  // raw, reference, smooth
  std::string method;         // tvera, subspace, known
  InitialState initial_state = InitialState::zero;
  Channels names;

  // The nominal trajectory that was removed before identification, T × r and T × m; empty where none was.
  Matrix u_nominal, y_nominal;

  // Of unknown states at k_begin, where estimated or known.
  Vector x0_mean;  // (n_0)
  Matrix x0_cov;   // (n_0 × n_0)

  std::string options;  // the options of the identification, as JSON text
  std::string version;  // of the program that made the model

  Index steps() const { return static_cast<Index>(step.size()); }  // S
  Index k_end() const { return k_begin + steps(); }
  Index states() const;      // largest n_k
  Index full_begin() const;  // first k with the largest n_k
  Index full_end() const;    // one past the last k with the largest n_k, counting from full_begin() without a gap
  size_t index(Index k) const { return static_cast<size_t>(k - k_begin); }
  const Step& at(Index k) const { return step[index(k)]; }  // k_begin ≤ k < k_end
  Step& at(Index k) { return step[index(k)]; }
  Index n(Index k) const;  // n_k, k_begin ≤ k ≤ k_end; 0 without any step
  Index max_lags() const;  // largest p_k, at least 1

  // Do the steps know this? After check() all of them do, or none.
  bool has(bool (Step::*part)() const) const { return !step.empty() && (step.front().*part)(); }

  // \throws std::invalid_argument that names what disagrees with the rest in number or shape, or is not finite
  void check() const;
};

// \throws std::overflow_error for a model with infinite entries, or entries that are no numbers
void check_finite(const Model& model);

// Outputs y_k (N × m each) on the time grid of the inputs, as an ensemble; NaN where the model has no step.
// x0 (n × N) holds the state of every experiment at k_begin; default zero, or x0_mean where has_initial_estimate() for
// what the inputs say, or else the model. The nominal trajectory is added back. A missing input leaves the outputs of
// its experiment unknown from there on. \throws std::invalid_argument for a wrong
// number of inputs or a wrong shape of x0
Ensemble simulate(const Model& model, const Ensemble& inputs, const Matrix& x0 = {});

// Steps of the data after the last one of the model, where nothing is computed.
Findings findings_of_end(const Model& model, const Ensemble& data);

// Differences in sample time and names that are no error, but may be a mistake.
Findings differences(const Model& model, const Ensemble& data);

// Unknowns of each output in the regression of step k, whose rank and condition the model holds: the coefficients of
// the window with TVERA, else those of states and inputs; 0 where the model does not come from regressions.
Index unknowns(const Model& model, Index k);

// Is the state at the first step of the model known to be zero? A model that begins later than the experiments can't
// know.
bool starts_from_zero(const Model& model, InitialState initial);

// Does the model know the mean and the covariance of unknown states at its first step? Those of the experiments that it
// was identified from.
bool has_initial_estimate(const Model& model, InitialState initial);

// Steps whose samples tell a state: the largest lag order, and at least ⌈n/m⌉.
Index estimation_window(const Model& model);

struct PredictOptions {
  Index horizon = 1;  // H: ŷ_k from the outputs up to k-H and the inputs up to k
  // Empty: as the data say, or, where they don't, as the model was identified.
  std::optional<InitialState> initial_state = {};
  // Unknown initial states are distributed as x0_mean and x0_cov have it, where the model has them; false: they come
  // from elsewhere, and must be estimated.
  bool initial_estimate = true;
};

// \throws std::invalid_argument unless some step of the data lies H steps after another; H = 1 is always allowed
void check_horizon(Index horizon, Index steps);

struct Prediction {
  Ensemble y;                       // u as given, y predicted; NaN where there is no prediction
  std::vector<Matrix> innovations;  // (T) of (N × m): y_k - ŷ_{k|k-1}; NaN where either is missing
};

// The observer in the loop, x̂_{k+1} = A_k x̂_k + B_k u_k - G_k (y_k - ŷ_k) (9), from zero or from x0_mean on. Where
// the state is not known, at the start with unknown initial states of which the model has no estimate and after a
// missing input, it is estimated from the samples that follow; predictions are NaN until estimation_window(model) of
// them, or as many more as it takes, tell all of the state. Missing innovations are what the others say of them by
// innovation_cov, or zero. Where samples are missing and the model has Q, R and a start, the Kalman filter of the
// samples that are there takes the place of the observer; a missing input then counts as a random one of its channel's
// mean square. \throws std::invalid_argument for wrong channel numbers, and as check_horizon
Prediction predict(const Model& model, const Ensemble& data, const PredictOptions& options = {});

// States (n × N) at step k of the experiments, by least squares over the samples k … k+window-1 through the observer:
// the innovations, whitened by their covariance, depend linearly on x_k. A column is NaN where a sample is missing that
// it needs. \throws std::invalid_argument where k or window leave the model
Matrix estimate_state(const Model& model, const Ensemble& data, Index k, Index window);

// Outputs for the inputs of the data alone, from the known initial state or, where that
// is unknown, from the one that the first samples tell; NaN where there is none.
Ensemble simulate_data(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state = {});

// h_{k,i} (m × r), k > i (7); h°_{k,i} (m × m) (30). \throws std::invalid_argument for steps outside the model
Matrix pulse_response(const Model& model, Index k, Index i);
Matrix gain_pulse_response(const Model& model, Index k, Index i);

// All of the first kind with 1 ≤ γ ≤ band: (S) of (m × band·r), block γ-1 of step k is h_{k,k-γ}, and NaN where the
// model has no step k-γ. \throws std::invalid_argument for band < 1
std::vector<Matrix> pulse_responses(const Model& model, Index band);

// [C_k; C_{k+1} A_k; …], of fewer block rows at the model's end: (rows·m × n_k). \throws as from_step, and for rows < 0
Matrix observability(const Model& model, Index k, Index rows);

// Has a periodic model fewer steps than data of so many need?
bool ends_early(const Model& model, Index steps);
// A periodic model with steps up to `end` at least; any other is returned as it is. Its nominal trajectory goes on with
// the same period.
Model continued(Model model, Index end);

// The model from step k on, with everything that belongs to those steps; without any step at k = k_end. \throws
// std::invalid_argument for k outside it
Model from_step(Model model, Index k);

// x'_k = S_k x_k with S (S+1 matrices n_k × n_k), which changes no output. \throws std::invalid_argument for a wrong
// shape or a singular matrix
Model transform(const Model& model, const std::vector<Matrix>& S);

// The paper's figures: x'_k = P O_k x_k with P = O_s⁺ and the given number of block rows. Steps whose state dimension
// differs from n_s, or from which fewer block rows follow, keep their own coordinates; `begin`, `end` tell which did
// not.
struct FramedModel {
  Model model;
  Index begin = 0, end = 0;  // steps k whose state is in the frame: begin ≤ k < end
};
// \throws std::invalid_argument where step s has no state or too few block rows
FramedModel reference_frame(const Model& model, Index s, Index rows);

// The model in the coordinates of another model of the same system: x'_k = O_k(reference)⁺ O_k x_k with the given
// number of block rows, so that A'_k, B'_k, C'_k, G'_k can be compared with those of the reference one by one. `begin`
// and `end` as above. \throws std::invalid_argument where channels disagree or no step can be aligned
FramedModel align(const Model& model, const Model& reference, Index rows);

// Successive orthogonal Procrustes alignment of O_k with O_{k-1}: A_k varies as slowly as the system does.
Model smooth_frame(const Model& model, Index rows);

// Two models are kinematically similar when their Markov parameters agree; compared over the common steps and γ ≤ band.
struct Similarity {
  double max_difference = 0.0;  // largest ‖h1 - h2‖_F over the largest ‖h‖_F of both at the same step k
  bool similar = false;
};
Similarity kinematically_similar(const Model& a, const Model& b, double tolerance = 1e-8, Index band = 0);

}  // namespace tokid
