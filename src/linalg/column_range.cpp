// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/column_range.hpp"

#include <algorithm>

#include "linalg/simd.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "linalg/column_range.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

void Range(const double* values, size_t count, double* least, double* most, double* zero) {
  const Tag tag;
  const Vec none = hn::Zero(tag);
  *least = *most = values[0];
  *zero = 0.0;
  size_t i = 0;
  if (count >= 2 * lanes) {
    Vec low[2], high[2], sum[2] = {none, none};
    for (size_t v = 0; v < 2; ++v) low[v] = high[v] = hn::LoadU(tag, values + v * lanes);
    for (; i + 2 * lanes <= count; i += 2 * lanes)
#pragma GCC unroll 2
      for (size_t v = 0; v < 2; ++v) {
        const Vec x = hn::LoadU(tag, values + i + v * lanes);
        low[v] = hn::Min(low[v], x);
        high[v] = hn::Max(high[v], x);
        sum[v] = hn::MulAdd(none, x, sum[v]);  // not zero after NaN or infinity
      }
    *least = hn::GetLane(hn::MinOfLanes(tag, hn::Min(low[0], low[1])));
    *most = hn::GetLane(hn::MaxOfLanes(tag, hn::Max(high[0], high[1])));
    *zero = hn::GetLane(hn::SumOfLanes(tag, hn::Add(sum[0], sum[1])));
  }
  for (; i < count; ++i) {
    *least = std::min(*least, values[i]);
    *most = std::max(*most, values[i]);
    *zero += 0.0 * values[i];
  }
}

}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {

ColumnRange column_range(const double* values, Index count) {
  if (count == 0) return {false};
  ColumnRange range;
  double zero = 0.0;
  TOKID_KERNEL(Range)(values, size_t(count), &range.min, &range.max, &zero);
  range.finite = zero == 0;
  return range;
}

}  // namespace tokid::linalg
#endif
