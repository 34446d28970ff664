// The part of the Kalman filter and smoother that depends on no sample: the gains and covariances of all steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <vector>

#include "model/filter_step.hpp"
#include "model/samples.hpp"

namespace tokid::kalman {

// The covariances of one step and one pattern of missing samples. The latent vector l_k = [x_k; missing inputs] has q
// entries. F = [A B], with those columns of B that belong to missing inputs.
struct StepCovariance : Correction {
  Matrix predicted;  // (n⁺ × n⁺) of x_{k+1} given the samples up to k
  Matrix smoother;   // J (q × n⁺): the gain from an error of x_{k+1} to l_k
  Matrix smoothed;   // (q × q) of l_k given all samples
};

// The covariance of what the M-step regresses on each other.
struct JointCovariance {
  // Of [x_k; u_k; x_{k+1}; y_k] given all samples. Without x_{k+1} at the last step. Only the lower triangle of the
  // block of y_k counts.
  Matrix covariance;
  // Where some outputs are missing, the expected y_k is L y_k + M [x_k; u_k]: L (m × m) and M (m × (n+r)).
  Matrix from_outputs, from_states_and_inputs;
};

// True if some outputs are available, and others are not.
inline bool partly_missing(const std::vector<Index>& there, Index outputs) {
  return !there.empty() && Index(there.size()) < outputs;
}

// Covariances do not depend on samples. Where successive steps have the same matrices and the same missing samples,
// they settle: from step to step they change by less than nearly_equal() sees. The steps then share them.
class Covariances {
 public:
  // Runs the filter, and with `smooth` also the smoother.
  void compute(const Model& model, const Samples& samples, const Alike& group, bool smooth);
  // The joint covariance at step t. The smoother must have run.
  void join(const Model& model, const Alike& group, size_t t, JointCovariance& joint) const;

  const StepCovariance& at(size_t t) const { return distinct_[place_[t]]; }
  // Is the joint covariance at step t that at step t-1?
  bool joint_as_before(size_t t) const {
    return t > 0 && t + 1 < place_.size() && place_[t - 1] == place_[t] && place_[t + 1] == place_[t];
  }

 private:
  StepCovariance& add(size_t t);
  void smooth_backwards(const Model& model, const Alike& group);

  std::deque<StepCovariance> distinct_;  // the first used_ ones are valid
  size_t used_ = 0;
  std::vector<size_t> place_, filtered_;  // of each step in distinct_, and that after the filter
  FilterCovariance filter_;
  Matrix f_, w_, wfp_, r_, left_, product_, cross_;  // kept to reuse their memory
};

}  // namespace tokid::kalman
