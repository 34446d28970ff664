// Kalman filter and Rauch-Tung-Striebel smoother for all experiments at once, with missing samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "model/moments.hpp"
#include "model/samples.hpp"
#include "tokid/parallel.hpp"

namespace tokid::kalman {

struct Smoothed {
  Vector log_likelihood;  // (N) for each row of the samples
  Moments moments;
};

class Pieces;

// The smoother for models of a constant state dimension. It keeps its memory from model to model, so that one object
// serves one caller at a time.
class Smoother {
 public:
  // The samples must live as long as the smoother.
  explicit Smoother(const Samples& samples);
  ~Smoother();

  // The model must have Q, R, and either x0_mean and x0_cov or a zero state at its first step. A missing input counts
  // as random: its mean is zero, its variance is the mean square of its channel, and it has no correlation in time. The
  // sums have the same bits for any number of threads. With `together`, the moments of
  // all steps are one sum, with one entry in each list.
  // \throws std::logic_error if the state dimension varies
  Smoothed smooth(const Model& model, const Execution& execution = {}, bool together = false);

 private:
  std::unique_ptr<Pieces> pieces_;
};

// Runs only the filter. Returns the log-likelihoods (N).
Vector log_likelihoods(const Model& model, const Samples& samples, const Execution& execution = {});
// εᵀ S⁻¹ ε / m of every step and row of the samples (T × N), which has the mean 1. S is the covariance of the
// innovation ε, and m the number of available outputs. Without an output, the value is NaN.
Matrix innovation_squares(const Model& model, const Samples& samples);
// E[x_k | samples before k] (N × n_k each) for the steps 0 … T
std::vector<Matrix> predicted_states(const Model& model, const Samples& samples);
// E[x_0 | all samples] (N × n_0)
Matrix smoothed_first_states(const Model& model, const Samples& samples);

}  // namespace tokid::kalman
