// Changes of the coordinates of states, as frames and joints of models need them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/model.hpp"

namespace tokid {

// Can the state be computed from the outputs that these rows give? It can if the matrix has full column rank, and its
// smallest singular value is so large that at most half of the digits are lost.
bool determines_state(const Matrix& rows);

// Changes the last step so that the state after it has the coordinates x' = S x, where S = `s`.
void lead_into(Model& model, const Matrix& s);

}  // namespace tokid
