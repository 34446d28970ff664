// The names that data give to their experiments.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/types.hpp"

namespace tokid {

// What is wrong with the names of so many experiments; empty where nothing is, as for no names at all.
std::string fault_of_experiment_names(const std::vector<std::string>& names, Index experiments);

// Is each name the number of its row?
bool are_row_numbers(const std::vector<std::string>& names);

// Those of the rows chosen, without names their numbers; none where a row is chosen twice, as names are different.
std::vector<std::string> names_of_subset(const std::vector<std::string>& names, const std::vector<Index>& chosen);

}  // namespace tokid
