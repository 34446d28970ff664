// Ensemble → triangular factors of the windows of all steps. Regressions need only these factors, not the samples.
// Factors of later experiments can therefore be merged into them without the old samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "tokid/ensemble.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

// Upper triangular R_k with R_kᵀR_k = [1 V_k]ᵀ[1 V_k] for the windows V_k = [v_{k-p} … v_k] (N_k × w, w = (p+1)·d). V_k
// has the experiments without a missing sample in the window. Samples before the start of the experiments are zero.
struct WindowFactors {
  Index inputs = 0, outputs = 0, lags = 0;          // r, m, p
  InitialState initial_state = InitialState::zero;  // zero: from step 0 on, unknown: from step p on
  double dt = 1.0;                                  // [s]
  Channels names;
  Index experiments = 0;    // N
  std::vector<Index> rows;  // (T) N_k, 0 before the first step
  Matrix factor;            // (w+1 × T·(w+1)) R_0 R_1 …, upper triangular
  // Statistics of each sample over the experiments that have it, in columns k·d … as in Ensemble. count: number of
  // samples; sum: their sum; spread: sum of the squared departures from their mean.
  Vector count, sum, spread;  // (T·d)

  Index channels() const { return inputs + outputs; }
  Index steps() const { return Index(rows.size()); }
  Index width() const { return (lags + 1) * channels(); }
  Index begin() const { return initial_state == InitialState::zero ? 0 : lags; }
  auto of(Index k) const { return factor.middleCols(k * (width() + 1), width() + 1); }
  auto of(Index k) { return factor.middleCols(k * (width() + 1), width() + 1); }
  // The mean motion over the experiments, as nominal_trajectory() computes it.
  Nominal nominal() const;
};

// Computes the factors. Successive steps share a factorisation as in gtv_arx(). \throws std::invalid_argument unless 1
// ≤ lags < T
WindowFactors window_factors(const Ensemble& ensemble, Index lags, InitialState initial_state,
                             const Execution& execution = {});

// Adds the experiments of `others` to `factors`. \throws std::invalid_argument as check_alike()
void merge(WindowFactors& factors, const WindowFactors& others, const Execution& execution = {});

// The input of regressions: the windows of an ensemble, or the factors R_k with fewer rows and the same products
// R_kᵀR_k.
class Windows {
 public:
  Windows(const Ensemble& ensemble);  // NOLINT(google-explicit-constructor): an ensemble has windows; refers to it
  // The windows from factors. If a mean motion is given, the windows are departures from it. The object refers to the
  // factors.
  explicit Windows(const WindowFactors& factors, const Nominal* nominal = nullptr);

  Index experiments() const { return experiments_; }
  Index steps() const { return steps_; }
  Index inputs() const { return inputs_; }
  Index outputs() const { return outputs_; }
  Index channels() const { return inputs_ + outputs_; }

  // [v_{k-p} … v_k] (any number of rows × (p+1)·d). Returns N_k, the number of experiments that the rows represent.
  // \throws std::invalid_argument for more lags than the factors have
  Index rows(Index k, Index lags, Matrix& rows) const;
  Index count(Index k, Index lags) const;  // N_k only
  Matrix rows(Index k, Index lags) const {
    Matrix result;
    rows(k, lags, result);
    return result;
  }
  // RMS of each channel over all experiments and steps, 1 for channels that are zero.
  Vector channel_sizes() const;                           // (d)
  const Ensemble* ensemble() const { return ensemble_; }  // null: only factors

  double dt = 1.0;
  Channels names;

 private:
  Index experiments_ = 0, steps_ = 0, inputs_ = 0, outputs_ = 0;
  const Ensemble* ensemble_ = nullptr;
  const WindowFactors* factors_ = nullptr;
  Vector mean_;  // (T·d); empty: none
};

// Window factors that have only the fields for check_alike(): sizes, names, dt and initial states.
WindowFactors kind_of(const Ensemble& ensemble, Index lags, InitialState initial_state);

// Checks that the windows of `factors` and `others` can be merged. \throws std::invalid_argument if not; the message
// names the difference
void check_alike(const WindowFactors& factors, const WindowFactors& others);

}  // namespace tokid
