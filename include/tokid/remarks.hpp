// What a user should be told beside a result.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// What was noted when the data were read, a sample time that they don't state, and axes that look swapped.
// Beside a model its sample time stands in.
Findings remarks(const Ensemble& data);
Findings remarks(const Model& model, const Ensemble& data);

// Where a simulation of these inputs begins: "zero state", "mean initial state", or, with `estimate`, as
// simulate_data() does it, "state that the first samples tell".
std::string simulation_start(const Model& model, const Ensemble& inputs, bool estimate);

// Of simulate() or simulate_data() and its result, and of predict(). The differences of model and data come first.
Findings simulation_remarks(const Model& model, const Ensemble& inputs, const Ensemble& simulated, bool estimate);
Findings prediction_remarks(const Model& model, const Ensemble& data, const Ensemble& predicted);

// What was done with the mean motion by this test, why, and which channels depart at which steps: for one line of a
// table. `inputs`: how many of the channels are inputs. With a period the steps are phases.
std::string nominal_remark(const NominalTest& test, const Channels& names, Index inputs, Index period);

}  // namespace tokid
