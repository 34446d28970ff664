// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <initializer_list>
#include <utility>
#include <vector>

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// Arrays of vectors of `lanes` numbers in one block of memory. If a vector fills a cache line, each vector is one cache
// line.
class LaneMemory {
 public:
  // The addresses stay valid in a moved object, but not in a copy.
  LaneMemory(const LaneMemory&) = delete;
  LaneMemory(LaneMemory&&) noexcept = default;
  // `arrays`: for each array, the pointer that gets its address, and its number of vectors.
  LaneMemory(Index lanes, std::initializer_list<std::pair<double**, Index>> arrays) {
    constexpr std::uintptr_t cache_line = 64;
    Index total = 0;
    for (const auto& [pointer, size] : arrays) total += size * lanes;
    memory_.resize(size_t(total) + cache_line / sizeof(double));
    const auto address = reinterpret_cast<std::uintptr_t>(memory_.data());
    const std::uintptr_t skipped = (cache_line - address % cache_line) % cache_line / sizeof(double);
    double* next = memory_.data() + skipped;
    for (const auto& [pointer, size] : arrays) {
      *pointer = next;
      next += size * lanes;
    }
  }

 private:
  std::vector<double> memory_;
};

}  // namespace tokid::linalg
