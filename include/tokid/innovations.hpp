// Tests of the innovations: are they white, are they independent of the inputs, and do they have the covariance of the
// model? Each test returns a probability p. If the model is right and the data are new, p is uniform between 0 and 1.
// On the training data it is not, because there the innovations are smaller and orthogonal to their regressors.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// Default number of lags of the tests; docs/evidence.md has the figures.
inline constexpr Index test_lags = 5;
// A test is significant if its p is smaller.
inline constexpr double unlikely = 0.01;

// Innovations ε_k: T matrices of N × m, NaN where there is no innovation.
using Innovations = std::vector<Matrix>;

// The innovations that are white with covariance S_k if the model is right. If the initial state is known and no output
// is missing, they are the innovations of the observer (9). Otherwise the gain of the observer is not optimal: its
// prediction errors are larger than S_k and correlated in time. A Kalman filter then estimates the difference from the
// state of an observer that has all outputs. The innovations of this filter are scaled to the covariance S_k. If an
// unknown state was estimated from samples, the innovations begin after these samples. If the model has no innovation
// covariance, the innovations are those of predict(). \throws std::invalid_argument where channels disagree,
// or for an infinite sample
Innovations model_innovations(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state = {});

// The samples over which a test computes its correlations. Experiments are independent, so each step can be tested
// separately over the experiments. If there are at most m + 2 experiments at every step, but more than 10 (m + 2)
// innovations in total, the test pools all steps. It then assumes that their covariance is the same at all steps.
enum class Pooling { none, experiments, time };

// Test: are the innovations of different steps correlated? For each step k and lag j, the statistic is the sum of
// squared canonical correlations (Pillai's trace) over experiments of ε_k with ε_{k-j}. If the innovations are white
// and normal, the mean, variance and third moment of the sum of all traces are known. p is the upper tail probability
// of the gamma distribution with these moments. If the innovations are white but not normal, the mean is still exact.
struct Whiteness {
  // Probability of at least this correlation if the innovations are white; NaN if not tested.
  double p = std::numeric_limits<double>::quiet_NaN();
  Vector z;  // (lags) the standardised sum of each lag alone
  // (lags × m): correlation over the experiments between the innovation of each output and the same j steps earlier;
  // mean over the steps
  Matrix correlation;
  Vector bound;  // (lags): if the innovations are white, 99 % of the entries of `correlation` are smaller in size
  Pooling over = Pooling::none;
};
Whiteness whiteness(const Innovations& innovations, Index lags);

// whiteness(innovations, lags).p
double whiteness_p(const Innovations& innovations, Index lags);

// Test: are the innovations correlated with the inputs u_{k-j}, first ≤ j ≤ last? A correlation with past and present
// inputs, j ≥ 0, means that the model of the response to the inputs is wrong or incomplete. A correlation with later
// inputs, j < 0, means that the inputs depend on the outputs: feedback, which is not a fault of the model. The traces
// are those of the whiteness test, summed over the lags. The inputs are taken as given numbers, so they may have any
// correlation in time. A missing input is replaced by the mean of the inputs that are present.
struct Independence {
  // Probability of correlations at least this large if there is none; NaN if not tested.
  double p = std::numeric_limits<double>::quiet_NaN();
  Index first = 0;     // lag of the first entry of z and of `correlation`
  Vector z;            // (last - first + 1) the standardised sum of each lag alone
  Vector correlation;  // (last - first + 1) RMS of the canonical correlations beyond chance
  Pooling over = Pooling::none;
};
// \throws std::invalid_argument for first > last or numbers of experiments or steps that disagree
Independence independence(const Innovations& innovations, const Ensemble& data, Index first, Index last);

// Normalised innovations squared, ε_kᵀ S_k⁻¹ ε_k with the innovation covariance S_k of the model. The mean is m if S_k
// is right.
struct NormalisedSquares {
  // A larger ratio counts as significant for every p, because a few extreme experiments can enlarge the spread and thus
  // p.
  static constexpr double wild = 10.0;
  // Mean of the normalised squares over the number of outputs. 1 if S_k is right, more if S_k is too small, less if S_k
  // is too large; NaN if the model has no covariance.
  double ratio = std::numeric_limits<double>::quiet_NaN();
  // Probability of a ratio at least this far from 1, on either side, if S_k is right.
  double p = std::numeric_limits<double>::quiet_NaN();
  // true: fewer than 20 experiments, and p assumes normal innovations (χ²). false: p follows from the spread over the
  // experiments (Student's t), and assumes only that they are independent.
  bool normal = true;
  Vector step;    // (T) ratio of each step; NaN where there is none
  Vector step_p;  // (T) p of each step
};
// \throws std::invalid_argument for another number of outputs
NormalisedSquares normalised_squares(const Model& model, const Innovations& innovations);

// Test: does each input act on the outputs as strongly as in the model? Suppose that the true columns of B, D for input
// i are 1 + α_i times those of the model. The innovations then contain the term Σ α_i (C_k s_i + D_k u_i), where s_i is
// the response of the observer's state error to input i. α is estimated by least squares, with each step weighted by
// its covariance. The estimate is also valid for data with feedback, because an innovation is independent of past
// inputs. At each step the mean over the experiments is removed first, unless the steps share a model or there is only
// one experiment.
struct InputGains {
  Vector error;      // (r) α; NaN if the inputs do not determine it, or without a test
  Vector deviation;  // (r) standard deviation of α; infinite where the inputs do not determine it
  // (r) RMS of the simulated response to this input alone over the RMS of the output, for the output where it is
  // largest. An error α changes the simulation by this share times α.
  Vector share;
};
// `innovations` must be those of predict(). \throws std::invalid_argument for numbers of experiments, steps or channels
// that disagree
InputGains input_gains(const Model& model, const Ensemble& data, const Innovations& innovations);

}  // namespace tokid
