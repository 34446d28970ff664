// The instruction sets that kernels are compiled for, and the choice among them at run time. Kernels include this
// before <hwy/foreach_target.h>; Highway serves as headers alone, as its library would measure the clock for 4 ms
// whenever a program that has it starts.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// AVX-512, AVX2, SSE4 and the baseline are enough. Vectors whose length is not known to the compiler can't be kept in
// arrays of registers; the bits below HWY_AVX3 are its newer kin. Other processors than x86_64 have the baseline alone,
// which is NEON on arm64.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | (HWY_AVX3 - 1) | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#if !defined(__x86_64__)
#define HWY_COMPILE_ONLY_STATIC
#endif

#include <string_view>
#include <vector>

namespace tokid::simd {

// From the oldest on; the baseline is what the whole program is compiled for.
enum class Target { baseline, sse4, avx2, avx512 };

// The best one of this machine, unless another one was asked for.
Target target();
// For tests: to use no better one than this.
void limit_target(Target best);

// Those that this machine has.
std::vector<Target> targets();
std::string_view to_string(Target target);

}  // namespace tokid::simd

// The kernel of that name compiled for target(), to be used where HWY_ONCE holds; targets below the baseline are not
// compiled.
#if defined(__x86_64__) && !defined(__SSE4_2__)
#define TOKID_KERNEL(name)                                                  \
  (::tokid::simd::target() == ::tokid::simd::Target::avx512 ? &N_AVX3::name \
   : ::tokid::simd::target() == ::tokid::simd::Target::avx2 ? &N_AVX2::name \
   : ::tokid::simd::target() == ::tokid::simd::Target::sse4 ? &N_SSE4::name \
                                                            : &HWY_STATIC_DISPATCH(name))
#else
#define TOKID_KERNEL(name) (&HWY_STATIC_DISPATCH(name))
#endif
