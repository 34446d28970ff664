// Sizes of the channels of experiments, differences between experiments, and the resolution of their digits.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

// Largest root mean square of a difference that counts as rounding, as a share of the typical departure of a channel.
// The noise of sensors is larger. Copies that were computed in another way differ by less.
inline constexpr double rounding_of_departures = 4e-6;
// Rounding error of sums in double precision, as a share of the size of a channel.
inline constexpr double rounding_of_sizes = 1e-12;
// The spread of values of this size; zero if rounding errors alone explain it.
inline double spread_above_rounding(double spread, double size) {
  return spread > rounding_of_sizes * std::abs(size) ? spread : 0.0;
}
// If the error of rounding to few digits is above this share of the departures, equal rounded values prove nothing.
inline constexpr double coarsest_share = 0.05;

// Resolution of a channel of an experiment, in decimal digits or bits.
struct Precision {
  enum class Kind { full, single, decimal } kind = Kind::full;
  int significant = 0, decimals = 0;  // decimal digits

  bool operator==(const Precision&) const = default;
  double rounding(double value) const;  // half a unit of the last place of this value
};

// Departures are differences from the median over the experiments, because single outliers hardly change a median.
struct Scales {
  std::vector<Index> steps;          // measured steps, evenly spread
  Matrix spread;                     // (steps × d) median departure of each step
  Vector departure;                  // (d) typical departure of a channel: median of `own`
  Matrix own;                        // (N × d) root mean square departure of each experiment
  Vector arithmetic;                 // (d) rounding of sums in a channel
  std::vector<Precision> precision;  // (N·d)

  const Precision& precision_of(Index n, Index c) const { return precision[size_t(n * departure.size() + c)]; }
};
Scales scales(const Ensemble& ensemble);

}  // namespace tokid
