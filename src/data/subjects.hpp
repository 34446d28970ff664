// Channels and experiments, as findings name them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/ensemble.hpp"
#include "tokid/finding.hpp"

namespace tokid {

inline Finding::Channel input_channel(const Channels& names, Index i) { return {false, i, names.input(i)}; }
inline Finding::Channel output_channel(const Channels& names, Index j) { return {true, j, names.output(j)}; }
// c: number of the channel, inputs before outputs
inline Finding::Channel channel(const Channels& names, Index inputs, Index c) {
  return c < inputs ? input_channel(names, c) : output_channel(names, c - inputs);
}

inline Finding::Experiment experiment(const Ensemble& ensemble, Index n) { return {n, ensemble.experiment_name(n)}; }
std::vector<Finding::Experiment> experiments(const Ensemble& ensemble, const std::vector<Index>& rows);

}  // namespace tokid
