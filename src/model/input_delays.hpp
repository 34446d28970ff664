// Dead times: inputs that act some steps later, and the states that hold them until then.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "model/delays.hpp"
#include "tokid/model.hpp"

namespace tokid {

// `delays`: (r) steps of dead time of each input.

// Input i of a step becomes that of delays[i] steps earlier. Before the first step, inputs are zero.
Ensemble delayed(Ensemble ensemble, const std::vector<Index>& delays);
Matrix delayed(Matrix inputs, const std::vector<Index>& delays);  // (T × r), one experiment

// The model of the inputs themselves, from a model of the delayed inputs. Its states are those of `model`, and after
// them for each input the inputs of the steps before, the last one first.
Model of_undelayed(Model model, const std::vector<Index>& delays);

}  // namespace tokid
