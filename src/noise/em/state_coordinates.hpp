// Coordinates of the states in which the matrices of a model change less from step to step.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "linalg/matrix_list.hpp"
#include "tokid/linalg.hpp"

namespace tokid::em {

// ½ Σ_k tr( Ω⁻¹ (Θ_{k+1} - Θ_k) W (Θ_{k+1} - Θ_k)ᵀ ) for Θ = [A B] and Θ = [C D], each with its own Ω and W = diag(w).
// Changes at jumps do not count.
struct Variation {
  Matrix process_reference, measurement_reference;  // Ω (n × n), (m × m)
  Vector process_weight, measurement_weight;        // w (n+r)
  std::vector<Index> jumps = {};                    // ascending: the steps k+1

  // ab: (T) n × (n+r); cd: (T) m × (n+r)
  double of(const linalg::MatrixList& ab, const linalg::MatrixList& cd) const;
};

struct Coordinates {
  linalg::MatrixList ab, cd;  // [A B] and [C D] in the new coordinates
  std::vector<Matrix> s;      // (T+1) S_k (n × n): the new states are S_k x_k. S_0 = I
};

// W with W S Wᵀ = I, lower triangular; a direction without variance has a zero row.
Matrix whitener_of(const Matrix& covariance);

// Coordinates with less variation, by a few Gauss-Newton steps, or nothing if these find none. Inputs and outputs of
// the model stay the same. It takes O(T n³) operations.
std::optional<Coordinates> with_less_variation(const linalg::MatrixList& ab, const linalg::MatrixList& cd,
                                               const Variation& variation);

}  // namespace tokid::em
