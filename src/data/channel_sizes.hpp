// Sizes that make channels of different units comparable.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/ensemble.hpp"

namespace tokid {

// Root mean squares of `count` channels from `first` on, inputs before outputs; 1 for a channel that is zero.
Vector channel_sizes(const Ensemble& ensemble, Index first, Index count);

}  // namespace tokid
