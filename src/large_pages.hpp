// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#ifdef __linux__
#include <sys/mman.h>
#endif

#include <cstddef>
#include <cstdint>

namespace tokid {

// Asks the system for large pages behind memory that is about to be written: where it is so for the first time, most of
// the time is that of small ones. A hint, whose failure is of no consequence.
inline void prefer_large_pages([[maybe_unused]] const void* memory, [[maybe_unused]] size_t bytes) {
#ifdef __linux__
  constexpr std::uintptr_t page = size_t{2} << 20;
  const auto from = reinterpret_cast<std::uintptr_t>(memory);
  const std::uintptr_t begin = (from + page - 1) / page * page, end = (from + bytes) / page * page;
  if (begin < end) madvise(reinterpret_cast<void*>(begin), end - begin, MADV_HUGEPAGE);
#endif
}

}  // namespace tokid
