// What the tests of the innovations have in common: checks, samples and their scale.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

// \throws std::invalid_argument if innovations and data differ in their numbers of experiments, steps or outputs
void check_innovations(const std::vector<Matrix>& innovations, const Ensemble& data);

// A test needs more samples than this: with ν degrees of freedom, ν ≥ m + 2.
Index too_few(const std::vector<Matrix>& innovations);

// Samples minus their mean, as columns of norm 1. A constant column becomes zero.
Matrix unit_columns(Matrix samples);

// Replaces the missing inputs of each column by the mean of the others.
void fill_missing_inputs(Matrix& u);

}  // namespace tokid
