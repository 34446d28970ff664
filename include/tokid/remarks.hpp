// Findings that accompany a result.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/model.hpp"

namespace tokid {

// Findings from reading the data: remarks of the reader, a missing sample time, and axes that look swapped. With a
// model, its sample time replaces a missing one.
Findings remarks(const Ensemble& data);
Findings remarks(const Model& model, const Ensemble& data);

// Findings about the samples that an identification also reports: experiments that are not used, steps that too few
// experiments reach, and channels that tell nothing. Empty for data without outputs.
Findings sample_remarks(const Ensemble& data);

// The initial state of a simulation of these inputs: "zero state" or "mean initial state". With `estimate`, as for
// simulate_data(), also "state that the first samples determine".
std::string simulation_start(const Model& model, const Ensemble& inputs, bool estimate);

// Findings on the result of simulate() or simulate_data(), and of predict(). The differences of model and data come
// first.
Findings simulation_remarks(const Model& model, const Ensemble& inputs, const Ensemble& simulated, bool estimate);
Findings prediction_remarks(const Model& model, const Ensemble& data, const Ensemble& predicted);

// One line for a table: whether the mean motion was removed by this test, why, and which channels depart at which
// steps. `inputs` is the number of input channels. With a period, the steps are phases.
std::string nominal_remark(const NominalTest& test, const Channels& names, Index inputs, Index period);

}  // namespace tokid
