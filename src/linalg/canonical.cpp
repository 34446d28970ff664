// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/canonical.hpp"

#include <cmath>
#include <limits>

#include "linalg/simd.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "linalg/canonical.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

void CopyCanonical(const double* from, size_t count, double* to) {
  constexpr double none = std::numeric_limits<double>::quiet_NaN();
  const Tag tag;
  size_t i = 0;
  for (; i + lanes <= count; i += lanes) {
    const Vec x = hn::LoadU(tag, from + i);
    hn::StoreU(hn::IfThenElse(hn::IsNaN(x), hn::Set(tag, none), hn::Add(x, hn::Zero(tag))), tag, to + i);
  }
  for (; i < count; ++i) to[i] = std::isnan(from[i]) ? none : from[i] + 0.0;
}

}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {

void copy_canonical(const double* from, Index count, double* to) {
  TOKID_KERNEL(CopyCanonical)(from, size_t(count), to);
}

}  // namespace tokid::linalg
#endif
