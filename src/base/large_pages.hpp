// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#ifdef __linux__
#include <sys/mman.h>
#endif

#include <cstddef>
#include <memory>

namespace tokid {

// Asks the system for large pages for memory that is about to be written. With small pages, the first write to the
// memory spends most of its time on the allocation of pages. The call is a hint: if the system refuses, only the speed
// is lower.
inline void prefer_large_pages([[maybe_unused]] const void* memory, [[maybe_unused]] size_t bytes) {
#ifdef __linux__
  constexpr size_t page = size_t{2} << 20;
  void* begin = const_cast<void*>(memory);
  if (std::align(page, page, begin, bytes)) madvise(begin, bytes / page * page, MADV_HUGEPAGE);
#endif
}

}  // namespace tokid
