// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

// \throws std::invalid_argument if innovations and data differ in their numbers of experiments, steps or outputs
void check_innovations(const std::vector<Matrix>& innovations, const Ensemble& data);

}  // namespace tokid
