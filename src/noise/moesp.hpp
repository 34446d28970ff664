// Pooled data → A, B, C, D of a time-invariant or periodic model by projections: PO-MOESP (M. Verhaegen,
// "Identification of the deterministic part of MIMO state space models given in innovations form from input-output
// data", Automatica 30, 1994). This implementation takes ensembles of any length, and periods.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/subspace.hpp"

namespace tokid {

// For each phase g, regresses the next f outputs on the next f inputs U and the past p samples Z. The result has M_g,
// the coefficients of Z. It also has the singular values of M_g times the part of Z that U does not explain. Data and
// options are those of predictor_factors().
// \throws std::invalid_argument as predictor_factors(), and without a period
PredictorFactors projection_factors(const Ensemble& ensemble, const GtvArx& arx, const SubspaceOptions& o);

// A and C come from the shift between the observability matrices of successive phases. B, D and the initial states
// minimise the simulation error. G comes from the covariances of the residuals on the state samples.
Model moesp(const Ensemble& ensemble, const GtvArx& arx, const PredictorFactors& factors, const SubspaceOptions& o);

}  // namespace tokid
