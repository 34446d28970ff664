// How well a stretch of a model predicts and simulates the samples of the steps it is kept for, as sums that add up
// over stretches.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <type_traits>

#include "tokid/validate.hpp"

namespace tokid::stream {

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
};

// Of departures from a nominal trajectory, the spread of the outputs is that about zero.
Fit fit_of(const std::vector<ErrorSums>& sums, bool departures);

// `data` are departures, as the model is one of departures; `initial` says what is known of the states at step 0 of the
// stretch, which begins `first` of all. The simulation of a later stretch starts at step `begin`, from the state that
// the samples before tell.
ErrorTotals evaluate(const Model& model, const Ensemble& data, Index begin, Index end, InitialState initial,
                     bool first);

// For messages between processes.
template <class Archive, class T>
requires std::is_same_v<std::remove_const_t<T>, ErrorTotals>
void fields(Archive& archive, T& t) { archive(t.one_step, t.simulation, t.innovation, t.output); }

}  // namespace tokid::stream
