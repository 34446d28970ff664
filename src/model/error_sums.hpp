// Sums of the errors of computed outputs, which add up over steps and stretches.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <type_traits>
#include <vector>

#include "tokid/validate.hpp"

namespace tokid {

// The sums of one output.
struct ErrorSums {
  Index count = 0;
  double mean = 0.0, spread = 0.0;  // mean of the measured samples, and sum of their squared deviations from it
  double error = 0.0;               // sum of squared errors

  void add(const ErrorSums& later);
};

struct ErrorTotals {
  std::vector<ErrorSums> one_step, simulation;  // (m)
  // sums of the squared innovations, and of the squares of the predicted outputs
  double innovation = 0.0, output = 0.0;

  void add(const ErrorTotals& later);
  // True if the innovations exceed rounding errors.
  bool noisy() const;
};

// The fit. If the outputs are departures from a nominal trajectory, their spread is about zero instead of their mean.
Fit fit_of(const std::vector<ErrorSums>& sums, bool departures);

// Collects the errors of prediction and simulation, step by step.
class ErrorCollector {
 public:
  // Compares the outputs of the data as departures from the nominal trajectory (T × m). Without one, y_nominal is
  // empty. The fits begin at first_step.
  ErrorCollector(const Ensemble& data, const Matrix& y_nominal, Index first_step);

  // Adds the errors (N × m) of step k; NaN without an error. The collector keeps the sums of the outputs for one step
  // only. Therefore add both errors of a step before the next step.
  void predicted(Index k, const Matrix& error);
  void simulated(Index k, const Matrix& error);

  ErrorTotals totals;
  // The first steps of the fits with an error.
  std::optional<Index> first_predicted, first_simulated;
  bool any_predicted = false;  // also before the first step of the fits

 private:
  ErrorSums sums_of(Index k, const Matrix& error, Index j);

  const Ensemble& data_;
  const Matrix& y_nominal_;
  Index first_step_;
  Index step_ = -1;
  std::vector<ErrorSums> outputs_;  // sums of the outputs at step_
  Vector y_;
};

// For messages between processes.
template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, ErrorTotals>
void fields(Archive& archive, T& t) { archive(t.one_step, t.simulation, t.innovation, t.output); }

}  // namespace tokid
