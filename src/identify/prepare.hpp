// Measured experiments → the departures from which a model is identified.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "model/units.hpp"
#include "tokid/options.hpp"

namespace tokid {

struct Prepared {
  NominalTest nominal_test;        // filled if the choice was automatic
  std::optional<Nominal> nominal;  // the mean motion that was removed, in the units of the measurement
  // The weighted departures in `units`. Powers of two in the units of the channels therefore change no bit of a model.
  Ensemble data;
  Units units;
  Findings findings;
};

// `weights`: of the measured experiments. \throws std::invalid_argument if a mean motion is asked for and there is only
// one experiment
Prepared prepare(const Ensemble& measured, const Vector& weights, const IdentifyOptions& options);

}  // namespace tokid
