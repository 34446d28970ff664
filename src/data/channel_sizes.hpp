// The sizes by which channels of different units are made comparable.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/ensemble.hpp"

namespace tokid {

// Root mean squares of `count` channels from `first` on, inputs before outputs; 1 for those that rest.
Vector channel_sizes(const Ensemble& ensemble, Index first, Index count);

}  // namespace tokid
