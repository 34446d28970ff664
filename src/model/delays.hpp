// The dead times of the inputs: (r) steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <numeric>
#include <vector>

#include "tokid/provenance.hpp"

namespace tokid {

// The number of states that hold inputs on their way.
inline Index held_inputs(const std::vector<Index>& delays) {
  return std::accumulate(delays.begin(), delays.end(), Index{0});
}

// The longest dead time; 0 if there is none.
inline Index latest(const std::vector<Index>& delays) { return delays.empty() ? 0 : std::ranges::max(delays); }

// Empty if the model was identified without dead times.
inline std::vector<Index> delays_of(const Provenance& provenance) {
  return provenance.choices ? provenance.choices->delays : std::vector<Index>{};
}

}  // namespace tokid
