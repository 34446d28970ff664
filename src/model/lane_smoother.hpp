// Kalman filter and smoother of single experiments, one in each lane of the vector instructions. Every experiment has
// its own covariances, because every one misses other samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <span>
#include <vector>

#include "linalg/lane_memory.hpp"
#include "model/moments.hpp"
#include "model/samples.hpp"
#include "tokid/model.hpp"

namespace tokid::kalman {

// A row of the samples and its group.
struct SingleRow {
  Index row = 0;
  const Alike* group = nullptr;
};

// The samples of at most `lanes` experiments. Arrays contain one number for each lane, which is zero where a sample is
// missing, and at steps after the last output of an experiment.
struct LaneSamples {
  // The number of experiments that are computed together. It is the same for all instruction sets, so that sums over
  // the experiments have the same bits.
  static constexpr Index lanes = 8;

  // What happens at a step in any of the lanes.
  struct Pattern {
    bool misses_inputs = false;
    bool misses_some_outputs = false;  // but not all of an experiment
    bool counts_agree = true;          // the experiments with outputs are those that continue
    double measured = 0, moved = 0;    // number of experiments with an output, and of those that continue
  };

  // `members`: 1 … lanes rows.
  LaneSamples(const Samples& samples, std::span<const SingleRow> members);

  std::vector<SingleRow> rows;
  Index steps = 0;  // up to the last output of any lane
  std::vector<Pattern> pattern;
  std::array<double, size_t(lanes)> outputs{};  // number of available output samples of each lane
  // For each step: inputs (r), outputs (m), 1 for an available output (m), the variance of a missing input (r), 1 if an
  // experiment has any output, and 1 if it continues at the next step.
  double *u = nullptr, *y = nullptr, *there = nullptr, *variance = nullptr, *measured = nullptr, *on = nullptr;
  linalg::LaneMemory memory;  // of these arrays
};

// The matrices of a model of constant state dimension, step by step in one array each.
struct LaneModel {
  explicit LaneModel(const Model& model, Index steps);
  Index n, r, m;
  std::vector<double> f, h;                  // [A B] (n × (n+r)), [C D] (m × (n+r))
  std::vector<double> process, measurement;  // covariances Q (n × n) and R (m × m)
  Vector x0_mean;
  Matrix x0_cov;
};

struct LaneStep;

// It keeps its memory from call to call.
class LaneSmoother {
 public:
  // For at most so many steps.
  LaneSmoother(Index steps, Index states, Index inputs, Index outputs);

  bool fits(const LaneModel& model) const { return n_ == model.n && r_ == model.r && m_ == model.m; }
  void filter(const LaneModel& model, const LaneSamples& samples, Vector& log_likelihood);
  // Also adds the second moments to `sums`.
  void smooth(const LaneModel& model, const LaneSamples& samples, Vector& log_likelihood, Moments& sums);

 private:
  std::vector<LaneStep> steps_of(const LaneModel& model, const LaneSamples& samples) const;
  void filter(const std::vector<LaneStep>& steps, const LaneModel& model, const LaneSamples& samples, bool smooth,
              Vector& log_likelihood);
  void add_moments(const LaneSamples& samples, Moments& sums) const;

  Index n_, r_, m_;
  // For each step: E[x_k | samples before k] (n), E[[x_k; u_k] | samples] (n+r), the covariance of the latent vector
  // given the samples up to k, the gain of the smoother.
  double *predicted_ = nullptr, *mean_ = nullptr, *filtered_ = nullptr, *smoother_ = nullptr;
  double *terms_ = nullptr, *first_cov_ = nullptr, *work_ = nullptr;
  std::vector<double> sums_;  // the second moments of each step, summed over the lanes
  linalg::LaneMemory memory_;
};

}  // namespace tokid::kalman
