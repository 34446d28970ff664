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

struct Gram {
  const double* const* columns;
  size_t count, rows;
  double* out;
  size_t stride;
};

// The sum over rows is made of so many partial sums, for every length of vectors.
constexpr size_t partial_sums = size_t(gram_rows);

}  // namespace
}  // namespace tokid::linalg
#endif

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

// Adds the product f to the tile of `sum` that begins at `row` and `column`.
template <bool subtract, size_t vectors, size_t columns>
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
      for (size_t v = 0; v < vectors; ++v) sum[v][c] = subtract ? minus(sum[v][c], w, x[v]) : plus(sum[v][c], w, x[v]);
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

// One row, which rounds like whole vectors, so that a row has the same result at any place. Several columns at once, so
// that their sums need not wait for each other.
template <size_t columns>
HWY_INLINE void single_row(const Sum& s, size_t row, size_t column) {
  const hn::CappedTag<double, 1> one;
  hn::Vec<hn::CappedTag<double, 1>> sum[columns];
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c)
    sum[c] = hn::Set(one, s.start ? s.start[row + (column + c) * s.start_stride] : 0.0);
  for (size_t p = 0; p < s.count; ++p) {
    const Factors& f = s.products[p];
    for (size_t i = 0; i < f.inner; ++i) {
      const auto x = hn::Set(one, f.x[i * f.x_stride + row]);
#pragma GCC unroll 4
      for (size_t c = 0; c < columns; ++c) {
        const auto w = hn::Set(one, f.w[i * f.w_stride + column + c]);
        sum[c] = f.minus ? minus(sum[c], w, x) : plus(sum[c], w, x);
      }
    }
  }
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c) s.out[row + (column + c) * s.out_stride] = hn::GetLane(sum[c]);
}

void SumOfProducts(const Sum& s) {
  size_t row = 0;
  for (; row + 2 * lanes <= s.rows; row += 2 * lanes) columns_of<2>(s, row);
  for (; row + lanes <= s.rows; row += lanes) columns_of<1>(s, row);
  for (; row < s.rows; ++row) {
    size_t column = 0;
    for (; column + 4 <= s.columns; column += 4) single_row<4>(s, row, column);
    for (; column + 2 <= s.columns; column += 2) single_row<2>(s, row, column);
    for (; column < s.columns; ++column) single_row<1>(s, row, column);
  }
}

// The sum of the partial sums, always in the same order: those that are 4 apart, then 2, then 1.
template <size_t vectors>
HWY_INLINE double total(Vec (&sum)[vectors]) {
  for (size_t apart = vectors / 2; apart > 0; apart /= 2)
    for (size_t v = 0; v < apart; ++v) sum[v] = hn::Add(sum[v], sum[v + apart]);
  alignas(64) double part[lanes];
  hn::Store(sum[0], Tag(), part);
  for (size_t apart = lanes / 2; apart > 0; apart /= 2)
    for (size_t l = 0; l < apart; ++l) part[l] += part[l + apart];
  return part[0];
}

// Column i times the columns j … j+columns-1.
template <size_t columns>
HWY_INLINE void add_squares(const Gram& g, size_t i, size_t j) {
  constexpr size_t vectors = partial_sums / lanes;
  const Tag tag;
  Vec sum[columns][vectors];
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c)
#pragma GCC unroll 8
    for (size_t v = 0; v < vectors; ++v) sum[c][v] = hn::Zero(tag);
  for (size_t k = 0; k < g.rows; k += partial_sums)
#pragma GCC unroll 8
    for (size_t v = 0; v < vectors; ++v) {
      const Vec x = hn::LoadU(tag, g.columns[i] + k + v * lanes);
#pragma GCC unroll 4
      for (size_t c = 0; c < columns; ++c)
        sum[c][v] = plus(sum[c][v], x, hn::LoadU(tag, g.columns[j + c] + k + v * lanes));
    }
  for (size_t c = 0; c < columns; ++c) g.out[i + (j + c) * g.stride] = g.out[j + c + i * g.stride] += total(sum[c]);
}

void AddGram(const Gram& g) {
  for (size_t i = 0; i < g.count; ++i) {
    size_t j = i;
    for (; j + 4 <= g.count; j += 4) add_squares<4>(g, i, j);
    for (; j < g.count; ++j) add_squares<1>(g, i, j);
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
    if (!fits(p.x.rows, p.w.rows) || p.x.cols != p.w.cols)
      throw std::logic_error("tall_products: the factors do not fit each other or out");
    sum.products[sum.count++] = {p.x.data, p.w.data, size_t(p.x.cols), size_t(p.x.stride), size_t(p.w.stride), p.minus};
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

void add_gram(std::span<const double* const> columns, Index rows, Eigen::Ref<Matrix> sum) {
  const Index count = Index(columns.size());
  if (sum.rows() < count || sum.cols() < count || rows % gram_rows != 0)
    throw std::logic_error("add_gram: the columns do not fit the sum, or the number of rows is not a multiple of 8");
  TOKID_KERNEL(AddGram)({columns.data(), columns.size(), size_t(rows), sum.data(), size_t(sum.outerStride())});
}

}  // namespace tokid::linalg
#endif
