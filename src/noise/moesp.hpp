// Pooled data → A, B, C, D of a time-invariant or periodic model by projections: PO-MOESP (M. Verhaegen,
// "Identification of the deterministic part of MIMO state space models given in innovations form from input-output
// data", Automatica 30, 1994), here for ensembles of any length and for periods.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/subspace.hpp"

namespace tokid {

// The next p outputs on the next p inputs U and the past p samples Z: M_g, the coefficients of Z, and the singular
// values of M_g times what of Z the inputs U don't explain, for each phase g. Data and options as for
// predictor_factors(). \throws std::invalid_argument as predictor_factors(), and without a period
PredictorFactors projection_factors(const Ensemble& ensemble, const GtvArx& arx, const SubspaceOptions& o);

// A and C by the shift between the observability matrices of successive phases; B, D and the initial states by the
// smallest simulation error; G by the covariances of the residuals on the state samples.
Model moesp(const Ensemble& ensemble, const GtvArx& arx, const PredictorFactors& factors, const SubspaceOptions& o);

}  // namespace tokid
