// The options of an identification, and its choices from noisy data.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

enum class Frame { raw, reference, smooth };
enum class Method {
  tvera,       // Hankel matrices of the Markov parameters: the paper
  subspace,    // predictor subspaces, and EM where it predicts better
  regression,  // the regressions themselves, as a model of p·m states in observer form
};
enum class NominalChoice { none, mean };
// What an identification does about experiments and single samples that do not fit the others.
enum class OutlierChoice {
  keep,        // it uses them as they are
  drop,        // it leaves the experiments out, and the samples count as missing
  downweight,  // the experiments count less, and the samples are moved towards their predictions
};

// The weighting. Because of noise, data have more states than the model can have. The weighting decides which outputs
// the states of the model explain best.
enum class Weighting {
  one_step,    // each output, from the samples up to the step before; best for the observer (canonical variates)
  many_steps,  // all future outputs, from the past samples alone; best for the simulation
  // As many_steps, but by projections of the data instead of the ARX model (PO-MOESP). Needs a period. The poles do not
  // depend on a noise model, and B and D give the best simulation.
  projection,
};

// The allowed variation of a model over time: free, slow, periodic or none.
struct TimeVariation {
  // λ of the penalty  λ N Σ_k ‖(M_{k+1} - M_k) diag(rms of the regressors)‖²  on the residual sum of squares. N is the
  // mean number of experiments at a step; with a period, the mean number of rows of a phase. 0: each step uses its own
  // data only. Infinity: all steps have the same coefficients.
  double smoothing = 0.0;
  Index period = 0;               // P: the steps k and k+P share one model; 1: all steps; 0: no period
  std::vector<Index> jumps = {};  // ascending steps at which the matrices of models without a period jump

  Index groups(Index steps) const { return period > 0 && period < steps ? period : steps; }
  Index group(Index k) const { return period > 0 ? k % period : k; }  // group of step k: the steps that share its model
};

// The choices of an identification from noisy data, apart from p and n.
struct NoisyChoices {
  TimeVariation variation;
  double state_smoothing = 0.0;  // λ of the regressions on states
  Weighting weighting = Weighting::one_step;
  double refinement_smoothing = 0.0;  // λ of EM
  Index refinement_iterations = 0;    // 0: no refinement
  std::vector<Index> delays = {};     // as in IdentifyOptions
};

// Do the outputs respond to the inputs of the same step? If not, D_k = 0.
struct FeedthroughChoice {
  enum class Reason {
    stated,       // by the user
    exact,        // yes: in data without noise, D is exact
    no_response,  // no: no correlation between inputs and outputs of a step, apart from what the past explains
    response,     // yes: such a correlation, and no sign of feedback
    feedback,     // yes: such a correlation and feedback, so the inputs may respond to the outputs of the same step
    untested,     // yes: the samples do not tell
    unknown,      // yes: nothing is known of the identification
    last = unknown
  };
  bool present = true;
  Reason reason = Reason::stated;
  // Probabilities of correlations at least this significant if there are none: between inputs and outputs of a step,
  // and between inputs and earlier innovations. NaN if not tested.
  double response_p = std::numeric_limits<double>::quiet_NaN();
  double feedback_p = std::numeric_limits<double>::quiet_NaN();
  Index input = 0, output = 0;  // the pair with the most significant correlation within a step
};
const char* to_string(FeedthroughChoice::Reason reason);  // "no_response": the stable name in JSON and Python
std::string in_words(const FeedthroughChoice& choice);    // the decision and its reason

// The identification chooses every option that is empty.
struct IdentifyOptions {
  // n. Empty: the rank of each H_k if the data are free of noise, else the order with the smallest prediction and
  // simulation errors.
  std::optional<Index> states = {};
  // p. Empty: the order with the smallest cross-validation error, chosen together with λ if the data are noisy.
  std::optional<Index> lags = {};
  // Empty: TVERA for data without noise from zero initial states, else the subspace realisation.
  std::optional<Method> method = {};
  // λ of the penalty on variation over time. Infinity: one model for all steps. TVERA has no λ. Empty: by
  // cross-validation if the data are noisy or too few for a regression at each step.
  std::optional<double> smoothing = {};
  // false: D_k = 0 is known, because inputs do not act on the outputs of the same step. Empty: true for data without
  // noise, else by a test.
  std::optional<bool> feedthrough = {};
  Index period = 0;  // P: the steps k, k+P, … share one model; 1: time-invariant; 0: each step has its own
  // Ascending steps K at which the matrices jump: the penalty of EM does not couple the steps K-1 and K. Empty: the
  // steps that cross-validation finds. No steps: no jumps.
  std::optional<std::vector<Index>> jumps = {};
  // (r) Dead times in steps: the outputs respond to input i first after delays[i] steps more than the state needs. As
  // many of the n states hold the inputs that are on their way. Empty vector: no dead time. Without a value: by a test,
  // unless n, p or TVERA is stated.
  std::optional<std::vector<Index>> delays = {};
  // Weighting of the subspace realisation. Empty: by cross-validation if steps share a model, else one_step.
  std::optional<Weighting> weighting = {};
  // (m) Weights of the outputs: numbers from 0 on, not all 0. Only their ratios matter. Empty: all outputs count alike.
  // They act on the errors by which p, λ, n, the weighting and the use of EM are chosen, and on which states are kept
  // if there are more than n. EM itself maximises the likelihood, whatever the weights are.
  std::vector<double> output_weights = {};
  // Steps ahead, ascending from 1 on: predictions of these horizons decide between numbers of states, EM and
  // regressions. Those beyond half of the scored steps do not count. Others than the default ones must be at most half
  // of the steps.
  std::vector<Index> horizons = {1, 5, 20};
  // true: EM refines the model, if this lowers the cross-validation error. Empty: true for noisy data with the subspace
  // realisation.
  std::optional<bool> refine = {};
  std::optional<InitialState> initial_state = {};  // empty: as the data state it, else by a test of the first residuals
  std::optional<NominalChoice> nominal = {};       // empty: mean if the mean motion is significant, else none
  // Coordinates of the model. raw: those that the method computes. With coupled steps, these are smooth already, and
  // Model::frame then says "smooth".
  Frame frame = Frame::raw;
  std::optional<Index> reference_step = {};  // s of the reference frame; empty: the first step of full dimension
  double hold_out = 0.0;                     // held-out share of the experiments, for validation, 0 ≤ share < 1
  OutlierChoice outliers = OutlierChoice::keep;
  // Block rows and columns of H_k. Empty: max(p, ⌈n/m⌉)+1 rows, and max(p, n) columns, or max(p, 48) with noise.
  std::optional<Index> rows = {}, cols = {};
  // Choices of an earlier identification. If they are given, `lags`, `states` and `feedthrough` must be those of that
  // identification too. Empty: the identification chooses.
  std::optional<NoisyChoices> choices = {};
  Execution execution = {};
};

}  // namespace tokid
