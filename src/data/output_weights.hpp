// Weights of the outputs: how much each output matters in choices and for the states that are kept.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/types.hpp"

namespace tokid {

// The weights divided by the largest one (m), because only their ratios matter. Empty if all are equal: then all
// outputs count alike. \throws std::invalid_argument for another number of weights than m
Vector relative_weights(const std::vector<double>& stated, Index outputs);

// The weights (m), or ones if they are empty. \throws as above
Vector weights_of(const Vector& weights, Index outputs);

// 1/√w (m): the factors by which the weights enlarge the units of the outputs in a realisation. An output has at least
// the weight `least_weight` here. An output of weight 0 would otherwise have no finite unit.
Vector unit_factors(const Vector& weights, Index outputs);
inline constexpr double least_weight = 1e-8;

}  // namespace tokid
