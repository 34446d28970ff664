// SPDX-License-Identifier: BSD-3-Clause
#include "linalg/row_absorption.hpp"

#include <algorithm>
#include <cmath>
#include <type_traits>

#include "base/integers.hpp"
#include "linalg/simd.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "linalg/row_absorption.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

constexpr size_t width = RowAbsorption::width;
// Outside this range, the square of a column, or its products with other columns, may have lost digits.
constexpr double smallest_square = 1e-120, largest_square = 1e120;
// A tile of this many rows × vectors stays in registers.
constexpr size_t tile_rows = HWY_TARGET == HWY_AVX3 ? 8 : 4, tile_vectors = 2;
// Sums of BackSubstitute() begin with all rows below a block of this many rows, for every size of a tile.
constexpr size_t block_rows = 8;

// c = from ± a·b for one tile. a(i, k) = a[i·row + k·col]; the rows of b, c and `from` are contiguous.
template <size_t vectors, bool subtract>
HWY_INLINE void tile(const double* HWY_RESTRICT a, size_t row, size_t col, size_t depth, const double* HWY_RESTRICT b,
                     size_t b_stride, const double* from, double* c, size_t c_stride) {
  const Tag tag;
  Vec sum[tile_rows][vectors];
#pragma GCC unroll 8
  for (size_t i = 0; i < tile_rows; ++i)
#pragma GCC unroll 4
    for (size_t v = 0; v < vectors; ++v) sum[i][v] = hn::LoadU(tag, from + i * c_stride + v * lanes);
  for (size_t k = 0; k < depth; ++k) {
    Vec right[vectors];
#pragma GCC unroll 4
    for (size_t v = 0; v < vectors; ++v) right[v] = hn::LoadU(tag, b + k * b_stride + v * lanes);
#pragma GCC unroll 8
    for (size_t i = 0; i < tile_rows; ++i) {
      const Vec left = hn::Set(tag, a[i * row + k * col]);
#pragma GCC unroll 4
      for (size_t v = 0; v < vectors; ++v)
        sum[i][v] = subtract ? minus(sum[i][v], left, right[v]) : plus(sum[i][v], left, right[v]);
    }
  }
#pragma GCC unroll 8
  for (size_t i = 0; i < tile_rows; ++i)
#pragma GCC unroll 4
    for (size_t v = 0; v < vectors; ++v) hn::StoreU(sum[i][v], tag, c + i * c_stride + v * lanes);
}

// As tile(), for a block of whole tiles. The rows of b, c and `from` have `width` entries.
template <bool subtract>
HWY_INLINE void multiply(size_t rows, const double* a, size_t row, size_t col, size_t depth, const double* b,
                         const double* from, double* c) {
  for (size_t j = 0; j < width; j += tile_vectors * lanes)
    for (size_t i = 0; i < rows; i += tile_rows)
      tile<tile_vectors, subtract>(a + i * row, row, col, depth, b + j, width, from + i * width + j, c + i * width + j,
                                   width);
}

// Applies the reflections of a panel to a block of columns [R; x] on its right: w = R + Vᵀ x, R -= Tᵀ w, x -= V Tᵀ w. V
// and T come from factor_panel().
void reflect(const double* v, const double* t_transposed, size_t rows, double* r, double* x) {
  HWY_ALIGN double w[width * width];
  HWY_ALIGN double tw[width * width] = {};
  multiply<false>(width, v, 1, width, rows, x, r, w);
  multiply<false>(width, t_transposed, width, 1, width, w, tw, tw);
  const Tag tag;
  for (size_t i = 0; i < width * width; i += lanes)
    hn::StoreU(hn::Sub(hn::LoadU(tag, r + i), hn::LoadU(tag, tw + i)), tag, r + i);
  multiply<true>(rows, v, width, 1, width, tw, x, x);
}

// Zeroes the columns begin … end-1 of a panel x (rows × width) below r, a block on the diagonal of R. Each column has
// its own reflection:
// H_i = I - τ_i [e_i; v_i] [e_i; v_i]ᵀ, H_0 H_1 … = I - [E; V] T [E; V]ᵀ
// The vectors v_i replace these columns of the panel, and its other columns become zero. T is stored transposed.
void factor_panel(double* HWY_RESTRICT x, size_t rows, size_t begin, size_t end, double* r, double* t_transposed) {
  constexpr size_t vectors = width / lanes;
  const Tag tag;
  HWY_ALIGN double scale[width] = {};
  HWY_ALIGN double products[width];
  HWY_ALIGN double w[width];
  std::fill_n(t_transposed, width * width, 0.0);
  const auto multiply_with = [&](size_t i) {  // products of column i with all columns
    Vec sum[2][vectors];
    for (auto& half : sum)
      for (Vec& s : half) s = hn::Zero(tag);
    for (size_t k = 0; k < rows; k += 2)
#pragma GCC unroll 2
      for (size_t h = 0; h < 2; ++h) {
        const double* row = x + (k + h) * width;
        const Vec factor = hn::Set(tag, row[i]);
#pragma GCC unroll 8
        for (size_t v = 0; v < vectors; ++v) sum[h][v] = plus(sum[h][v], factor, hn::LoadU(tag, row + v * lanes));
      }
    for (size_t v = 0; v < vectors; ++v) hn::StoreU(hn::Add(sum[0][v], sum[1][v]), tag, products + v * lanes);
  };
  for (size_t i = begin; i < end; ++i) {
    double* const row = r + i * width;
    multiply_with(i);
    double unit = 1.0, pivot = row[i];
    if (!(products[i] > smallest_square && products[i] + pivot * pivot < largest_square)) {
      // The square is out of range: the column is scaled, and its products are computed again.
      double largest = 0.0;
      for (size_t k = 0; k < rows; ++k) largest = std::max(largest, std::abs(x[k * width + i]));
      if (!(largest > 0) && !std::isnan(products[i])) continue;  // nothing to absorb
      unit = std::max(largest, std::abs(pivot));
      for (size_t k = 0; k < rows; ++k) x[k * width + i] /= unit;
      pivot /= unit;
      multiply_with(i);
    }
    const double norm = std::sqrt(pivot * pivot + products[i]);
    const double beta = pivot > 0 ? -norm : norm, tau = (beta - pivot) / beta;
    row[i] = beta * unit;
    scale[i] = 1 / (pivot - beta);
    for (size_t j = 0; j < width; ++j) {
      const bool later = j > i && j < end;
      const double change = later ? tau * (row[j] + scale[i] * products[j]) : 0.0;
      if (later) row[j] -= change;
      w[j] = change * scale[i];
    }
    Vec change[vectors];
    for (size_t v = 0; v < vectors; ++v) change[v] = hn::LoadU(tag, w + v * lanes);
    for (size_t k = 0; k < rows; ++k) {
      const Vec factor = hn::Set(tag, x[k * width + i]);
#pragma GCC unroll 8
      for (size_t v = 0; v < vectors; ++v) {
        double* to = x + k * width + v * lanes;
        hn::StoreU(minus(hn::LoadU(tag, to), factor, change[v]), tag, to);
      }
    }
    // T(0…i-1, i) = -τ_i T V_{0…i-1}ᵀ v_i
    for (size_t j = begin; j < i; ++j) products[j] *= scale[j] * scale[i];
    for (size_t j = begin; j < i; ++j) {
      double sum = 0.0;
      for (size_t k = j; k < i; ++k) sum += t_transposed[k * width + j] * products[k];
      t_transposed[i * width + j] = -tau * sum;
    }
    t_transposed[i * width + i] = tau;
  }
  for (size_t k = 0; k < rows; ++k)
    for (size_t v = 0; v < width; v += lanes) {
      double* to = x + k * width + v;
      hn::StoreU(hn::Mul(hn::LoadU(tag, to), hn::LoadU(tag, scale + v)), tag, to);
    }
}

// Absorbs the rows x, stored in blocks of `width` columns, into the columns begin … n-1 of r.
void Absorb(double* r, size_t begin, size_t n, double* x, size_t rows) {
  HWY_ALIGN double t_transposed[width * width];
  const size_t blocks = (n + width - 1) / width;
  for (size_t b = begin / width; b < blocks; ++b) {
    const size_t first = std::max(begin, b * width) - b * width, last = std::min(n, (b + 1) * width) - b * width;
    double* const v = x + b * rows * width;
    factor_panel(v, rows, first, last, r + RowAbsorption::offset(Index(b)) + b * width * width, t_transposed);
    for (size_t c = b + 1; c < blocks; ++c)
      reflect(v, t_transposed, rows, r + RowAbsorption::offset(Index(c)) + b * width * width, x + c * rows * width);
  }
}

// b = r⁻¹ b (n × cols, padded to whole vectors), from the last rows up. All rows below a block of rows are subtracted
// from the block at once. Then the rows of the block are solved one by one. With `triangular`, b is upper triangular
// and stays so.
void BackSubstitute(const double* r, size_t n, size_t r_stride, double* b, size_t cols, size_t stride,
                    bool triangular) {
  const Tag tag;
  for (size_t block = (n + block_rows - 1) / block_rows; block-- > 0;) {
    const size_t begin = block * block_rows, end = std::min(n, begin + block_rows);
    const auto depth = [&](size_t j_end) { return (triangular ? std::min(n, j_end) : n) - end; };
    size_t j = triangular ? end / lanes * lanes : 0;
    const auto subtract_below = [&]<size_t vectors>(std::integral_constant<size_t, vectors>) {
      for (; end < n && j + vectors * lanes <= cols; j += vectors * lanes)
        for (size_t i = begin; i < end; i += tile_rows)
          tile<vectors, true>(r + i * r_stride + end, r_stride, 1, depth(j + vectors * lanes), b + end * stride + j,
                              stride, b + i * stride + j, b + i * stride + j, stride);
    };
    subtract_below(std::integral_constant<size_t, tile_vectors>());
    subtract_below(std::integral_constant<size_t, 1>());
    for (size_t i = end; i-- > begin;) {
      const Vec inverse = hn::Set(tag, 1 / r[i * r_stride + i]);
      for (j = triangular ? begin / lanes * lanes : 0; j < cols; j += lanes) {
        Vec sum = hn::LoadU(tag, b + i * stride + j);
        for (size_t k = i + 1; k < end; ++k)
          sum = minus(sum, hn::Set(tag, r[i * r_stride + k]), hn::LoadU(tag, b + k * stride + j));
        hn::StoreU(hn::Mul(sum, inverse), tag, b + i * stride + j);
      }
    }
  }
}

}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {

namespace {

// The number of absorbed rows is padded to a multiple of `whole_rows`.
constexpr Index whole_rows = 8;
// At most this many rows are absorbed at once. They stay in the second-level cache together with R.
constexpr Index rows_at_once = 192;

}  // namespace

void RowAbsorption::reset(Index n) {
  n_ = n;
  r_.assign(RowAbsorption::offset(ceil_div(n, width)), 0.0);
}

double* RowAbsorption::piece(Index rows) {
  const size_t size = size_t(ceil_div(n_, width) * width * rows);
  if (piece_.size() < size) piece_.resize(size);
  return piece_.data();
}

void RowAbsorption::absorb(const ConstMatrixRef& rows, const double* scales) {
  for (Index begin = 0; begin < rows.rows(); begin += rows_at_once) {
    const Index count = std::min(rows_at_once, rows.rows() - begin), whole = ceil_div(count, whole_rows) * whole_rows;
    double* to = piece(whole);
    for (Index b = 0; b < n_; b += width, to += whole * width)
      for (Index j = 0; j < width; ++j) {
        const double* from = b + j < n_ ? &rows.coeffRef(begin, b + j) : nullptr;
        const double scale = from && scales ? scales[b + j] : 1.0;
        for (Index i = 0; i < count; ++i) to[i * width + j] = from ? scale * from[i] : 0.0;
        for (Index i = count; i < whole; ++i) to[i * width + j] = 0.0;
      }
    TOKID_KERNEL(Absorb)(r_.data(), 0, size_t(n_), piece_.data(), size_t(whole));
  }
}

void RowAbsorption::drop(Index begin, Index count) {
  const Index rest = begin + count, whole = ceil_div(count, whole_rows) * whole_rows;
  double* const to = piece(whole);
  for (Index j = rest / width * width; j < ceil_div(n_, width) * width; ++j)
    for (Index i = 0; i < whole; ++i)
      to[(j / width * whole + i) * width + j % width] = j >= rest && j < n_ && i < count ? (*this)(begin + i, j) : 0.0;
  TOKID_KERNEL(Absorb)(r_.data(), size_t(rest), size_t(n_), to, size_t(whole));
}

Matrix RowAbsorption::factor() const {
  Matrix r = Matrix::Zero(n_, n_);
  for (Index j = 0; j < n_; ++j)
    for (Index i = 0; i <= j; ++i) r(i, j) = (*this)(i, j);
  return r;
}

void back_substitute(const RowMatrix& r, RowMatrix& b, bool triangular) {
  TOKID_KERNEL(BackSubstitute)
  (r.data(), size_t(r.rows()), size_t(r.cols()), b.data(), size_t(b.cols()), size_t(b.cols()), triangular);
}

}  // namespace tokid::linalg
#endif
