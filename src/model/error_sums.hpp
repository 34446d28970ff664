// How far computed outputs are from measured ones, as sums that add up over steps and stretches.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <type_traits>
#include <vector>

#include "tokid/validate.hpp"

namespace tokid {

// Of one output.
struct ErrorSums {
  Index count = 0;
  double mean = 0.0, spread = 0.0;  // of the measured samples, and their squared deviations from it
  double error = 0.0;               // squared errors

  void add(const ErrorSums& later);
};

struct ErrorTotals {
  std::vector<ErrorSums> one_step, simulation;  // (m)
  double innovation = 0.0, output = 0.0;        // squares of what was predicted

  void add(const ErrorTotals& later);
  // Innovations beyond rounding errors.
  bool noisy() const;
};

// Of departures from a nominal trajectory, the spread of the outputs is that about zero.
Fit fit_of(const std::vector<ErrorSums>& sums, bool departures);

// Collects the errors of prediction and simulation, step by step.
class ErrorCollector {
 public:
  // The outputs of the data are compared as departures from the nominal trajectory (T × m), where there is one.
  ErrorCollector(const Ensemble& data, const Matrix& y_nominal);

  // Errors (N × m) of step k, NaN where there is none. The sums of the outputs are kept for
  // one step: both errors of a step are cheapest one after the other.
  void predicted(Index k, const Matrix& error);
  void simulated(Index k, const Matrix& error);

  ErrorTotals totals;
  // The first steps with an error.
  std::optional<Index> first_predicted, first_simulated;

 private:
  ErrorSums sums_of(Index k, const Matrix& error, Index j);

  const Ensemble& data_;
  const Matrix& y_nominal_;
  Index step_ = -1;
  std::vector<ErrorSums> outputs_;  // of that step
  Vector y_;
};

// For messages between processes.
template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, ErrorTotals>
void fields(Archive& archive, T& t) { archive(t.one_step, t.simulation, t.innovation, t.output); }

}  // namespace tokid
