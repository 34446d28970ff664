// SPDX-License-Identifier: BSD-3-Clause
#include "control/system_digest.hpp"

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "model/continuation.hpp"

namespace tokid {

std::uint64_t digest_of_system(const Model& model, Index begin, Index end) {
  XXH3_state_t state;
  XXH3_64bits_reset(&state);
  for (Index k = begin; k < end; ++k) {
    const Step& step = step_at(model, k);
    for (const Step::View& part : {step.A(), step.B(), step.C(), step.D()}) {
      const std::int64_t shape[] = {part.rows(), part.cols()};
      XXH3_64bits_update(&state, shape, sizeof(shape));
      XXH3_64bits_update(&state, part.data(), size_t(part.size()) * sizeof(double));
    }
  }
  return XXH3_64bits_digest(&state);
}

}  // namespace tokid
