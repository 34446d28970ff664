// Checks by sizes and samples whether the axes of the samples are the expected ones, (N, T, channels).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <optional>
#include <stdexcept>
#include <string>

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

// If the axes look swapped, reports how the axes were read and which order is expected.
std::optional<Finding> swapped_axes(const Ensemble& ensemble);

// Runs work on the ensemble. If the work refuses the data, and the axes look swapped, the message also says how the
// axes were read. The message of the work alone would mislead the user.
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
