// SPDX-License-Identifier: BSD-3-Clause
#include "channel_sizes.hpp"

#include <cmath>

namespace tokid {

Vector channel_sizes(const Ensemble& ensemble, Index first, Index count) {
  Vector sizes(count);
  for (Index c = 0; c < count; ++c) {
    const ChannelSummary s = channel_summary(ensemble, first + c);
    const double square = s.mean * s.mean + s.std * s.std;
    sizes(c) = square > 0 ? std::sqrt(square) : 1.0;
  }
  return sizes;
}

}  // namespace tokid
