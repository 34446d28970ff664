// SPDX-License-Identifier: BSD-3-Clause
#include "model/innovation_checks.hpp"

#include <fmt/format.h>

#include <stdexcept>

namespace tokid {

void check_innovations(const std::vector<Matrix>& innovations, const Ensemble& data) {
  const auto disagrees = [&](const Matrix& e) { return e.rows() != data.experiments() || e.cols() != data.outputs(); };
  if (static_cast<Index>(innovations.size()) != data.steps() ||
      std::any_of(innovations.begin(), innovations.end(), disagrees))
    throw std::invalid_argument(fmt::format("innovations: {} steps of {} x {} found, {} of {} x {} needed",
                                            innovations.size(), innovations.empty() ? 0 : innovations.front().rows(),
                                            innovations.empty() ? 0 : innovations.front().cols(), data.steps(),
                                            data.experiments(), data.outputs()));
}

}  // namespace tokid
