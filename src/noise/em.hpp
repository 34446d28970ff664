// Refinements that share what EM needs of their data.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "noise/em/em_data.hpp"
#include "tokid/em.hpp"

namespace tokid::em {

// refine() with data that serve several refinements. They must have been made from this ensemble, and with a model of
// the same nominal trajectory. Made and kept in `data`, if it is empty.
Refinement refine(const Model& model, const Ensemble& ensemble, std::optional<Data>& data,
                  const RefineOptions& options);

}  // namespace tokid::em
