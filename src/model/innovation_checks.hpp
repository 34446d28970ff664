// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

// \throws std::invalid_argument where numbers of experiments, steps or outputs disagree
void check_innovations(const std::vector<Matrix>& innovations, const Ensemble& data);

}  // namespace tokid
