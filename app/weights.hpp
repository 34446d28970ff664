// Weights and limits of channels on the command line.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "command.hpp"
#include "tokid/types.hpp"

namespace tokid::app {

using Weights = std::vector<double>;  // one for all channels, or one for each; empty: none

// The option takes "0.5" or "0.5,2,1".
void add_weights(Command& command, const char* option, Weights& target, const char* description);
// The same for numbers of any sign.
void add_limits(Command& command, const char* option, Weights& target, const char* description);

// The diagonal matrix of the weights. \throws std::invalid_argument for another number of weights
Matrix diagonal(const char* option, const Weights& weights, Index channels);

}  // namespace tokid::app
