// How large the channels of experiments are, how far the experiments differ, and what their digits resolve.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

// Root mean square of a difference that is rounding, as a share of the usual departure of a channel. Sensors have more
// noise than this, and copies that were computed with anew differ by less.
inline constexpr double rounding_of_departures = 4e-6;
// The same of the size of a channel: rounding of sums in double precision.
inline constexpr double rounding_of_sizes = 1e-12;
// Rounding to so few digits that the error is a larger share of the departures says nothing.
inline constexpr double coarsest_share = 0.05;

// What the decimal digits or the bits of a channel of an experiment resolve.
struct Precision {
  enum class Kind { full, single, decimal } kind = Kind::full;
  int significant = 0, decimals = 0;  // digits, of decimal ones

  bool operator==(const Precision&) const = default;
  double rounding(double value) const;  // half a unit of the last place of this value
};

// Of departures from the median over the experiments: single experiments that are far off change little.
struct Scales {
  std::vector<Index> steps;          // where all of this was measured, evenly spread
  Matrix spread;                     // (steps × d) median departure of each step
  Vector departure;                  // (d) usual departure of a channel, root mean square
  Matrix own;                        // (N × d) departure of each experiment
  Vector arithmetic;                 // (d) rounding of sums in a channel
  std::vector<Precision> precision;  // (N·d)

  const Precision& precision_of(Index n, Index c) const { return precision[size_t(n * departure.size() + c)]; }
};
Scales scales(const Ensemble& ensemble);

}  // namespace tokid
