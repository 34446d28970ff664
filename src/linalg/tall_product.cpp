// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/tall_product.hpp"

#include <algorithm>

#include "linalg/simd.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "linalg/tall_product.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

#ifndef TOKID_TALL_PRODUCT_FACTORS
#define TOKID_TALL_PRODUCT_FACTORS
namespace tokid::linalg {
namespace {

struct Factors {
  const double *x, *w;
  double* out;
  size_t rows, inner, columns, x_stride, w_stride, out_stride;
};

}  // namespace
}  // namespace tokid::linalg
#endif

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

// The rows from `row` on of the columns from `column` on.
template <Into into, size_t vectors, size_t columns>
HWY_INLINE void tile(const Factors& f, size_t row, size_t column) {
  const Tag tag;
  Vec sum[vectors][columns];
  double* out = f.out + row + column * f.out_stride;
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c)
#pragma GCC unroll 2
    for (size_t v = 0; v < vectors; ++v)
      sum[v][c] = into == Into::set ? hn::Zero(tag) : hn::LoadU(tag, out + c * f.out_stride + v * lanes);
  for (size_t i = 0; i < f.inner; ++i) {
    Vec x[vectors];
#pragma GCC unroll 2
    for (size_t v = 0; v < vectors; ++v) x[v] = hn::LoadU(tag, f.x + i * f.x_stride + row + v * lanes);
#pragma GCC unroll 4
    for (size_t c = 0; c < columns; ++c) {
      const Vec w = hn::Set(tag, f.w[i * f.w_stride + column + c]);
#pragma GCC unroll 2
      for (size_t v = 0; v < vectors; ++v)
        sum[v][c] = into == Into::subtract ? hn::NegMulAdd(w, x[v], sum[v][c]) : hn::MulAdd(w, x[v], sum[v][c]);
    }
  }
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c)
#pragma GCC unroll 2
    for (size_t v = 0; v < vectors; ++v) hn::StoreU(sum[v][c], tag, out + c * f.out_stride + v * lanes);
}

template <Into into, size_t vectors>
HWY_INLINE void columns_of(const Factors& f, size_t row) {
  size_t column = 0;
  for (; column + 4 <= f.columns; column += 4) tile<into, vectors, 4>(f, row, column);
  for (; column + 2 <= f.columns; column += 2) tile<into, vectors, 2>(f, row, column);
  for (; column < f.columns; ++column) tile<into, vectors, 1>(f, row, column);
}

template <Into into>
HWY_INLINE void product(const Factors& f) {
  size_t row = 0;
  for (; row + 2 * lanes <= f.rows; row += 2 * lanes) columns_of<into, 2>(f, row);
  for (; row + lanes <= f.rows; row += lanes) columns_of<into, 1>(f, row);
  for (; row < f.rows; ++row)
    for (size_t c = 0; c < f.columns; ++c) {
      double& out = f.out[row + c * f.out_stride];
      double sum = into == Into::set ? 0.0 : out;
      for (size_t i = 0; i < f.inner; ++i) {
        const double term = f.x[i * f.x_stride + row] * f.w[i * f.w_stride + c];
        sum += into == Into::subtract ? -term : term;
      }
      out = sum;
    }
}

void SetProduct(const Factors& f) { product<Into::set>(f); }
void AddProduct(const Factors& f) { product<Into::add>(f); }
void SubtractProduct(const Factors& f) { product<Into::subtract>(f); }

}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {

void tall_product(const ConstMatrixRef& x, const ConstMatrixRef& w, Into into, Eigen::Ref<Matrix> out) {
  const Factors f{x.data(),
                  w.data(),
                  out.data(),
                  size_t(x.rows()),
                  size_t(x.cols()),
                  size_t(w.rows()),
                  size_t(x.outerStride()),
                  size_t(w.outerStride()),
                  size_t(out.outerStride())};
  switch (into) {
    case Into::set:
      return TOKID_KERNEL(SetProduct)(f);
    case Into::add:
      return TOKID_KERNEL(AddProduct)(f);
    case Into::subtract:
      return TOKID_KERNEL(SubtractProduct)(f);
  }
}

}  // namespace tokid::linalg
#endif
