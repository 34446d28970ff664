// GTV-ARX → system and observer-gain Markov parameters (20)-(36).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/gtv_arx.hpp"

namespace tokid {

// Only the band 1 ≤ γ = k-i ≤ band is computed and kept: O(T·band·p) time, O(T·band) memory. The matrices of all steps
// lie side by side: an access is a view.
class Markov {
  template <class Blocks>
  auto block(Blocks& blocks, Index k, Index i, Index columns) const {  // of the steps k and i
    return blocks.middleCols((k * band + k - i - 1) * columns, columns);
  }

 public:
  Markov() = default;
  // T steps of r inputs and m outputs, with columns from `first` on: all zero.
  Markov(Index T, Index r, Index m, Index widest, Index first);

  Index inputs = 0, outputs = 0, band = 0;
  Index i_begin = 0;  // first column: 0, or where the regressions begin

  Index steps() const { return steps_; }
  bool has(Index k, Index i) const { return i >= i_begin && k > i && k - i <= band && k < steps(); }

  // Of step k: (m × band·r), block γ-1 is h_{k,k-γ} (28), (29); and (m × band·m), block γ-1 is h°_{k,k-γ} (34), (35)
  auto system(Index k) const { return system_.middleCols(k * band * inputs, band * inputs); }
  auto system(Index k) { return system_.middleCols(k * band * inputs, band * inputs); }
  auto gain(Index k) const { return gain_.middleCols(k * band * outputs, band * outputs); }
  auto gain(Index k) { return gain_.middleCols(k * band * outputs, band * outputs); }
  // Variances of the entries of system(k) to first order, with those of earlier entries taken as uncorrelated: a
  // measure of size, not a bound.
  auto system_noise(Index k) const { return system_noise_.middleCols(k * band * inputs, band * inputs); }
  auto system_noise(Index k) { return system_noise_.middleCols(k * band * inputs, band * inputs); }
  auto D(Index k) const { return D_.middleCols(k * inputs, inputs); }  // (m × r)
  auto D(Index k) { return D_.middleCols(k * inputs, inputs); }

  // h_{k,i} (m × r), h°_{k,i} (m × m), and the variances of the first
  auto h(Index k, Index i) const { return block(system_, k, i, inputs); }
  auto h(Index k, Index i) { return block(system_, k, i, inputs); }
  auto h_gain(Index k, Index i) const { return block(gain_, k, i, outputs); }
  auto h_gain(Index k, Index i) { return block(gain_, k, i, outputs); }
  auto h_noise(Index k, Index i) const { return block(system_noise_, k, i, inputs); }
  auto h_noise(Index k, Index i) { return block(system_noise_, k, i, inputs); }

 private:
  Index steps_ = 0;
  Matrix system_, system_noise_;  // (m × T·band·r)
  Matrix gain_;                   // (m × T·band·m)
  Matrix D_;                      // (m × T·r)
};

// \throws std::invalid_argument for band < 1, or where `arx` holds no noise shapes
Markov markov(const GtvArx& arx, Index band, const Execution& execution = {});

}  // namespace tokid
