// Predictions of held-out experiments → their errors at the horizons of use.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <vector>

#include "tokid/choices.hpp"
#include "tokid/model.hpp"

namespace tokid {

// Smaller relative errors of an output are raised to this share of the largest relative error. Otherwise the logarithm
// of an exact output, such as a recorded command, would outweigh the errors of all other outputs.
inline constexpr double least_counted = 1e-3;

// A larger order must reduce the error of subspace models by the factor `worth_it`. If the errors are uncertain, the
// required factor is higher, but at most `most_uncertain`.
inline constexpr double worth_it = 1.005, most_uncertain = 1.02;

// Squared errors and squared outputs of each experiment (N × H·m), at the horizons one after the other.
struct Squares {
  Matrix errors, outputs;
  Squares() = default;
  Squares(Index experiments, Index columns)
      : errors(Matrix::Zero(experiments, columns)), outputs(Matrix::Zero(experiments, columns)) {}

  // Adds one step of `measured` at horizon i. NaN in `predicted` (N × m) or in the measured outputs does not count.
  void add(Index i, const ConstMatrixRef& predicted, const Ensemble& measured, Index k);
};

// Predicted outputs (N × T m) at each horizon. NaN where a model cannot predict, or where nothing was predicted.
using Predicted = std::vector<Matrix>;

// The experiments of one fold after those of the other.
Squares joined(const std::vector<Squares>& folds);

// First step of the errors. With unknown initial states, every model can predict from this step on, and no output from
// this step on is used to estimate an initial state.
Index first_scored(InitialState initial, Index lags, Index period);

// The predictions whose errors count.
struct Ahead {
  Index from = 0;               // first step that is predicted
  std::vector<Index> horizons;  // ascending, the first is 1
  Index every = 2;              // predictions of more than one step begin at every so many steps

  // Do predictions of all horizons begin at this step of so many? One step ahead, they begin at every step.
  bool all_begin(Index step, Index steps) const { return step % every == 0 && step + horizons.back() <= steps; }
};

// The horizons that are at most half of the steps from `from` on; 1 always stays. Predictions begin at every step if
// the steps differ by their phase or by missing samples.
Ahead ahead_in(const Ensemble& data, Index from, std::vector<Index> horizons, Index period);

Model of_departures(Model model, const Ensemble& data);  // with a mean motion of zero
// The outputs that a model of departures predicts.
Predicted predicted_by(Model model, const Ensemble& departures, InitialState initial, const Ahead& ahead);
// Their squares. With `like`, only the samples count that `like` predicts too.
Squares squares_of(const Predicted& predicted, const Ensemble& departures, const Ahead& ahead,
                   const Predicted* like = nullptr);

// An error of predictions of held-out experiments: the logarithm of error divided by departure, averaged over horizons
// and outputs. Several steps ahead it is at most 0, the error of predicting the mean motion.
struct HeldOutError {
  double value = std::numeric_limits<double>::infinity();
  Vector of_horizon;  // (H) whose mean is `value`
  Vector influence;   // (N) derivative of `value` with respect to the weight of each experiment; its mean is zero
};
// The error where a fold has no model.
HeldOutError infinite_error(const Ahead& ahead, Index experiments);
// Standard error of the difference of two errors.
double standard_error(const HeldOutError& a, const HeldOutError& b);
// Is error a smaller than b by more than so many standard errors of their difference?
bool clearly_smaller(const HeldOutError& a, const HeldOutError& b, double standard_errors = 1.0);
// A candidate is given up if it is worse by more than so many standard errors over the experiments. A candidate that is
// as good is given up with a probability of 1e-3.
double errors_to_give_up(Index experiments);

// `weights`: of the outputs (m)
HeldOutError held_out_error(const Squares& squares, const Vector& weights);
// The same errors at each horizon, without logarithm and least error.
HeldOutErrors errors_at_horizons(const Squares& squares, const Vector& weights);

}  // namespace tokid
