// Anderson's acceleration of a fixed-point iteration x ← g(x).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "tokid/linalg.hpp"

namespace tokid::em {

// With f = g(x) - x, and ΔF, ΔG the differences of the last `depth` pairs: x_next = g - ΔG γ, where γ minimises
// ‖f - ΔF γ‖² + damping · tr(ΔFᵀΔF) · ‖γ‖², the damping keeping it within what the pairs can tell.
class Anderson {
 public:
  explicit Anderson(size_t depth) : depth_(depth) {}
  void reset() { f_.clear(), g_.clear(); }
  // Nothing before there are two pairs.
  std::optional<Vector> next(const Vector& x, const Vector& g);

 private:
  size_t depth_;
  std::deque<Vector> f_, g_;
};

}  // namespace tokid::em
