// Are the axes of the samples those that the library expects, (N, T, channels)? Their sizes and the samples tell.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <optional>
#include <stdexcept>
#include <string>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

// How the axes were read, and which order is expected, where they look swapped.
std::optional<Finding> swapped_axes(const Ensemble& ensemble);

// Runs work on the ensemble. Where it refuses the data, the message also says how their axes were read: what swapped
// axes lack is not what the user has to change.
template <class Work>
auto with_remark_on_axes(const Ensemble& ensemble, Work&& work) {
  try {
    return work();
  } catch (const std::invalid_argument& error) {
    if (const auto remark = swapped_axes(ensemble))
      throw std::invalid_argument(fmt::format("{}; {}", error.what(), in_words(*remark)));
    throw;
  }
}

}  // namespace tokid
