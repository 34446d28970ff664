// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/innovations.hpp"

namespace tokid {

// \throws std::invalid_argument where numbers of experiments, steps or outputs disagree
void check_innovations(const Innovations& innovations, const Ensemble& data);

}  // namespace tokid
