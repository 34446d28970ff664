// What every kernel with run-time dispatch includes before <hwy/foreach_target.h>: AVX-512, AVX2 and the baseline are
// enough. Vectors whose length is not known to the compiler can't be kept in arrays of registers.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_AVX3_DL | HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV)
