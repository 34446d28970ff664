// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/simd.hpp"

#if defined(__x86_64__) && !defined(__SSE4_2__)
#include <cpuid.h>
#endif

#include <algorithm>
#include <atomic>

namespace tokid::simd {

namespace {

Target of_this_machine() {
#if defined(__x86_64__) && !defined(__SSE4_2__)
  // What Highway compiles these targets with; GCC asks the operating system, too, whether it saves the registers.
  __builtin_cpu_init();
  unsigned a = 0, b = 0, features = 0, d = 0;
  const bool f16c = __get_cpuid(1, &a, &b, &features, &d) != 0 && (features & bit_F16C) != 0;  // unknown to Clang's
  const bool sse4 = __builtin_cpu_supports("sse4.1") && __builtin_cpu_supports("sse4.2") &&
                    __builtin_cpu_supports("ssse3") && __builtin_cpu_supports("pclmul") &&
                    __builtin_cpu_supports("aes");
  const bool avx2 = sse4 && __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && f16c &&
                    __builtin_cpu_supports("bmi") && __builtin_cpu_supports("bmi2");
  const bool avx512 = avx2 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512cd") &&
                      __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512bw") &&
                      __builtin_cpu_supports("avx512vl");
  return avx512 ? Target::avx512 : avx2 ? Target::avx2 : sse4 ? Target::sse4 : Target::baseline;
#else
  return Target::baseline;
#endif
}

const Target best = of_this_machine();
std::atomic<Target> limit{Target::avx512};

}  // namespace

Target target() { return std::min(best, limit.load(std::memory_order_relaxed)); }

void limit_target(Target most) { limit = most; }

std::vector<Target> targets() {
  std::vector<Target> all;
  for (const Target t : {Target::baseline, Target::sse4, Target::avx2, Target::avx512})
    if (t <= best) all.push_back(t);
  return all;
}

std::string_view to_string(Target target) {
  switch (target) {
    case Target::avx512:
      return "AVX-512";
    case Target::avx2:
      return "AVX2";
    case Target::sse4:
      return "SSE4";
    default:
      return "baseline";
  }
}

}  // namespace tokid::simd
