// Kalman filter and Rauch-Tung-Striebel smoother of all experiments at once, around missing samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/model.hpp"
#include "tokid/parallel.hpp"

namespace tokid::kalman {

// Experiments whose samples are missing at the same places share all covariances.
struct Alike {
  Index first = 0, count = 0;                // columns of the samples
  Index end = 0;                             // steps that count: up to the last output that is there
  std::vector<std::vector<Index>> outputs;   // (end) the outputs that are there
  std::vector<std::vector<Index>> unknowns;  // (end) the inputs that are missing
};

// The samples that a model has steps for, as departures from its nominal trajectory. Step t is step k_begin + t.
struct Samples {
  Index experiments = 0, steps = 0;
  std::vector<Matrix> u, y;  // (steps) r × N and m × N, zero where missing; like experiments side by side
  std::vector<Alike> groups;
  std::vector<Index> experiment;  // (N) of each column
  Vector u_square, y_square;      // (r), (m): mean squares of the samples that are there
  double outputs = 0;             // number of output samples that are there
};
// Steps behind the last output of an experiment say nothing and are left out, unless they are to be predicted.
enum class Tail { drop, keep };
// Of the first `steps` steps of the model, if that is not negative. \throws std::invalid_argument for wrong numbers of
// channels
Samples samples_of(const Model& model, const Ensemble& data, Tail tail = Tail::drop, Index steps = -1);

// Sums over the experiments of second moments, given all samples; z_k = [x_k; u_k].
struct Moments {
  std::vector<Matrix> measured;  // (T) of [z_k; y_k], over the experiments with an output at step k
  std::vector<Matrix> moved;     // (T) of [z_k; x_{k+1}], over the experiments that go on at step k+1
  Vector measured_count, moved_count;
  Vector x0;         // (n_0) sum of x_0
  Matrix x0_square;  // (n_0 × n_0) of x_0
  double x0_count = 0;
};

struct Smoothed {
  Vector log_likelihood;  // (N) of each column of the samples
  Moments moments;
};

// What the model must have: Q, R, and x0_mean and x0_cov, or a state that is zero at its first step. A missing input is
// a random one of mean zero, the channel's mean square and no correlation in time. The sums have the same bits for any
// number of threads.
Smoothed smooth(const Model& model, const Samples& samples, const Execution& execution = {});

// Filter alone: (N), and E[x_k | samples before k] (n_k × N each) for the steps 0 … T
Vector log_likelihoods(const Model& model, const Samples& samples, const Execution& execution = {});
// εᵀ S⁻¹ ε / m of every step and column (T × N), S the covariance of the innovation ε and m the outputs that are there:
// 1 in the mean; NaN where none is
Matrix innovation_squares(const Model& model, const Samples& samples);
std::vector<Matrix> predicted_states(const Model& model, const Samples& samples);
// E[x_0 | all samples] (n_0 × N)
Matrix smoothed_first_states(const Model& model, const Samples& samples);

}  // namespace tokid::kalman
