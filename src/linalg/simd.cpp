// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/simd.hpp"

#if defined(__x86_64__) && !defined(__SSE4_2__)
#include <cpuid.h>
#endif

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <stdexcept>

namespace tokid::simd {

namespace {

Target of_this_machine() {
#if defined(__x86_64__) && !defined(__SSE4_2__)
  // Asks the processor for the features with which Highway compiles its targets. __builtin_cpu_supports is not used,
  // because not every compiler has the library that it needs. The register XCR0 says which registers the operating
  // system saves.
  const auto has = [](unsigned word, unsigned bits) { return (word & bits) == bits; };
  constexpr unsigned saves_avx = 0x06, saves_avx512 = 0xe6;
  unsigned a = 0, b = 0, c = 0, d = 0, saved = 0;
  if (__get_cpuid(1, &a, &b, &c, &d) == 0 || !has(c, bit_SSSE3 | bit_SSE4_1 | bit_SSE4_2 | bit_PCLMUL | bit_AES))
    return Target::baseline;
  if (!has(c, bit_OSXSAVE | bit_AVX | bit_FMA | bit_F16C)) return Target::sse4;
  __asm__("xgetbv" : "=a"(saved), "=d"(d) : "c"(0));
  if (!has(saved, saves_avx) || __get_cpuid_count(7, 0, &a, &b, &c, &d) == 0 || !has(b, bit_AVX2 | bit_BMI | bit_BMI2))
    return Target::sse4;
  const unsigned avx512 = bit_AVX512F | bit_AVX512CD | bit_AVX512DQ | bit_AVX512BW | bit_AVX512VL;
  return has(saved, saves_avx512) && has(b, avx512) ? Target::avx512 : Target::avx2;
#else
  return Target::baseline;
#endif
}

std::vector<Target> targets_up_to(Target most) {
  std::vector<Target> all;
  for (const Target t : {Target::baseline, Target::sse4, Target::avx2, Target::avx512})
    if (t <= most) all.push_back(t);
  return all;
}

// The best instruction set of this machine, or the one that TOKID_SIMD names.
Target best() {
  static const Target chosen = [] {
    const Target most = of_this_machine();
    const char* const name = std::getenv("TOKID_SIMD");
    if (!name) return most;
    std::string names;
    for (const Target t : targets_up_to(most)) {
      if (to_string(t) == name) return t;
      names += (names.empty() ? "" : ", ") + std::string(to_string(t));
    }
    throw std::invalid_argument(
        fmt::format("TOKID_SIMD: '{}' found, one of the instruction sets of this processor needed: {}", name, names));
  }();
  return chosen;
}

std::atomic<Target> limit{Target::avx512};

}  // namespace

Target target() { return std::min(best(), limit.load(std::memory_order_relaxed)); }

void limit_target(Target most) { limit = most; }

std::vector<Target> targets() { return targets_up_to(best()); }

std::string_view to_string(Target target) {
  switch (target) {
    case Target::avx512:
      return "avx512";
    case Target::avx2:
      return "avx2";
    case Target::sse4:
      return "sse4";
    default:
      return "baseline";
  }
}

}  // namespace tokid::simd
