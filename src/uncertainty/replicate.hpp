// Identifies a model once more: from other weights of the experiments, or with weaker smoothing over time.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/uncertainty.hpp"

namespace tokid::uncertainty {

// Did EM make the model? Replicates then start from the model, because EM continues from any model.
bool by_em(const Model& model);

// λ of the last step that made the model: EM, or the regressions. 0: each step has its own matrices. Infinity: all
// steps share one model.
double smoothing_of(const Model& model);

// How close EM comes to the most likely model of a replicate. Outputs and Markov parameters need few iterations.
enum class Care { usual, thorough };

// Identifies with the options, orders and choices of the model, and with its λ times `share`.
Identifier identifier(const Model& model, const IdentifyOptions& identification, double share = 1.0,
                      Care care = Care::usual);

// The unknowns of a regression of the states on states and inputs. If steps share a model, they share their rows as
// well.
Index unknowns_of_states(const Model& model, Index steps);

}  // namespace tokid::uncertainty
