// GTV-ARX → system and observer-gain Markov parameters (20)-(36).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/gtv_arx.hpp"

namespace tokid {

// Markov parameters. Only the band 1 ≤ γ = k-i ≤ band is computed and stored: O(T·band·p) time, O(T·band) memory. The
// matrices of all steps are stored side by side; each accessor returns a view.
class Markov {
  template <class Blocks>
  // for the output at step k and the pulse at step i
  auto block(Blocks& blocks, Index k, Index i, Index columns) const {
    return blocks.middleCols((k * band + k - i - 1) * columns, columns);
  }

 public:
  Markov() = default;
  // Allocates T steps with r inputs and m outputs, all zero. `widest` is the band and `first` is i_begin.
  Markov(Index T, Index r, Index m, Index widest, Index first);

  Index inputs = 0, outputs = 0, band = 0;
  Index i_begin = 0;  // smallest i: 0, or the step where the regressions begin

  Index steps() const { return steps_; }
  bool has(Index k, Index i) const { return i >= i_begin && k > i && k - i <= band && k < steps(); }

  // For step k, system(k) (m × band·r) has the block h_{k,k-γ} (28), (29) at γ-1, and gain(k) (m × band·m) has the
  // block h°_{k,k-γ} (34), (35) at γ-1.
  auto system(Index k) const { return system_.middleCols(k * band * inputs, band * inputs); }
  auto system(Index k) { return system_.middleCols(k * band * inputs, band * inputs); }
  auto gain(Index k) const { return gain_.middleCols(k * band * outputs, band * outputs); }
  auto gain(Index k) { return gain_.middleCols(k * band * outputs, band * outputs); }
  // Variances of the entries of system(k), to first order. The recursion takes the errors of earlier Markov parameters
  // as uncorrelated. The variances therefore measure the size of the errors, but do not bound them.
  auto system_noise(Index k) const { return system_noise_.middleCols(k * band * inputs, band * inputs); }
  auto system_noise(Index k) { return system_noise_.middleCols(k * band * inputs, band * inputs); }
  auto D(Index k) const { return D_.middleCols(k * inputs, inputs); }  // (m × r)
  auto D(Index k) { return D_.middleCols(k * inputs, inputs); }

  // h_{k,i} (m × r), h°_{k,i} (m × m), and the variances of h_{k,i}
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

// Computes the Markov parameters from the regressions. \throws std::invalid_argument for band < 1, or if `arx` has no
// noise shapes
Markov markov(const GtvArx& arx, Index band, const Execution& execution = {});

}  // namespace tokid
