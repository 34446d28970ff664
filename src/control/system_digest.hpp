// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "tokid/model.hpp"

namespace tokid {

// A digest of A_k, B_k, C_k, D_k at the steps begin … end-1, which the model must have. It binds gains to the
// coordinates of their model.
std::uint64_t digest_of_system(const Model& model, Index begin, Index end);

}  // namespace tokid
