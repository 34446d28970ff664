// Innovations of all experiments → the samples that lie far off their predictions while those of others do not.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/validate.hpp"

namespace tokid {

// Collects them step by step. The usual error is the median over the experiments of a step, or over as many steps
// together as give enough samples, whichever is larger.
class OutlyingSampleCollector {
 public:
  // Experiments among options.misfits are not looked at. Model and data outlive the collector.
  OutlyingSampleCollector(const Model& model, const Ensemble& data, const ValidateOptions& options);

  // Innovations (N × m) of the next step k, NaN where there is none.
  void add(Index k, const Matrix& innovation);
  // After the last step, in the order of experiments and outputs. A faulty sample spoils the predictions that follow:
  // the experiments with outlying samples are predicted again without them, until no other sample lies far off.
  std::vector<OutlyingSamples> found();

 private:
  struct Flag {
    Index experiment, step, output;
    double error;
  };
  bool is_far(Index k, Index j, double error) const;
  void judge_block(size_t from);
  // The first flags of each experiment, and those that none of them can have caused.
  std::vector<Flag> first_of(std::vector<Flag> flags) const;
  std::vector<Flag> predicted_again(const Ensemble& part, const std::vector<Index>& rows) const;

  const Model& model_;
  const Ensemble& data_;
  std::optional<InitialState> initial_state_;
  Vector spread_;                    // (m) of the outputs
  Index window_, shown_, together_;  // steps that a fault spoils, that show a state, that are judged together
  std::vector<bool> is_misfit_;      // (N)
  std::vector<Index> gap_;           // (N) steps of the gap that goes on; -1: nothing was predicted yet
  // After a gap, or a start with missing samples, a state is certain when the predictions have been right for as many
  // steps as show all of it.
  std::vector<Index> until_certain_;            // (N) right steps that are left
  std::vector<std::vector<Index>> unreliable_;  // (N) steps at which they are not
  std::vector<std::vector<Index>> restarts_;  // of the steps of the block: experiments with a state that is not certain
  std::vector<Matrix> block_, previous_;      // innovations, NaN where they are not judged
  Index begin_ = 0;                           // first step of the block
  Matrix usual_;                              // (T × m) errors, NaN where no error of the block counts
  std::vector<Flag> flags_;
};

// As a collector finds them. \throws as predict()
std::vector<OutlyingSamples> outlying_samples(const Model& model, const Ensemble& data, const ValidateOptions& options);

// Of a part of the data, which keeps the names of the experiments and begins at step `first`: with the rows, names and
// steps that they have in all data.
std::vector<OutlyingSamples> outlying_in(const Ensemble& all, const Ensemble& part, Index first,
                                         std::vector<OutlyingSamples> outlying);

// (m) of each output about the nominal trajectory, where the model has one, else about its mean; 1 for a constant
// output.
Vector output_spread(const Model& model, const Ensemble& data);

// At most five, each with what may be done.
Findings findings_of(const std::vector<OutlyingSamples>& outlying, const Channels& names);

}  // namespace tokid
