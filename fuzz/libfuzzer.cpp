// One target under libFuzzer: TOKID_FUZZ_TARGET, its number in the table.
// SPDX-License-Identifier: BSD-3-Clause
#include <cstddef>
#include <cstdint>

#include "targets.hpp"

// NOLINTBEGIN(bugprone-reserved-identifier, readability-identifier-naming): libFuzzer and the sanitizers look for these
extern "C" const char* __asan_default_options() { return "allocator_may_return_null=1"; }
// The HDF5 library forgets some memory when it meets damage.
extern "C" const char* __lsan_default_suppressions() { return "leak:libhdf5\nleak:libmatio"; }

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  tokid::fuzz::targets()[TOKID_FUZZ_TARGET].run({reinterpret_cast<const char*>(data), size});
  return 0;
}
// NOLINTEND(bugprone-reserved-identifier, readability-identifier-naming)
