// GTV-ARX → system and observer-gain Markov parameters (20)-(36).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "tokid/gtv_arx.hpp"

namespace tokid {

// Only the band 1 ≤ γ = k-i ≤ band is computed and kept: O(T·band·p) time, O(T·band) memory.
struct Markov {
  Index inputs = 0, outputs = 0, band = 0;
  Index i_begin = 0;                 // first column: 0, or where the regressions begin
  std::vector<Matrix> system;        // (T) of (m × band·r): block γ-1 of step k is h_{k,k-γ}            (28), (29)
  std::vector<Matrix> gain;          // (T) of (m × band·m): block γ-1 of step k is h°_{k,k-γ}           (34), (35)
  std::vector<Matrix> system_noise;  // (T) of (m × band·r): variances of the entries of `system` to first order, with
                                     // those of earlier entries taken as uncorrelated: a measure of size, not a bound
  std::vector<Matrix> D;             // (T) of (m × r)

  Index steps() const { return static_cast<Index>(system.size()); }
  bool has(Index k, Index i) const { return i >= i_begin && k > i && k - i <= band && k < steps(); }
  auto h(Index k, Index i) const { return system[size_t(k)].middleCols((k - i - 1) * inputs, inputs); }
  auto h_gain(Index k, Index i) const { return gain[size_t(k)].middleCols((k - i - 1) * outputs, outputs); }
  auto h_noise(Index k, Index i) const { return system_noise[size_t(k)].middleCols((k - i - 1) * inputs, inputs); }
};

// \throws std::invalid_argument for band < 1, or where `arx` holds no noise shapes
Markov markov(const GtvArx& arx, Index band, const Execution& execution = {});

}  // namespace tokid
