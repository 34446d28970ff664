// Experiments of a time-invariant system → the constant of its outputs.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "tokid/ensemble.hpp"
#include "tokid/model.hpp"

namespace tokid {

struct Constant {
  double statistic = 0.0, threshold = 0.0;  // F of the constant in a regression, its 0.999 quantile; 0: not tested
  Vector at_rest;                           // (m) the outputs at rest with inputs of zero

  bool significant() const { return statistic > threshold; }
};

// The constant c of y_k = Σ A_i y_{k-i} + Σ B_i u_{k-i} + c, and y = (I - Σ A_i)⁻¹ c. Not tested with few samples, or
// if they do not determine y within its standard deviation, as those of integrators.
Constant test_constant(const Ensemble& ensemble);
// (m) The constant that is left in departures, by generalised least squares of the innovations of their model. It is far
// more accurate than that of a regression, because the model has fewer unknowns and noise does not bias it. Without a
// value if the samples do not determine it within the standard deviation of the outputs, as those of integrators.
std::optional<Vector> remaining_constant(const Model& model, const Ensemble& departures, InitialState initial);

}  // namespace tokid
