// SPDX-License-Identifier: BSD-3-Clause
#include "uncertainty/smoothing_bias.hpp"

#include <algorithm>
#include <cmath>

namespace tokid::uncertainty {

namespace {

constexpr Index reach = 2;  // steps on either side

}  // namespace

void add_local_squares(const Vector& change, const PerStep& place, Vector& squares) {
  for (Index k = 0; k < place.steps; ++k)
    for (Index i = 0; i < place.size; ++i) {
      double sum = 0.0, count = 0.0;
      for (Index s = std::max<Index>(0, k - reach); s <= std::min(place.steps - 1, k + reach); ++s) {
        const double value = change(place.begin + s * place.size + i);
        if (std::isfinite(value)) sum += value * value, count += 1;
      }
      if (count > 0) squares(place.begin + k * place.size + i) += sum / count;
    }
}

void widen(Interval& interval, const Vector& squares, double t) {
  for (Index i = 0; i < squares.size(); ++i) {
    const double deviation = std::hypot(interval.deviation(i), std::sqrt(squares(i)));
    if (!(squares(i) > 0) || !std::isfinite(deviation)) continue;
    interval.deviation(i) = deviation;
    interval.lower(i) = interval.estimate(i) - t * deviation;
    interval.upper(i) = interval.estimate(i) + t * deviation;
  }
}

}  // namespace tokid::uncertainty
