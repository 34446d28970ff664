// The names that data give to their experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/types.hpp"

namespace tokid {

// Describes what is wrong with the names of this number of experiments. Empty if nothing is wrong, or without names.
std::string fault_of_experiment_names(const std::vector<std::string>& names, Index experiments);

// Is each name the number of its row?
bool are_row_numbers(const std::vector<std::string>& names);

// Names of the chosen rows, or their numbers in data without names. Empty where a row is chosen twice, because names
// must differ.
std::vector<std::string> names_of_subset(const std::vector<std::string>& names, const std::vector<Index>& chosen);

}  // namespace tokid
