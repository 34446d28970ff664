// Measured experiments → the departures from which a model is identified.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "model/units.hpp"
#include "tokid/options.hpp"

namespace tokid {

struct Prepared {
  NominalTest nominal_test;        // filled if the choice was automatic
  std::optional<Nominal> nominal;  // the mean motion that was removed, in the units of the measurement
  // The weighted departures in `units`, with delayed inputs, in the order of content_order(). The order of the measured
  // experiments, and powers of two in the units of the channels, therefore change no bit of a model.
  Ensemble data;
  Units units;
  std::vector<Index> delays;  // (r) dead times; empty: none
  Findings findings;
};

// `measured_weights`: of the measured experiments. \throws std::invalid_argument if a mean motion is asked for and there
// is only one experiment, or for another number of dead times than inputs, or dead times that are longer than the
// experiments
Prepared prepare(const Ensemble& measured, const Vector& measured_weights, const IdentifyOptions& options);

}  // namespace tokid
