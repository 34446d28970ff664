// Kalman filter and Rauch-Tung-Striebel smoother for all experiments at once, with missing samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/model.hpp"
#include "tokid/parallel.hpp"

namespace tokid::kalman {

// A group of experiments with the same missing samples. They share all covariances.
struct Alike {
  Index first = 0, count = 0;                // columns of the samples
  Index end = 0;                             // number of steps, up to the last available output
  std::vector<std::vector<Index>> outputs;   // (end) available outputs
  std::vector<std::vector<Index>> unknowns;  // (end) missing inputs
};

// The samples at the steps of a model, as departures from its nominal trajectory. Step t is step k_begin + t.
struct Samples {
  Index experiments = 0, steps = 0;
  std::vector<Matrix> u, y;  // (steps) r × N and m × N, zero where missing; the experiments of a group are adjacent
  std::vector<Alike> groups;
  std::vector<Index> experiment;  // (N) experiment of each column
  Vector u_square, y_square;      // (r), (m): mean squares of the available samples
  double outputs = 0;             // number of available output samples
};
// Steps after the last output of an experiment contain no information. They are dropped, unless they must be predicted.
enum class Tail { drop, keep };
// Arranges the samples, for the first `steps` steps of the model if `steps` is not negative.
// \throws std::invalid_argument for wrong numbers of channels
Samples samples_of(const Model& model, const Ensemble& data, Tail tail = Tail::drop, Index steps = -1);

// Sums over the experiments of expected second moments, given all samples. z_k = [x_k; u_k].
struct Moments {
  std::vector<Matrix> measured;  // (T) of [z_k; y_k], over the experiments with an output at step k
  std::vector<Matrix> moved;     // (T) of [z_k; x_{k+1}], over the experiments that continue at step k+1
  Vector measured_count, moved_count;
  Vector x0;         // (n_0) sum of x_0
  Matrix x0_square;  // (n_0 × n_0) of x_0
  double x0_count = 0;
};

struct Smoothed {
  Vector log_likelihood;  // (N) for each column of the samples
  Moments moments;
};

// Runs the smoother. The model must have Q, R, and either x0_mean and x0_cov or a zero state at its first step. A
// missing input counts as random: its mean is zero, its variance is the mean square of its channel, and it has no
// correlation in time. The sums have the same bits for any number of threads.
Smoothed smooth(const Model& model, const Samples& samples, const Execution& execution = {});

// Runs only the filter. Returns the log-likelihoods (N).
Vector log_likelihoods(const Model& model, const Samples& samples, const Execution& execution = {});
// εᵀ S⁻¹ ε / m of every step and column (T × N), which has the mean 1. S is the covariance of the innovation ε, and m
// the number of available outputs. Without an output, the value is NaN.
Matrix innovation_squares(const Model& model, const Samples& samples);
// E[x_k | samples before k] (n_k × N each) for the steps 0 … T
std::vector<Matrix> predicted_states(const Model& model, const Samples& samples);
// E[x_0 | all samples] (n_0 × N)
Matrix smoothed_first_states(const Model& model, const Samples& samples);

}  // namespace tokid::kalman
