// Markov parameters → A_k, B_k, C_k, D_k, G_k of every step (37)-(42): the time-varying eigensystem realisation
// algorithm (TVERA).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/markov.hpp"
#include "tokid/model.hpp"

namespace tokid {

struct TveraOptions {
  Index rows = 2;    // block rows of H_k = [h_{k+a,k-1-b}]; needs (rows-1)·m ≥ n
  Index cols = 2;    // block columns; needs cols·r ≥ n
  Index states = 0;  // largest number of states per step; 0: the numerical rank of H_k, too large for noisy data
  // A singular value σ_i(H_k) counts as zero below the smaller of two bounds: noise_factor · HankelFactor::error, and
  // 1e-9 · HankelFactor::scale.
  double noise_factor = 3.0;
  // Typical sizes of the outputs (m) and inputs (r); empty: 1. H_k is formed in these units, so that its singular
  // values do not depend on the units of the channels.
  Vector output_size = {}, input_size = {};
  Execution execution = {};
};

// H_k = U Λ Vᵀ = O_k 𝒞_{k-1}, O_k = U Λ^{1/2}, for every step from markov.i_begin on. Near both ends H_k has fewer
// blocks. Free responses are additional columns of H_k; with free responses, O_k has full rank from the first step on.
struct HankelFactor {
  Matrix u;                // (rows·m × q) left singular vectors of H_k in the units of TveraOptions
  Vector singular_values;  // (q)
  double scale = 0.0;      // σ_1, or the norm of D_k if that is larger
  double error = 0.0;      // expected Frobenius norm of the error of H_k, from the residuals of the regressions
};
struct HankelFactors {
  Index rows = 0, cols = 0;        // blocks of a complete H_k
  Index k_begin = 0;               // step of the first factor
  std::vector<HankelFactor> step;  // for the steps k_begin … T-1
};
// \throws std::invalid_argument for sizes that do not fit the band of the Markov parameters
HankelFactors hankel_factors(const Markov& markov, const FreeResponse& free, const TveraOptions& options);

// O_k↓: O_k without its first block row; O_{k+1}↑: as many first rows of O_{k+1}. A_k = (O_{k+1}↑)⁺ O_k↓, B_k =
// O_{k+1}⁺ [h_{k+1,k}; …], C_k = first block row of O_k, G_k = O_{k+1}⁺ P_{k+1} (38), (40). Every step has a model. The
// state dimension is min(states, rank H_k), so it grows at the start and falls at the end. \throws
// std::invalid_argument for factors of other steps or sizes than those of the Markov parameters
Model realise(const Markov& markov, const HankelFactors& factors, const TveraOptions& options);

// hankel_factors() and realise() in one call.
Model tvera(const Markov& markov, const FreeResponse& free, const TveraOptions& options);

}  // namespace tokid
