// Check that data have the channels of a model.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

// \throws std::invalid_argument for a wrong number of inputs, or of outputs if `with_outputs` is true. If the axes of
// the data look swapped, the message also says how the axes were read.
void check_channels(const Model& model, const Ensemble& data, bool with_outputs);

}  // namespace tokid
