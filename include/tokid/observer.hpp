// Observers of a model that is known or identified (Appendix B).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

// ‖Ā_{k+p-1} … Ā_k‖_F for k = k_begin … k_end-p (76)
std::vector<double> deadbeat_products(const Model& model, Index p);

// The gains of a deadbeat observer of the model: Ā_{k+p-1} … Ā_k = 0 for every k (76), where p is the number of steps
// after which the outputs tell the state. With S_0 = Rⁿ and S_{j+1}(k+1) = A_k (S_j(k) ∩ ker C_k), the states that j
// outputs could not see, G_k = -A_k L_k is chosen so that Ā_k maps S_j(k) into S_{j+1}(k+1); L_k lifts the outputs
// back along this flag. Unique where p·m = n (then it is the gain the paper identifies), else the one of smallest
// lifts.
struct DeadbeatGain {
  std::vector<Matrix> G;  // (S) n_{k+1} × m
  Index steps = 0;        // p: the steps after which every error is gone; more than S where some state is never seen
};
// Directions below tolerance·‖C_k‖ count as unseen, below tolerance·‖A_k‖ as gone.
DeadbeatGain deadbeat_gain(const Model& model, double tolerance = 1e-10);

}  // namespace tokid
