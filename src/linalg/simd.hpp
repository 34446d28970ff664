// The instruction sets of the kernels, and their choice at run time. Kernels include this file before
// <hwy/foreach_target.h>. Only the headers of Highway are used, because its library measures the clock for 4 ms at the
// start of every program.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

// The kernels are compiled for AVX-512, AVX2, SSE4 and the baseline. SVE and RVV are disabled: the compiler does not
// know the length of their vectors, and cannot keep arrays of such vectors in registers. The bits below HWY_AVX3 are
// newer variants of AVX-512, which are not needed. Processors other than x86_64 have only the baseline, which is NEON
// on arm64.
#define HWY_DISABLED_TARGETS (HWY_SSSE3 | (HWY_AVX3 - 1) | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
#if !defined(__x86_64__)
#define HWY_COMPILE_ONLY_STATIC
#endif

#include <string_view>
#include <vector>

namespace tokid::simd {

// From the oldest to the newest. Code outside the kernels is compiled for the baseline.
enum class Target { baseline, sse4, avx2, avx512 };

// The best instruction set of this machine, or the one that the environment variable TOKID_SIMD names, unless a test
// has limited it. \throws std::invalid_argument if TOKID_SIMD names no instruction set of this machine
Target target();
// For tests: limits the choice to this instruction set.
void limit_target(Target best);

// The instruction sets of this machine, up to the one that TOKID_SIMD names.
std::vector<Target> targets();
std::string_view to_string(Target target);

}  // namespace tokid::simd

// The kernel of this name, compiled for target(). Use it only within #if HWY_ONCE. Targets below the baseline are not
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
