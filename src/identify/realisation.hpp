// What every identification does between its regressions and its model, be it from samples or from their factors.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/identify.hpp"
#include "tokid/tvera.hpp"

namespace tokid {

// Blocks of H_k, as asked for or as many as p lags and n states need.
TveraOptions tvera_options(const IdentifyOptions& options, Index lags, Index outputs, bool noisy);

// Of every step of the model: the covariance of its innovations, condition, rank and lag order of its regression.
void note_regressions(const GtvArx& arx, Model& model);

// In the coordinates asked for; `told` says where the reference frame ends.
Model in_frame(Model model, const IdentifyOptions& options, Index lags, std::string& told);

// \throws std::overflow_error for a model with infinite entries or such that are no numbers
void check_finite(const Model& model);

}  // namespace tokid
