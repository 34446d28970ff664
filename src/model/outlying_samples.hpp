// Innovations of all experiments → outlying samples. A sample is outlying if it is far from its prediction at a step at
// which other experiments are close to their predictions.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "tokid/validate.hpp"

namespace tokid {

// Collects outlying samples step by step. The usual error is a median over the experiments and over as many steps as
// give enough samples. At a step with much larger errors, it follows from the median of this step.
class OutlyingSampleCollector {
 public:
  // Ignores the experiments in options.misfits. Model and data must outlive the collector.
  OutlyingSampleCollector(const Model& model, const Ensemble& data, const ValidateOptions& options);

  // Adds the innovations (N × m) of the next step k, NaN where there is none.
  void add(Index k, const Matrix& innovation);
  // Returns the outlying samples after the last step, in the order of experiments and outputs. A faulty sample also
  // affects the predictions after it. Therefore experiments with outlying samples are predicted again without these
  // samples, until no other sample is far off.
  std::vector<OutlyingSamples> found();

 private:
  struct Flag {
    Index experiment, step, output;
    double error;
  };
  // True if no innovation is large enough to be reported.
  bool of_no_consequence(const Matrix& innovation) const;
  void collect(Index k, const Matrix& innovation);
  bool is_far(Index k, Index j, double error) const;
  void test_block(size_t from);
  // Raises the thresholds of outputs whose errors have heavier tails than a normal distribution.
  void adapt_to_tails();
  // The first flags of each experiment, and later flags that the first ones can't have caused.
  std::vector<Flag> first_of(std::vector<Flag> flags) const;
  std::vector<Flag> predicted_again(const Ensemble& part, const std::vector<Index>& rows) const;

  const Model& model_;
  const Ensemble& data_;
  std::optional<InitialState> initial_state_;
  bool begins_anywhere_;  // predictions begin at the mean of unknown initial states
  Vector spread_;         // (m) spread of the outputs
  // The steps so far have no error of consequence. Nothing of them is kept; if an error of consequence follows, they
  // are predicted again. Without noise the medians of all steps are thus never needed.
  bool quiet_ = true;
  Index skipped_ = 0;  // number of steps of which nothing was kept
  // number of steps that a fault affects, that determine a state, that are tested together
  Index window_, shown_, together_;
  std::vector<bool> is_misfit_;  // (N)
  std::vector<Index> gap_;       // (N) length of the present gap [steps]; -1: no prediction yet
  std::vector<Index> start_;     // (N) step of the first prediction
  // After a gap, or a start with missing samples, the state is uncertain. The state is certain again after enough right
  // predictions in a row to determine all of it.
  std::vector<Index> until_certain_;            // (N) right predictions still needed
  std::vector<std::vector<Index>> unreliable_;  // (N) steps of an uncertain state that are not tested
  std::vector<std::vector<Index>> restarts_;    // for each step of the block: experiments whose state becomes uncertain
  std::vector<Matrix> block_, previous_;        // innovations, NaN where they are not tested
  Index begin_ = 0;                             // first step of the block
  Matrix usual_;                                // (T × m) usual errors
  Vector far_;                                  // (m) errors above this multiple of the usual error are far off
  Matrix in_tail_, tested_;                     // (N × m) number of errors in the tails, and of all tested errors
  std::vector<Flag> flags_;
};

// The outlying samples that an OutlyingSampleCollector finds. \throws as predict()
std::vector<OutlyingSamples> outlying_samples(const Model& model, const Ensemble& data, const ValidateOptions& options);

// Converts outlying samples of a part of the data to the rows, names and steps of all data. The part has the names of
// its experiments and begins at step `first`.
std::vector<OutlyingSamples> outlying_in(const Ensemble& all, const Ensemble& part, Index first,
                                         std::vector<OutlyingSamples> outlying);

// (m) spread of each output: about the nominal trajectory if the model has one, otherwise about the mean. The spread of
// a constant output is 1.
Vector output_spread(const Model& model, const Ensemble& data);

// Findings on at most five outlying samples, and the number of further ones.
Findings findings_of(const std::vector<OutlyingSamples>& outlying, const Channels& names);

}  // namespace tokid
