// Model + data → maximum-likelihood model, by expectation-maximisation (EM) over all experiments.
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
  // λ of the penalty  λ/2 Σ_k tr( Ω⁻¹ (Θ_{k+1} - Θ_k) W (Θ_{k+1} - Θ_k)ᵀ )  on the log-likelihood, for Θ = [A B] and
  // [C D]. W is the diagonal of the second moment of [x; u] at a typical step, summed over the experiments. For [C D],
  // Ω is the covariance of the innovations. For [A B], Ω is the second moment of the state, scaled so that the ratio of
  // noise to signal is that of the outputs. Ω and W are computed once, from the start model. 0: every step has its own
  // matrices; infinity: all steps share one set.
  double smoothing = 0.0;
  // P: the steps k and k+P share their matrices; 1: all steps; 0: no period; empty: the period of the model
  std::optional<Index> period = {};
  Index iterations = 60;  // largest number of iterations
  // EM has converged if an iteration without momentum increases the log-likelihood per output sample by less
  double tolerance = 1e-6;
  std::optional<InitialState> initial_state = {};  // empty: as the data state it, else as the model was identified
  bool feedthrough = true;                         // false: D_k = 0 is known, and a D of the model is ignored
  // Ascending steps K at which the matrices may jump: no penalty couples the steps K-1 and K. The state is carried
  // across. Only if the model varies and has no period.
  std::vector<Index> jumps = {};
  // false: A, B, C and D are known, and so is their variation. EM then estimates Q, R and the distribution of x_0
  // alone.
  bool estimate_matrices = true;
  bool accelerate = true;  // Nesterov's momentum; a step is used only if it raises the likelihood
  // EM first uses weaker penalties than λ, each with a third of the iterations, at most 15. Very weak ones are left
  // out.
  bool warm_up = true;
  Execution execution = {};
};

struct Refinement {
  // A, B, C, D, Q, R of every step of the data, K and G = -A K of the Kalman filter, and innovation_cov. x0_mean and
  // x0_cov are included if the initial states are zero, or if there are more experiments than states.
  Model model;
  double start_log_likelihood = 0.0;  // of the given model, before the warm-up
  // Values before the first iteration and after each iteration. `penalised` is the function that EM maximises; it never
  // falls. It is the log-likelihood with the penalty on variation over time, a term for the degrees of freedom of
  // coupled coefficients, and the prior of x0_cov. With smoothing = 0 and zero initial states, both lists are equal.
  std::vector<double> log_likelihood, penalised;
  Index iterations = 0;
  bool converged = false;
  Index noise_segments = 1;  // stretches of steps with their own noise size, for smoothing > 0
  Findings findings;
};

// Where the model has a nominal trajectory, EM works on the departures of the data from it. If the model lacks states
// at some steps, or Q and R, EM starts from with_constant_states(). The likelihood is that of the outputs that are
// present. A missing input counts as a random number with the mean square of its channel.
// With smoothing = 0, Q_k and R_k differ from step to step. Otherwise Q_k and R_k are constant matrices times a noise
// size. The noise size is constant, unless the size of the innovations varies significantly.
// \throws std::invalid_argument where channels disagree, a sample is infinite, the model has too few steps of its full
// dimension, there is no output sample, or an option is out of range; std::runtime_error where the start has no finite
// likelihood or EM diverges
Refinement refine(const Model& model, const Ensemble& data, const RefineOptions& options = {});

// (N) log-likelihood of each experiment: log of the density of its outputs given its inputs. The model needs Q and R,
// and for initial states that are not zero x0_mean and x0_cov. \throws std::invalid_argument if one is missing, or for
// an infinite sample
Vector log_likelihoods(const Model& model, const Ensemble& data, const Execution& execution = {});

// The model for the steps 0 … steps-1 with the largest state dimension at each step. If the model is in the raw frame
// of a realisation, it is transformed to the smooth frame. Steps before and after those of full dimension get the
// matrices of the nearest step of full dimension. If Q and R are missing, the function computes them from the gains and
// the covariance S of the innovations, if the model has S. Q is the mean of G S Gᵀ plus the covariance of the state
// that S leaves unknown; R is the mean of S.
// \throws std::invalid_argument where no two successive states have the full dimension
Model with_constant_states(const Model& model, Index steps);

// λ by cross-validation: the mean log-likelihood of held-out experiments.
struct LikelihoodChoice {
  std::vector<double> smoothing;       // the candidates, descending
  std::vector<double> log_likelihood;  // of each candidate, per output sample
  std::vector<double> error;  // standard error, over the experiments, of the difference from the best candidate
  // the most likely candidate; infinity if its log-likelihood is within one standard error of the largest
  double best = 0.0;
};
// starts[f] is a model for the experiments other than n = f, f+F, f+2F …, with F = starts.size(). EM continues from it.
// `options.smoothing` is ignored. The candidates are infinity, 3, 0.3, … 0.0003. If each step has at least two
// experiments for each unknown, 0 is a candidate too. Two last candidates are the best λ so far multiplied and divided
// by about 3.
// \throws std::invalid_argument for fewer than 2 folds or N < F, and as refine()
LikelihoodChoice choose_smoothing(const std::vector<Model>& starts, const Ensemble& data,
                                  const RefineOptions& options = {});

}  // namespace tokid
