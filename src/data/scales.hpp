// Sizes of the channels of experiments, differences between experiments, and the resolution of their digits.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

// Root mean square of a difference that counts as rounding, as a share of the usual departure of a channel. Sensors
// have more noise than this. Copies that are the result of another computation differ by less.
inline constexpr double rounding_of_departures = 4e-6;
// The same as a share of the size of a channel, for the rounding of sums in double precision.
inline constexpr double rounding_of_sizes = 1e-12;
// Rounding to few digits shows nothing if its error is a larger share of the departures.
inline constexpr double coarsest_share = 0.05;

// Resolution of a channel of an experiment, in decimal digits or bits.
struct Precision {
  enum class Kind { full, single, decimal } kind = Kind::full;
  int significant = 0, decimals = 0;  // decimal digits

  bool operator==(const Precision&) const = default;
  double rounding(double value) const;  // half a unit of the last place of this value
};

// Departures are from the median over the experiments, because single outliers hardly change it.
struct Scales {
  std::vector<Index> steps;          // measured steps, evenly spread
  Matrix spread;                     // (steps × d) median departure of each step
  Vector departure;                  // (d) usual departure of a channel, root mean square
  Matrix own;                        // (N × d) departure of each experiment
  Vector arithmetic;                 // (d) rounding of sums in a channel
  std::vector<Precision> precision;  // (N·d)

  const Precision& precision_of(Index n, Index c) const { return precision[size_t(n * departure.size() + c)]; }
};
Scales scales(const Ensemble& ensemble);

}  // namespace tokid
