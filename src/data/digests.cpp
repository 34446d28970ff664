// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <vector>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "data/canonical.hpp"
#include "tokid/ensemble.hpp"

namespace tokid {

std::vector<Digest> experiment_digests(const Ensemble& e) {
  // Samples are stored by columns but digested by rows. Tiles of samples are transposed within the first-level cache.
  constexpr Index most_rows = 32, most_columns = 64;
  const Index total = e.samples().cols();
  std::vector<XXH3_state_t> states(size_t(std::min(most_rows, e.experiments())));
  Matrix tile(most_rows, most_columns), turned(most_columns, most_rows);
  std::vector<Digest> result;
  for (Index begin = 0; begin < e.experiments(); begin += most_rows) {
    const Index rows = std::min(most_rows, e.experiments() - begin);
    for (Index n = 0; n < rows; ++n) XXH3_128bits_reset(&states[size_t(n)]);
    for (Index first = 0; first < total; first += most_columns) {
      const Index columns = std::min(most_columns, total - first);
      for (Index c = 0; c < columns; ++c)
        copy_canonical(e.samples().col(first + c).data() + begin, rows, tile.col(c).data());
      turned = tile.transpose();
      for (Index n = 0; n < rows; ++n)
        XXH3_128bits_update(&states[size_t(n)], turned.col(n).data(), size_t(columns) * sizeof(double));
    }
    for (Index n = 0; n < rows; ++n) {
      const XXH128_hash_t digest = XXH3_128bits_digest(&states[size_t(n)]);
      result.push_back({digest.high64, digest.low64});
    }
  }
  return result;
}

}  // namespace tokid
