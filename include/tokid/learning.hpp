// Iterative learning control: from a model, a reference and the last run to the inputs of the next run.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// The lifted map H of a model from the inputs of the steps begin … end-1 to the outputs of these steps, from rest: both
// are departures from the nominal trajectory, with one row for each of the S steps. Products take O(S).
class LiftedMap {
 public:
  // begin, end: -1 for the first step and the end of the model; a periodic model goes on, also beyond it.
  // \throws std::invalid_argument for steps outside the model
  explicit LiftedMap(Model model, Index begin = -1, Index end = -1);

  Index begin() const { return begin_; }
  Index steps() const { return steps_; }            // S
  Index inputs() const { return model_.inputs; }    // r
  Index outputs() const { return model_.outputs; }  // m

  // H u (S × m) for u (S × r), and Hᵀ y (S × r) for y (S × m). \throws std::invalid_argument for a wrong shape
  Matrix product(const ConstMatrixRef& u) const;
  Matrix transposed_product(const ConstMatrixRef& y) const;
  // H (S·m × S·r) with the channels of one step side by side. It takes O(S²) numbers.
  Matrix dense() const;

 private:
  Model model_;
  Index begin_, steps_;
};

// Weights of norm-optimal iterative learning: one matrix for all steps, or one for each step of the model in the run.
// Empty: zero.
struct LearningWeights {
  std::vector<Matrix> error = {};         // (m × m) of the error, reference minus output
  std::vector<Matrix> input = {};         // (r × r) of the input, as departure from the nominal trajectory
  std::vector<Matrix> input_change = {};  // (r × r) of the change of the input from the last run to the next
  // (r × r) of the change of the input from step to step, as departure from the nominal trajectory. Before step 0,
  // inputs count as nominal.
  std::vector<Matrix> input_rate = {};
};

struct LearnedRun {
  Matrix u;                // (T × r) inputs of the next run
  Matrix predicted;        // (T × m) its outputs: those of the last run plus H times the change of the inputs
  Vector error;            // (m) RMS of reference minus output in the last run, over the steps where both are known
  Vector predicted_error;  // (m) the same as predicted for the next run
};

// The inputs that minimise the weighted squares of the predicted error, the inputs, their change from the last run and
// their rate. This is a tracking problem, solved as lqr() solves it in O(T). All runs begin from the same state.
// reference (T × m): NaN where an output is free. u (T × r) and y (T × m): inputs and outputs of the last run, from
// step 0 on; NaN for a missing output. Inputs at steps without a model stay as they are. \throws std::invalid_argument
// for a wrong shape, a missing input, no output that has a reference, or weights as lqr() refuses them
LearnedRun learn(const Model& model, const Matrix& reference, const Matrix& u, const Matrix& y,
                 const LearningWeights& weights);

}  // namespace tokid
