// Whether data have the channels that a model is of.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

// \throws std::invalid_argument for other numbers of inputs, or of outputs where these are needed; it also says how the
// axes of the data were read, where they look swapped
void check_channels(const Model& model, const Ensemble& data, bool with_outputs);

}  // namespace tokid
