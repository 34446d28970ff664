// Model + data → maximum-likelihood model, by expectation and maximisation (EM) over all experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "tokid/finding.hpp"
#include "tokid/model.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

struct RefineOptions {
  // λ of the penalty  λ/2 Σ_k tr( V⁻¹ (Θ_{k+1} - Θ_k) W (Θ_{k+1} - Θ_k)ᵀ )  on the log-likelihood, for Θ = [A B] and
  // [C D]: W is the diagonal of the second moment of [x; u] of a typical step, summed over the experiments, V the
  // covariance of the innovations, or for the state its second moment in the same ratio of noise to signal; both at the
  // start. 0: every step has matrices of its own; infinity: all steps share theirs.
  double smoothing = 0.0;
  // P: the steps k and k+P share their matrices; 1: all steps; 0: no period; empty: that of the model
  std::optional<Index> period = {};
  Index iterations = 60;    // at most
  double tolerance = 1e-6;  // converged: two gains in a row below this, of the log-likelihood per output sample
  std::optional<InitialState> initial_state = {};  // empty: as the data say, else as the model was identified
  bool accelerate = true;                          // Anderson's acceleration, where it raises the likelihood
  bool warm_up = true;  // a strong penalty is approached by way of weaker ones, a third of the iterations each
  Execution execution = {};
};

struct Refinement {
  // A, B, C, D, Q, R of every step of the data, K and G = -A K of its Kalman filter, innovation_cov; x0_mean and x0_cov
  // where initial states are zero, or the experiments are more than the states
  Model model;
  double start_log_likelihood = 0.0;  // of the model given, before any warming up
  // Before the first iteration and after each: the plain one, and the one that EM climbs and that never falls, with the
  // penalty on variation over time, the freedom that coefficients held together use up, and the prior of x0_cov. With
  // smoothing = 0 and zero initial states they are one.
  std::vector<double> log_likelihood, penalised;
  Index iterations = 0;
  bool converged = false;
  Index noise_segments = 1;  // stretches of steps whose noise has a size of its own, smoothing > 0
  Findings findings;
};

// The data are departures from the model's nominal trajectory, where it has one. A model whose states do not reach over
// all steps, or without Q and R, starts as with_constant_states() has it. Missing outputs are left out exactly; a
// missing input counts as a random one of the channel's mean square.
// With smoothing = 0 Q_k and R_k differ from step to step. Else they have one shape for all steps, and one size unless
// the innovations show that it varies.
// \throws std::invalid_argument where channels disagree, the model has too few steps of its full dimension, there is no
// output sample, or an option is out of range; std::runtime_error where the start has no finite likelihood
Refinement refine(const Model& model, const Ensemble& data, const RefineOptions& options = {});

// (N) log-likelihood of each experiment: the density of its outputs given its inputs. The model needs Q and R, and
// x0_mean and x0_cov where its first state is not zero. \throws std::invalid_argument
Vector log_likelihoods(const Model& model, const Ensemble& data, const Execution& execution = {});

// The steps 0 … steps-1 with the largest state dimension everywhere: in the smooth frame where the model is in the raw
// one of a realisation, the ends as their nearest full step has it. Q and R, where missing, from the gains and the
// innovations, if they have a covariance: Q the mean of G S Gᵀ and what S leaves unknown of a state, R that of S.
// \throws std::invalid_argument where no two successive states have the full dimension
Model with_constant_states(const Model& model, Index steps);

// λ by cross-validation: the mean log-likelihood of experiments that were left out.
struct LikelihoodChoice {
  std::vector<double> smoothing;       // the candidates, descending
  std::vector<double> log_likelihood;  // of each, per output sample
  std::vector<double> error;           // standard error of its difference from the best, over the experiments
  double best = 0.0;                   // the likeliest; infinity already where it is within one standard error
};
// starts[f] is a model for the experiments other than n = f, f+F, f+2F …, F = starts.size(), from which EM goes on;
// `options.smoothing` is of no account. Candidates: infinity, 3, 0.3, … 0.0003, and 0 where there are at least two
// experiments for each unknown of a step; then the best times and by about 3. \throws std::invalid_argument for fewer
// than 2 folds or N < F, and as refine()
LikelihoodChoice choose_smoothing(const std::vector<Model>& starts, const Ensemble& data,
                                  const RefineOptions& options = {});

}  // namespace tokid
