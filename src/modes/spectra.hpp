// Poles and shapes of the frozen systems of all steps.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "modes/tracks.hpp"
#include "tokid/model.hpp"

namespace tokid::modes_of {

struct Spectra {
  Index begin = 0;              // first step
  Index window = 0;             // W
  std::vector<StepModes> step;  // columns in any order
};
// \throws std::invalid_argument as modes()
Spectra spectra(const Model& model, Index window, const Execution& execution);

// The poles (S × n) of `found` at the steps from `begin` on, in the order of `original` (S × n): each pole is assigned
// to a near one. NaN at steps without poles of both.
Eigen::MatrixXcd poles_in_order(const Eigen::MatrixXcd& original, Index begin, const Spectra& found);

}  // namespace tokid::modes_of
