// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/tall_product.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "linalg/simd.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "linalg/tall_product.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

#ifndef TOKID_TALL_PRODUCT_SUM
#define TOKID_TALL_PRODUCT_SUM
namespace tokid::linalg {
namespace {

constexpr size_t most_products = 3;

struct Factors {
  const double *x, *w;
  size_t inner, x_stride, w_stride;
  bool minus;
};

struct Sum {
  Factors products[most_products];
  size_t count = 0;
  const double* start;  // null: the sum starts from zero
  double* out;
  size_t rows, columns, start_stride, out_stride;
};

}  // namespace
}  // namespace tokid::linalg
#endif

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

// Adds the product f to the tile of `sum` that begins at `row` and `column`.
template <bool minus, size_t vectors, size_t columns>
HWY_INLINE void add(const Factors& f, size_t row, size_t column, Vec (&sum)[vectors][columns]) {
  const Tag tag;
  for (size_t i = 0; i < f.inner; ++i) {
    Vec x[vectors];
#pragma GCC unroll 2
    for (size_t v = 0; v < vectors; ++v) x[v] = hn::LoadU(tag, f.x + i * f.x_stride + row + v * lanes);
#pragma GCC unroll 4
    for (size_t c = 0; c < columns; ++c) {
      const Vec w = hn::Set(tag, f.w[i * f.w_stride + column + c]);
#pragma GCC unroll 2
      for (size_t v = 0; v < vectors; ++v)
        sum[v][c] = minus ? hn::NegMulAdd(w, x[v], sum[v][c]) : hn::MulAdd(w, x[v], sum[v][c]);
    }
  }
}

template <size_t vectors, size_t columns>
HWY_INLINE void tile(const Sum& s, size_t row, size_t column) {
  const Tag tag;
  Vec sum[vectors][columns];
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c)
#pragma GCC unroll 2
    for (size_t v = 0; v < vectors; ++v)
      sum[v][c] = s.start ? hn::LoadU(tag, s.start + row + (column + c) * s.start_stride + v * lanes) : hn::Zero(tag);
  for (size_t p = 0; p < s.count; ++p)
    if (s.products[p].minus)
      add<true>(s.products[p], row, column, sum);
    else
      add<false>(s.products[p], row, column, sum);
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c)
#pragma GCC unroll 2
    for (size_t v = 0; v < vectors; ++v)
      hn::StoreU(sum[v][c], tag, s.out + row + (column + c) * s.out_stride + v * lanes);
}

template <size_t vectors>
HWY_INLINE void columns_of(const Sum& s, size_t row) {
  size_t column = 0;
  for (; column + 4 <= s.columns; column += 4) tile<vectors, 4>(s, row, column);
  for (; column + 2 <= s.columns; column += 2) tile<vectors, 2>(s, row, column);
  for (; column < s.columns; ++column) tile<vectors, 1>(s, row, column);
}

void SumOfProducts(const Sum& s) {
  const hn::CappedTag<double, 1> one;  // rounds like whole vectors, so that a row has the same result at any place
  size_t row = 0;
  for (; row + 2 * lanes <= s.rows; row += 2 * lanes) columns_of<2>(s, row);
  for (; row + lanes <= s.rows; row += lanes) columns_of<1>(s, row);
  for (; row < s.rows; ++row)
    for (size_t c = 0; c < s.columns; ++c) {
      auto sum = hn::Set(one, s.start ? s.start[row + c * s.start_stride] : 0.0);
      for (size_t p = 0; p < s.count; ++p) {
        const Factors& f = s.products[p];
        for (size_t i = 0; i < f.inner; ++i) {
          const auto x = hn::Set(one, f.x[i * f.x_stride + row]), w = hn::Set(one, f.w[i * f.w_stride + c]);
          sum = f.minus ? hn::NegMulAdd(w, x, sum) : hn::MulAdd(w, x, sum);
        }
      }
      s.out[row + c * s.out_stride] = hn::GetLane(sum);
    }
}

}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {

namespace {

void sum_up(const ConstMatrixRef* start, std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out) {
  if (products.size() > most_products)
    throw std::logic_error(
        fmt::format("tall_products: {} products found, up to {} possible", products.size(), most_products));
  const auto fits = [&](Index rows, Index columns) { return rows == out.rows() && columns == out.cols(); };
  if (start && !fits(start->rows(), start->cols()))
    throw std::logic_error("tall_products: start does not have the shape of out");
  Sum sum{};
  for (const TallProduct& p : products) {
    if (!fits(p.x.rows(), p.w.rows()) || p.x.cols() != p.w.cols())
      throw std::logic_error("tall_products: the factors do not fit each other or out");
    sum.products[sum.count++] = {
        p.x.data(), p.w.data(), size_t(p.x.cols()), size_t(p.x.outerStride()), size_t(p.w.outerStride()), p.minus};
  }
  sum.rows = size_t(out.rows());
  sum.columns = size_t(out.cols());
  sum.out = out.data();
  sum.out_stride = size_t(out.outerStride());
  if (start) {
    sum.start = start->data();
    sum.start_stride = size_t(start->outerStride());
  }
  TOKID_KERNEL(SumOfProducts)(sum);
}

}  // namespace

void tall_products(std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out) {
  sum_up(nullptr, products, out);
}

void tall_products(const ConstMatrixRef& start, std::initializer_list<TallProduct> products, Eigen::Ref<Matrix> out) {
  sum_up(&start, products, out);
}

}  // namespace tokid::linalg
#endif
