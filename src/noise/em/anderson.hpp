// Anderson acceleration of a fixed-point iteration x ← g(x).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <deque>
#include <optional>

#include "tokid/linalg.hpp"

namespace tokid::em {

// x_next = g - ΔG γ, with f = g(x) - x and the differences ΔF, ΔG of the last `depth` pairs of f and g. γ minimises ‖f
// - ΔF γ‖² + damping · tr(ΔFᵀΔF) · ‖γ‖². The damping limits γ if the pairs are nearly dependent.
class Anderson {
 public:
  explicit Anderson(size_t depth) : depth_(depth) {}
  void reset() { f_.clear(), g_.clear(); }
  // Returns the next x, or nothing until there are two pairs.
  std::optional<Vector> next(const Vector& x, const Vector& g);

 private:
  size_t depth_;
  std::deque<Vector> f_, g_;
};

}  // namespace tokid::em
