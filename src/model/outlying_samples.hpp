// Innovations of all experiments → the samples that lie far off their predictions while others do not.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <utility>
#include <vector>

#include "tokid/validate.hpp"

namespace tokid {

// Collects them step by step. What is usual is the median over the experiments of the step, and over as many steps
// together as it takes for enough samples.
class OutlyingSampleCollector {
 public:
  // The spread (m) of the outputs is what errors have to be large against; see output_spread(). Misfits, by name, or by
  // row where they have none, are left aside.
  OutlyingSampleCollector(const Model& model, const Ensemble& data, Vector spread,
                          const std::vector<std::string>& misfits);

  // Innovations (N × m) of the next step k, NaN where there is none.
  void add(Index k, const Matrix& innovation);
  // After the last step. In the order of experiments and outputs.
  std::vector<OutlyingSamples> found();

 private:
  void judge_block();

  const Ensemble& data_;
  Vector spread_;
  Index window_, together_;             // steps that tell a state, and that are judged together
  std::vector<Index> uncertain_until_;  // (N) predictions behind a gap are worse, for as long as this
  std::vector<Index> gap_;              // (N) steps of the gap that goes on
  std::vector<Matrix> block_;           // innovations, NaN where they are not judged
  Index begin_ = 0;                     // first step of the block
  std::map<std::pair<Index, Index>, OutlyingSamples> found_;  // by experiment and output
};

// (m) of each output about the nominal trajectory, where the model has one, else about its mean; 1 for one at rest.
Vector output_spread(const Model& model, const Ensemble& data);

// At most five, each with what may be done.
std::vector<std::string> warnings_of(const std::vector<OutlyingSamples>& outlying, const Ensemble& data);

}  // namespace tokid
