// What the innovations say about a model: are they white, independent of the inputs, and as large as the model holds?
// Probabilities p are uniform between 0 and 1 where the model is right and the data are not those of its
// identification, whose innovations are smaller than new ones and orthogonal to what they were regressed on.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// Lags of the tests in time, where nothing else is asked for: docs/math.md says why so many.
inline constexpr Index test_lags = 5;
// Probabilities below it are held to be no chance.
inline constexpr double unlikely = 0.01;

// Innovations ε_k: T matrices of N × m, NaN where there is none.
using Innovations = std::vector<Matrix>;

// The innovations that the model holds to be white, with covariance S_k: those of its observer (9) where that has known
// the state from the start and seen every output since. Where it has not, its gain is not the best that the model
// allows, and predictions one step ahead leave more than S_k, with a memory. There the state relative to that of an
// observer that has seen all is followed by a Kalman filter, and what it leaves is scaled to the covariance S_k. After
// an unknown state they begin with the first sample that was not needed to estimate it. Without an innovation
// covariance: those of predict(). \throws std::invalid_argument where channels disagree
Innovations model_innovations(const Model& model, const Ensemble& data, std::optional<InitialState> initial_state = {});

// What the correlations of a test were taken over. Experiments are independent whatever happens within them, so that
// each step can be judged for itself. Where they are too few, at most m + 2 at every step, but their innovations more
// than 10 (m + 2) in all, those are pooled, which presumes that their covariance is the same at all steps.
enum class Pooling { none, experiments, time };

// Are the innovations of successive steps correlated? For each step k and lag j the sum of squared canonical
// correlations (Pillai's trace) over experiments of ε_k with ε_{k-j}. If the innovations are white and normal, mean,
// variance and third moment of the sum of all traces are known, and p is the tail of the gamma distribution with these
// moments. The mean is the same for any other distribution.
struct Whiteness {
  // Probability of innovations as correlated as these if they were white; NaN where not tested.
  double p = std::numeric_limits<double>::quiet_NaN();
  Vector z;            // (lags) the standardised sum of each lag alone
  Matrix correlation;  // (lags × m): of every output with itself j steps before, mean over the steps of the
                       // correlation over experiments
  Vector bound;        // (lags): 99 % of the entries of `correlation` are smaller in size if the innovations are white
  Pooling over = Pooling::none;
};
Whiteness whiteness(const Innovations& innovations, Index lags);

// whiteness(innovations, lags).p
double whiteness_p(const Innovations& innovations, Index lags);

// Are the innovations correlated with the inputs u_{k-j}, first ≤ j ≤ last? With past and present inputs, j ≥ 0, they
// are if the model leaves out, or gets wrong, how the outputs answer to the inputs. With later inputs, j < 0, they are
// if the inputs answer to the outputs: feedback, which is no fault of the model. Traces as for whiteness, summed over
// the lags with the inputs taken as given, so that these may be correlated in time in any way. A missing input counts
// as the mean of the others.
struct Independence {
  // Probability of correlations as large as these if there were none; NaN where not tested.
  double p = std::numeric_limits<double>::quiet_NaN();
  Index first = 0;     // lag of the first entry of z and of `correlation`
  Vector z;            // (last - first + 1) the standardised sum of each lag alone
  Vector correlation;  // (last - first + 1) root mean square of the canonical correlations beyond what chance gives
  Pooling over = Pooling::none;
};
// \throws std::invalid_argument for first > last or numbers of experiments or steps that disagree
Independence independence(const Innovations& innovations, const Ensemble& data, Index first, Index last);

// Normalised innovations squared, ε_kᵀ S_k⁻¹ ε_k with the innovation covariance S_k of the model: m in the mean if S_k
// is right.
struct NormalisedSquares {
  // A larger ratio is no agreement, whatever p says of the spread over the experiments: single ones are wild.
  static constexpr double wild = 10.0;
  // Mean over the number of outputs: 1 if S_k is right, more if the model is overconfident, less if it is too careful;
  // NaN where the model has no covariance.
  double ratio = std::numeric_limits<double>::quiet_NaN();
  // Probability of a ratio as far from 1, on either side, if S_k were right.
  double p = std::numeric_limits<double>::quiet_NaN();
  // Of fewer than 20 experiments: p is that of normal innovations (χ²). Else the spread over the experiments is the
  // measure (Student's t), and nothing is presumed but that they are independent.
  bool normal = true;
  Vector step;    // (T) the ratio of each step; NaN where there is none
  Vector step_p;  // (T) its p
};
// \throws std::invalid_argument for another number of outputs
NormalisedSquares normalised_squares(const Model& model, const Innovations& innovations);

// Do the outputs answer to each input as strongly as the model says? If the effects B, D of input i were 1 + α_i times
// those of the model, the innovations would have the part Σ α_i (C_k s_i + D_k u_i), where s_i is the response of the
// observer's error to the input. α is the least-squares estimate, each step weighted by its covariance. Past inputs are
// independent of an innovation in closed loop too. What all experiments have in common is removed step by step, unless
// the steps share a model or there is one experiment.
struct InputGains {
  Vector error;      // (r) α; NaN where the inputs don't tell it, or nothing was tested
  Vector deviation;  // (r) its standard deviation; infinite where the inputs don't tell it
  // (r) What the model answers to this input alone, RMS of its simulation relative to that of the output, for the
  // output where it is largest: an error α changes the simulation by this share of α.
  Vector share;
};
// The innovations are those of predict(). \throws std::invalid_argument for numbers of experiments, steps or channels
// that disagree
InputGains input_gains(const Model& model, const Ensemble& data, const Innovations& innovations);

}  // namespace tokid
