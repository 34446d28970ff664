// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/transposition.hpp"

#include <algorithm>

#include "linalg/simd.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "linalg/transposition.cpp"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

void Transpose(const double* from, Index count, Index cols, Index stride, double* const* to) {
  constexpr Index side = Index(lanes);
  HWY_ALIGN double square[lanes * lanes];
  Index j = 0;
  for (; j + side <= cols; j += side) {
    Index i = 0;
    for (; i + side <= count; i += side) {
      // The columns are far from each other in memory, so that no processor predicts which column is written next.
      // Without a prefetch each write would wait for the memory.
      for (Index c = j + side; c < std::min(j + 2 * side, cols); ++c) hwy::Prefetch(to[c] + i);
      transpose(from + i * stride + j, size_t(stride), square);
      for (Index c = 0; c < side; ++c) hn::StoreU(load(square, size_t(c)), Tag(), to[j + c] + i);
    }
    for (; i < count; ++i)
      for (Index c = j; c < j + side; ++c) to[c][i] = from[i * stride + c];
  }
  for (; j < cols; ++j)
    for (Index i = 0; i < count; ++i) to[j][i] = from[i * stride + j];
}

}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {

void transpose(const double* from, Index rows, Index stride, const std::vector<double*>& columns) {
  TOKID_KERNEL(Transpose)(from, rows, Index(columns.size()), stride, columns.data());
}

}  // namespace tokid::linalg
#endif
