// Compares the bounds from the factors with the scatter that two halves of the experiments show.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "tokid/uncertainty.hpp"

namespace tokid::uncertainty {

// The share of the Markov parameters of two disjoint halves of the experiments that agree within 95 % bounds of their
// difference. Empty if a half leaves no degree of freedom at half of the steps.
std::optional<double> agreement_of_halves(const Ensemble& data, const GtvArxOptions& regressions, Index band,
                                          const Execution& execution);

}  // namespace tokid::uncertainty
