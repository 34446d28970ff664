// The model sequence A_k, B_k, C_k, D_k, G_k: simulation, prediction, pulse responses, coordinates.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"
#include "tokid/provenance.hpp"
#include "tokid/step.hpp"

namespace tokid {

struct Model {
  Index inputs = 0, outputs = 0;  // r, m
  Index k_begin = 0;              // first step with a model
  double dt = 1.0;                // sample time [s]
  std::vector<Step> step;         // (S) from k_begin on; the states after a step are those before the next

  // P: the steps k and k+P have the same matrices, also after the last step; 1: time-invariant; 0: the model ends with
  // its last step.
  Index period = 0;

  // Coordinates of the states: raw, reference or smooth. The method may already compute smooth coordinates: the
  // subspace realisation does so if λ or a period couples the steps.
  std::string frame = "raw";
  // The method that made the model: tvera, subspace, regression, or em after a refinement. known: the matrices come
  // from elsewhere.
  std::string method;
  InitialState initial_state = InitialState::zero;
  Channels names;

  // The nominal trajectory that was removed before identification, T × r and T × m; empty if none was.
  Matrix u_nominal, y_nominal;

  // Mean and covariance of unknown states at k_begin, if estimated or known.
  Vector x0_mean;  // (n_0)
  Matrix x0_cov;   // (n_0 × n_0)

  Provenance provenance;

  Index steps() const { return static_cast<Index>(step.size()); }  // S
  Index k_end() const { return k_begin + steps(); }
  Index states() const;      // largest n_k
  Index full_begin() const;  // first k with the largest n_k
  Index full_end() const;    // end of the run of steps with the largest n_k that starts at full_begin()
  size_t index(Index k) const { return static_cast<size_t>(k - k_begin); }
  const Step& at(Index k) const { return step[index(k)]; }  // k_begin ≤ k < k_end
  Step& at(Index k) { return step[index(k)]; }
  Index n(Index k) const;  // n_k, k_begin ≤ k ≤ k_end; 0 without any step
  Index max_lags() const;  // largest p_k, at least 1

  // Do the steps have this optional part? After check(), either all steps have the part or no step has it.
  bool has(bool (Step::*part)() const) const { return !step.empty() && (step.front().*part)(); }

  // \throws std::invalid_argument if the number or shape of a part is inconsistent, or if it is not finite; the message
  // names the part
  void check() const;
};

// \throws std::overflow_error for a model with infinite or NaN entries
void check_finite(const Model& model);

// Simulates the outputs y_k (N × m each) at the steps of the inputs, as an ensemble; NaN where the model has no step.
// x0 (n × N) holds the state of every experiment at k_begin. By default, the state is x0_mean if
// has_initial_estimate(), else zero; whether the initial states are zero or unknown is taken from the inputs, or from
// the model if the inputs do not state it. The nominal trajectory is added to the outputs. After a missing input, the
// outputs of its experiment are NaN.
// \throws std::invalid_argument for a wrong number of inputs, an infinite input, or a wrong shape of x0
Ensemble simulate(const Model& model, const Ensemble& inputs, const Matrix& x0 = {});

// A finding if the data have steps after the last step of the model, because no outputs are computed there.
Findings findings_of_end(const Model& model, const Ensemble& data);

// Findings on differences in sample time and names. Such a difference is allowed, but may be a mistake of the user.
Findings differences(const Model& model, const Ensemble& data);

// Number of unknowns per output in the regression of step k, whose rank and condition the model stores. With TVERA and
// for the regression itself, the unknowns are the coefficients of the window; else those of states and inputs. The
// inputs of step k count only with feedthrough. 0 if the model does not come from regressions.
Index unknowns(const Model& model, Index k);

// Is the state at the first step of the model known to be zero? If the model begins after step 0, it is not known.
bool starts_from_zero(const Model& model, InitialState initial);

// Does the model have x0_mean and x0_cov for unknown states at its first step?
bool has_initial_estimate(const Model& model, InitialState initial);

// The number of steps whose samples determine a state: the largest lag order, but at least ⌈n/m⌉. States that hold
// inputs are not counted in n: after the longest dead time, the inputs of the window determine them.
Index estimation_window(const Model& model);

struct PredictOptions {
  Index horizon = 1;  // H: ŷ_k uses the outputs up to k-H and the inputs up to k
  // Empty: as the data state it, else as the model was identified.
  std::optional<InitialState> initial_state = {};
  // true: unknown initial states have mean x0_mean and covariance x0_cov, if the model has both. false: they have
  // another distribution, and are estimated from the first samples.
  bool initial_estimate = true;
};

// \throws std::invalid_argument unless 1 ≤ H < T; H = 1 is always allowed
void check_horizon(Index horizon, Index steps);

struct Prediction {
  Ensemble y;                       // u as given, y predicted; NaN without a prediction
  std::vector<Matrix> innovations;  // (T) of (N × m): y_k - ŷ_{k|k-1}; NaN if either is missing
};

// Predicts with the observer, x̂_{k+1} = A_k x̂_k + B_k u_k - G_k (y_k - ŷ_k) (9), from zero or from x0_mean on. The
// state is unknown after a missing input. It is also unknown at the start if the initial states are unknown and the
// model has no estimate of them. An unknown state is estimated from the following samples. Predictions are NaN until
// these samples determine the whole state: estimation_window(model) steps, or more if necessary. If the innovation of
// an output is missing, it is estimated from the innovations of the other outputs by innovation_cov. Without
// innovation_cov it counts as zero.
// If samples are missing and the model has Q, R and an initial state, a Kalman filter for the samples that are present
// replaces the observer. A missing input then counts as a random number with the mean square of its channel.
// \throws std::invalid_argument for wrong channel numbers, an infinite sample, and as check_horizon
Prediction predict(const Model& model, const Ensemble& data, const PredictOptions& options = {});

// Estimates the states (n × N) of the experiments at step k by least squares over the samples k … k+window-1. The
// function minimises the sum of squares of the observer's innovations, whitened by their covariance, because they
// depend linearly on x_k. A column is NaN if a sample that it needs is missing. \throws std::invalid_argument where k
// or window are outside the model, or for an infinite sample
Matrix estimate_state(const Model& model, const Ensemble& data, Index k, Index window);

// Simulates the outputs from the inputs of the data. If the initial state is unknown, it is estimated from the first
// samples. NaN at steps without an output of the model. \throws std::invalid_argument for a wrong number of channels or
// an infinite sample
Ensemble simulate_data(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state = {});

// h_{k,i} (m × r), k > i (7); h°_{k,i} (m × m) (30). \throws std::invalid_argument for steps outside the model
Matrix pulse_response(const Model& model, Index k, Index i);
Matrix gain_pulse_response(const Model& model, Index k, Index i);

// All pulse_response() matrices with 1 ≤ γ ≤ band: (S) of (m × band·r). Block γ-1 of step k is h_{k,k-γ}. It is NaN if
// the model has no step k-γ. \throws std::invalid_argument for band < 1
std::vector<Matrix> pulse_responses(const Model& model, Index band);

// [C_k; C_{k+1} A_k; …] (rows·m × n_k), with fewer block rows near the end of the model. \throws as from_step, and for
// rows < 0
Matrix observability(const Model& model, Index k, Index rows);

// Is the model periodic, and does it have fewer steps than `steps`?
bool ends_early(const Model& model, Index steps);
// Extends a periodic model to steps up to `end` at least; returns any other model unchanged. Its nominal trajectory
// continues with the same period.
Model continued(Model model, Index end);

// The model from step k on. For k = k_end it has no steps.
// \throws std::invalid_argument for k outside the model
Model from_step(Model model, Index k);

// The model with the steps begin … end-1 only. A periodic model is continued where needed, and stays periodic if a
// whole period is left. \throws std::invalid_argument for steps outside the model, or none
Model cut(Model model, Index begin, Index end);

// Joins two models of the same system at step k: the result has the steps of `earlier` before k, and those of `later`
// from k on. The given number of block rows of O_k of both models gives the state of `later` from that of `earlier`.
// Therefore both models need the steps k … k+rows-1; periodic models are continued. The result has the optional parts
// that both models have, and the rows of both nominal trajectories. It ends with the last step of `later`.
struct JoinedModel {
  Model model;
  // How much the models differ at the steps k … k+rows-1. The larger one of two relative differences: of the outputs
  // from a state, ‖O_k(earlier) - O_k(later)·S‖_F / ‖O_k(earlier)‖_F, and of the pulse responses as in Similarity.
  double misfit = 0.0;
};
// \throws std::invalid_argument where channels, sample times or state dimensions disagree, steps are missing, or the
// block rows do not determine the state
JoinedModel join(const Model& earlier, const Model& later, Index k, Index rows);

// Changes the coordinates to x'_k = S_k x_k with S (S+1 matrices n_k × n_k). The outputs do not change.
// \throws std::invalid_argument for a wrong shape or a singular matrix
Model transform(const Model& model, const std::vector<Matrix>& S);

// The coordinates of the paper's figures: x'_k = P O_k x_k with P = O_s⁺ and the given number of block rows. A step
// keeps its coordinates if its state dimension differs from n_s, or if too few steps follow for the block rows. `begin`
// and `end` are the range of the other steps.
struct FramedModel {
  Model model;
  Index begin = 0, end = 0;  // steps in the frame: begin ≤ k < end
};
// \throws std::invalid_argument where step s has no state or too few block rows
FramedModel reference_frame(const Model& model, Index s, Index rows);

// Transforms the model to the coordinates of another model of the same system: x'_k = O_k(reference)⁺ O_k x_k with the
// given number of block rows. Then A'_k, B'_k, C'_k, G'_k can be compared one by one with those of the reference.
// `begin` and `end` as above. \throws std::invalid_argument where channels disagree or no step can be aligned
FramedModel align(const Model& model, const Model& reference, Index rows);

// Aligns O_k with O_{k-1} by an orthogonal transformation (Procrustes), step after step. Afterwards A_k varies as
// slowly as the system.
Model smooth_frame(const Model& model, Index rows);

// Two models are kinematically similar if their Markov parameters agree. The Markov parameters of the common steps with
// γ ≤ band are compared. Models that go on are continued: to the end of the other one, or over a common period.
struct Similarity {
  double max_difference = 0.0;  // largest ‖h1 - h2‖_F over the largest ‖h‖_F of both models at the same step k
  bool similar = false;
  // (m × r) ‖h1 - h2‖ / ‖h2‖ of the response of each output to each input, over all compared k and γ; NaN where b has
  // no response. This is the relative error of `a` if `b` is the truth.
  Matrix relative_error;
  Index begin = 0, end = 0, band = 0;  // compared: pulses and responses at the steps begin … end-1, γ ≤ band
};
Similarity kinematically_similar(const Model& a, const Model& b, double tolerance = 1e-8, Index band = 0);

}  // namespace tokid
