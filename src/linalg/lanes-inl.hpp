// Vectors that contain one entry of several matrices, one matrix in each lane, and the kernel that reduces these
// matrices to triangles. Highway includes this file once for each instruction set. Therefore its include guard toggles.
// SPDX-License-Identifier: BSD-3-Clause

// NOLINTBEGIN(misc-definitions-in-headers)
#if defined(TOKID_LINALG_LANES_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef TOKID_LINALG_LANES_INL_HPP
#undef TOKID_LINALG_LANES_INL_HPP
#else
#define TOKID_LINALG_LANES_INL_HPP
#endif

#include <hwy/highway.h>

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {

namespace hn = hwy::HWY_NAMESPACE;
using Tag = hn::ScalableTag<double>;
using Vec = hn::Vec<Tag>;

constexpr size_t lanes = HWY_LANES(double);

// A product and its sum are rounded one after the other, although some processors can round them at once. So every
// instruction set gives the same bits.
template <class V>
HWY_INLINE V plus(V sum, V a, V b) {
  return hn::Add(sum, hn::Mul(a, b));
}
template <class V>
HWY_INLINE V minus(V sum, V a, V b) {
  return hn::Sub(sum, hn::Mul(a, b));
}

HWY_INLINE Vec load(const double* list, size_t entry) { return hn::Load(Tag(), list + entry * lanes); }
HWY_INLINE void store(Vec v, double* list, size_t entry) { hn::Store(v, Tag(), list + entry * lanes); }
HWY_INLINE size_t packed(size_t i, size_t j) { return j * (j + 1) / 2 + i; }

// Reads the entries 0 … lanes-1 of `lanes` columns, which are `offset` numbers apart. Writes one vector for each entry.
HWY_INLINE void transpose(const double* from, size_t offset, double* to) {
  const Tag tag;
  Vec a[lanes];
#pragma GCC unroll 8
  for (size_t l = 0; l < lanes; ++l) a[l] = hn::LoadU(tag, from + l * offset);
#if HWY_TARGET == HWY_SCALAR
  store(a[0], to, 0);
#else
  Vec b[lanes];  // b[l]: even entries of columns l and l+1; b[l+1]: their odd entries
#pragma GCC unroll 8
  for (size_t l = 0; l < lanes; l += 2) {
    b[l] = hn::InterleaveLower(tag, a[l], a[l + 1]);
    b[l + 1] = hn::InterleaveUpper(tag, a[l], a[l + 1]);
  }
  if constexpr (lanes == 2) {
    store(b[0], to, 0);
    store(b[1], to, 1);
  } else if constexpr (lanes == 4) {
    for (size_t h = 0; h < 2; ++h) {
      store(hn::ConcatLowerLower(tag, b[2 + h], b[h]), to, h);
      store(hn::ConcatUpperUpper(tag, b[2 + h], b[h]), to, 2 + h);
    }
  } else {
    for (size_t h = 0; h < 2; ++h) {  // b has blocks of 128 bits: entries h, 2+h, 4+h, 6+h of two columns
      const Vec low0 = hn::ConcatLowerLower(tag, b[4 + h], b[h]), low1 = hn::ConcatLowerLower(tag, b[6 + h], b[2 + h]);
      const Vec up0 = hn::ConcatUpperUpper(tag, b[4 + h], b[h]), up1 = hn::ConcatUpperUpper(tag, b[6 + h], b[2 + h]);
      store(hn::OddEvenBlocks(hn::SwapAdjacentBlocks(low1), low0), to, h);
      store(hn::OddEvenBlocks(low1, hn::SwapAdjacentBlocks(low0)), to, 2 + h);
      store(hn::OddEvenBlocks(hn::SwapAdjacentBlocks(up1), up0), to, 4 + h);
      store(hn::OddEvenBlocks(up1, hn::SwapAdjacentBlocks(up0)), to, 6 + h);
    }
  }
#endif
}

// The reflection I - τ [1; s v] [1; s v]ᵀ with τ = `tau`, s = `scale`. It turns [pivot; v] into [beta; 0]. If v is
// zero, the reflection is I.
struct Reflection {
  Vec beta, tau, scale;

  Reflection(Vec pivot, Vec square) {
    const Tag tag;
    const Vec zero = hn::Zero(tag), one = hn::Set(tag, 1.0);
    const auto none = hn::Eq(square, zero);
    const Vec norm = hn::Sqrt(plus(square, pivot, pivot));
    const Vec opposite = hn::IfThenElse(hn::Gt(pivot, zero), hn::Neg(norm), norm);
    beta = hn::IfThenElse(none, pivot, opposite);
    tau = hn::IfThenElse(none, zero, hn::Sub(one, hn::Div(pivot, opposite)));
    scale = hn::IfThenElse(none, zero, hn::Div(one, hn::Sub(pivot, opposite)));
  }
  // The reflection of a column [upper; x] with product = vᵀx. It subtracts this amount from `upper`, and s v times this
  // amount from x.
  Vec taken(Vec upper, Vec product) const { return hn::Mul(tau, plus(upper, scale, product)); }
};

// Applies two reflections at once to the columns j … j+columns-1: `first` of column i with v, and `second` of column
// i+1 with w. cross = vᵀw.
template <size_t columns>
HWY_INLINE void reflect(const double* v, const double* w, double* x, size_t rows, const Reflection& first,
                        const Reflection& second, Vec cross, double* r, size_t i, size_t j) {
  const Tag tag;
  Vec a[columns], b[columns];
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c) a[c] = b[c] = hn::Zero(tag);
  for (size_t k = 0; k < rows; ++k) {
    const Vec v_k = load(v, k), w_k = load(w, k);
#pragma GCC unroll 4
    for (size_t c = 0; c < columns; ++c) {
      const Vec x_k = load(x, c * rows + k);
      a[c] = plus(a[c], v_k, x_k);
      b[c] = plus(b[c], w_k, x_k);
    }
  }
#pragma GCC unroll 4
  for (size_t c = 0; c < columns; ++c) {
    const Vec upper = load(r, packed(i, j + c)), lower = load(r, packed(i + 1, j + c));
    const Vec taken = first.taken(upper, a[c]);
    a[c] = hn::Mul(taken, first.scale);
    const Vec then = second.taken(lower, minus(b[c], a[c], cross));
    b[c] = hn::Mul(then, second.scale);
    store(hn::Sub(upper, taken), r, packed(i, j + c));
    store(hn::Sub(lower, then), r, packed(i + 1, j + c));
  }
  for (size_t k = 0; k < rows; ++k) {
    const Vec v_k = load(v, k), w_k = load(w, k);
#pragma GCC unroll 4
    for (size_t c = 0; c < columns; ++c)
      store(minus(minus(load(x, c * rows + k), v_k, a[c]), w_k, b[c]), x, c * rows + k);
  }
}

// Absorbs the rows x (rows × cols, an even number of rows) into the packed triangle r.
HWY_INLINE void absorb(double* x, size_t rows, size_t cols, double* r) {
  const Tag tag;
  const Vec zero = hn::Zero(tag);
  size_t i = 0;
  for (; i + 2 <= cols; i += 2) {
    double *const v = x + i * rows * lanes, *const w = v + rows * lanes;
    Vec square[2] = {zero, zero}, product[2] = {zero, zero};
    for (size_t k = 0; k < rows; k += 2)
#pragma GCC unroll 2
      for (size_t h = 0; h < 2; ++h) {
        const Vec v_k = load(v, k + h);
        square[h] = plus(square[h], v_k, v_k);
        product[h] = plus(product[h], v_k, load(w, k + h));
      }
    const Reflection first(load(r, packed(i, i)), hn::Add(square[0], square[1]));
    store(first.beta, r, packed(i, i));
    const Vec upper = load(r, packed(i, i + 1)), taken = first.taken(upper, hn::Add(product[0], product[1]));
    store(hn::Sub(upper, taken), r, packed(i, i + 1));
    const Vec change = hn::Mul(taken, first.scale);
    square[0] = square[1] = product[0] = product[1] = zero;
    for (size_t k = 0; k < rows; k += 2)
#pragma GCC unroll 2
      for (size_t h = 0; h < 2; ++h) {
        const Vec v_k = load(v, k + h), w_k = minus(load(w, k + h), v_k, change);
        store(w_k, w, k + h);
        square[h] = plus(square[h], w_k, w_k);
        product[h] = plus(product[h], v_k, w_k);
      }
    const Reflection second(load(r, packed(i + 1, i + 1)), hn::Add(square[0], square[1]));
    store(second.beta, r, packed(i + 1, i + 1));
    const Vec cross = hn::Add(product[0], product[1]);
    const auto rest = [&](size_t j) { return x + j * rows * lanes; };
    size_t j = i + 2;
    for (; j + 4 <= cols; j += 4) reflect<4>(v, w, rest(j), rows, first, second, cross, r, i, j);
    for (; j + 2 <= cols; j += 2) reflect<2>(v, w, rest(j), rows, first, second, cross, r, i, j);
    for (; j < cols; ++j) reflect<1>(v, w, rest(j), rows, first, second, cross, r, i, j);
  }
  if (i == cols) return;
  Vec square[2] = {zero, zero};
  for (size_t k = 0; k < rows; k += 2)
    for (size_t h = 0; h < 2; ++h) {
      const Vec v_k = load(x, i * rows + k + h);
      square[h] = plus(square[h], v_k, v_k);
    }
  store(Reflection(load(r, packed(i, i)), hn::Add(square[0], square[1])).beta, r, packed(i, i));
}

}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#endif
// NOLINTEND(misc-definitions-in-headers)
