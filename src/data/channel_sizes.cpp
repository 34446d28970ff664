// SPDX-License-Identifier: BSD-3-Clause
#include "data/channel_sizes.hpp"

#include <cmath>

namespace tokid {

Vector channel_sizes(const Ensemble& ensemble, Index first, Index count) {
  Vector sizes(count);
  for (Index c = 0; c < count; ++c) {
    double total = 0.0;
    Index samples = 0;
    for (Index k = 0; k < ensemble.steps(); ++k) {
      const auto column = ensemble.samples().col(k * ensemble.channels() + first + c).array();
      const double square = column.square().sum();
      if (std::isnan(square)) {
        total += column.isNaN().select(0.0, column).square().sum();
        samples += column.size() - column.isNaN().count();
      } else {
        total += square;
        samples += column.size();
      }
    }
    sizes(c) = total > 0 ? std::sqrt(total / double(samples)) : 1.0;
  }
  return sizes;
}

}  // namespace tokid
