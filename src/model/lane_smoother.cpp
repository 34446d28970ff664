// SPDX-License-Identifier: BSD-3-Clause
#include "model/lane_smoother.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <utility>

#include "linalg/elementary.hpp"
#include "linalg/simd.hpp"
#include "model/smoother_covariances.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "model/lane_smoother.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "linalg/lanes-inl.hpp"

#ifndef TOKID_LANE_SMOOTHER_STEP
#define TOKID_LANE_SMOOTHER_STEP
namespace tokid::kalman {

constexpr size_t block = size_t(LaneSamples::lanes);

// One step: matrices of the model by columns, samples, and results. An array of the samples and results has `block`
// numbers for each entry.
struct LaneStep {
  size_t n, r, m, q;  // states, inputs, outputs, entries of the latent vector: the states, and the inputs if any misses
  const double *f, *h, *noise_q, *noise_r;
  const double *u, *y, *there, *variance, *measured, *on;
  double *predicted, *mean, *filtered, *smoother;  // predicted: of this step; the next one follows
  double *next_predicted, *next_mean;
};

}  // namespace tokid::kalman
#endif

// clang-format off
HWY_BEFORE_NAMESPACE();
// clang-format on
namespace tokid::linalg::HWY_NAMESPACE {
namespace lane_smoother {

using kalman::block;
using kalman::LaneStep;

HWY_INLINE Vec plus(Vec sum, Vec a, Vec b) { return hn::Add(sum, hn::Mul(a, b)); }
HWY_INLINE Vec minus(Vec sum, Vec a, Vec b) { return hn::Sub(sum, hn::Mul(a, b)); }
HWY_INLINE Vec get(const double* list, size_t entry) { return hn::Load(Tag(), list + entry * block); }
HWY_INLINE void put(Vec v, double* list, size_t entry) { hn::Store(v, Tag(), list + entry * block); }

// Matrices by columns: of a vector for each entry, or of a number that all lanes share.
struct Lanes {
  const double* at;
  size_t rows;
  Vec operator()(size_t i, size_t j) const { return get(at, j * rows + i); }
};
struct Shared {
  const double* at;
  size_t rows;
  Vec operator()(size_t i, size_t j) const { return hn::Set(Tag(), at[j * rows + i]); }
};
template <class M>
struct Transposed {
  M of;
  Vec operator()(size_t i, size_t j) const { return of(j, i); }
};
template <class M>
Transposed(M) -> Transposed<M>;

HWY_INLINE Vec none(size_t, size_t) { return hn::Zero(Tag()); }

// The rows i … i+tile-1 of column j of start + a b.
template <size_t tile, class A, class B, class Start>
HWY_INLINE void tile_of(const A& a, const B& b, size_t i, size_t j, size_t inner, const Start& start, Vec* sum) {
#pragma GCC unroll 4
  for (size_t c = 0; c < tile; ++c) sum[c] = start(i + c, j);
  for (size_t k = 0; k < inner; ++k) {
    const Vec b_k = b(k, j);
#pragma GCC unroll 4
    for (size_t c = 0; c < tile; ++c) sum[c] = plus(sum[c], a(i + c, k), b_k);
  }
}

// Calls body(i, tile) for all rows in tiles.
template <class Body>
HWY_INLINE void in_tiles(size_t i, size_t rows, Body&& body) {
  for (; i + 4 <= rows; i += 4) body(i, std::integral_constant<size_t, 4>());
  if (i + 2 <= rows) body(i, std::integral_constant<size_t, 2>()), i += 2;
  if (i < rows) body(i, std::integral_constant<size_t, 1>());
}

// out (rows × cols) = start + a b, where `start(i, j)` gives a vector. `out` may be where `start` is.
template <class A, class B, class Start>
HWY_INLINE void product(const A& a, const B& b, size_t rows, size_t inner, size_t cols, double* out,
                        const Start& start) {
  for (size_t j = 0; j < cols; ++j)
    in_tiles(0, rows, [&](size_t i, auto tile) {
      Vec sum[tile];
      tile_of<tile>(a, b, i, j, inner, start, sum);
      for (size_t c = 0; c < tile; ++c) put(sum[c], out, j * rows + i + c);
    });
}

// A symmetric out (n × n) = start + a b.
template <class A, class B, class Start>
HWY_INLINE void symmetric_product(const A& a, const B& b, size_t n, size_t inner, double* out, const Start& start) {
  for (size_t j = 0; j < n; ++j)
    in_tiles(j, n, [&](size_t i, auto tile) {
      Vec sum[tile];
      tile_of<tile>(a, b, i, j, inner, start, sum);
      for (size_t c = 0; c < tile; ++c) {
        put(sum[c], out, j * n + i + c);
        put(sum[c], out, (i + c) * n + j);
      }
    });
}

// out (n × n) = I - out
HWY_INLINE void subtract_from_identity(size_t n, double* out) {
  const Vec zero = hn::Zero(Tag()), one = hn::Set(Tag(), 1.0);
  for (size_t j = 0; j < n; ++j)
    for (size_t i = 0; i < n; ++i) put(hn::Sub(i == j ? one : zero, get(out, j * n + i)), out, j * n + i);
}

// The logarithm of a product of positive numbers, as mantissa and exponent, so that it can't overflow.
struct Product {
  Vec mantissa, invalid;
  hn::Vec<hn::RebindToUnsigned<Tag>> exponents;

  // GCC 12 compiles initialisers of members without the instruction set.
  Product()
      : mantissa(hn::Set(Tag(), 1.0)), invalid(hn::Zero(Tag())), exponents(hn::Zero(hn::RebindToUnsigned<Tag>())) {}
  void multiply(Vec factor) {
    const hn::RebindToUnsigned<Tag> integer;
    invalid = hn::Add(invalid, hn::Sub(factor, factor));  // NaN if the factor is not finite
    const auto bits = hn::BitCast(integer, hn::Mul(mantissa, factor));
    exponents = hn::Add(exponents, hn::Sub(hn::ShiftRight<52>(bits), hn::Set(integer, 1023)));
    mantissa = hn::BitCast(Tag(), hn::Or(hn::And(bits, hn::Set(integer, (std::uint64_t(1) << 52) - 1)),
                                         hn::Set(integer, std::uint64_t(1023) << 52)));
  }
};

// w (n × n) = the inverse of the lower Cholesky factor of s, as linalg::inverse_root(): a direction without variance
// has a zero row. Calls pivot(v) with each entry of the diagonal of the factor, or with 1.
template <class Pivot>
HWY_INLINE void inverse_root(const double* s, size_t n, double* w, Pivot&& pivot) {
  const Tag tag;
  const Vec zero = hn::Zero(tag), one = hn::Set(tag, 1.0);
  const Vec rounding = hn::Set(tag, 4 * std::numeric_limits<double>::epsilon() * double(n));
  const auto at = [&](size_t i, size_t j) { return j * n + i; };
  for (size_t j = 0; j < n; ++j) {
    const Vec variance = get(s, at(j, j));
    Vec rest = variance;
    for (size_t k = 0; k < j; ++k) rest = minus(rest, get(w, at(j, k)), get(w, at(j, k)));
    const auto counts = hn::Gt(rest, hn::Mul(rounding, variance));
    const Vec root = hn::Sqrt(hn::IfThenElse(counts, rest, one));
    const Vec inverse = hn::IfThenElseZero(counts, hn::Div(one, root));
    pivot(root);
    put(inverse, w, at(j, j));
    for (size_t i = j + 1; i < n; ++i) {
      Vec sum = get(s, at(i, j));
      for (size_t k = 0; k < j; ++k) sum = minus(sum, get(w, at(i, k)), get(w, at(j, k)));
      put(hn::Mul(sum, inverse), w, at(i, j));
      put(zero, w, at(j, i));
    }
  }
  for (size_t i = 1; i < n; ++i) {
    const Vec inverse = get(w, at(i, i));
    for (size_t j = 0; j < i; ++j) {
      Vec sum = zero;
      for (size_t k = j; k < i; ++k) sum = plus(sum, get(w, at(i, k)), get(w, at(k, j)));
      put(hn::Neg(hn::Mul(sum, inverse)), w, at(i, j));
    }
  }
}

// The work memory of a step: matrices of at most (n+r or m)² entries.
struct Work {
  double *p, *h, *hp, *s, *w, *left, *part, *sum, *smoothed, *next_smoothed;
  Work(double* memory, size_t size) {
    double** const all[] = {&p, &h, &hp, &s, &w, &left, &part, &sum, &smoothed, &next_smoothed};
    for (double** matrix : all) *matrix = std::exchange(memory, memory + size * block);
  }
};

// P (n × n) of the states → covariance of the latent vector, with the variances of missing inputs.
HWY_INLINE void extend(const LaneStep& step, const double* p, double* out) {
  const Vec zero = hn::Zero(Tag());
  for (size_t j = 0; j < step.q; ++j)
    for (size_t i = 0; i < step.q; ++i)
      put(i < step.n && j < step.n ? get(p, j * step.n + i)
          : i == j                 ? get(step.variance, i - step.n)
                                   : zero,
          out, j * step.q + i);
}

// The formulas are those of kalman::correct(), kalman::propagate() and Covariances::smooth_backwards(). A missing
// output has an independent innovation of zero with variance one.
HWY_INLINE void forward(const LaneStep& step, bool last, bool smooth, const Work& work, Product& volume, Vec& squares) {
  const Tag tag;
  const Vec one = hn::Set(tag, 1.0);
  const size_t n = step.n, m = step.m, q = step.q, all = n + step.r;
  const Shared f{step.f, n}, c{step.h, m}, noise{step.noise_r, m}, process{step.noise_q, n};
  for (size_t i = 0; i < n; ++i) put(get(step.predicted, i), step.mean, i);
  for (size_t i = 0; i < step.r; ++i) put(get(step.u, i), step.mean, n + i);
  double* const p = q > n ? work.part : work.p;
  if (q > n) extend(step, work.p, p);
  for (size_t i = 0; i < m; ++i) {
    const Vec there = get(step.there, i);
    for (size_t j = 0; j < q; ++j) put(hn::Mul(there, c(i, j)), work.h, j * m + i);
    for (size_t j = 0; j < m; ++j) put(hn::Mul(hn::Mul(there, get(step.there, j)), noise(i, j)), work.sum, j * m + i);
    put(hn::Add(get(work.sum, i * m + i), hn::Sub(one, there)), work.sum, i * m + i);
  }
  const Lanes h{work.h, m}, r{work.sum, m};
  product(h, Lanes{p, q}, m, q, q, work.hp, none);
  symmetric_product(Lanes{work.hp, m}, Transposed{h}, m, q, work.s, r);
  inverse_root(work.s, m, work.w, [&](Vec pivot) { volume.multiply(pivot); });
  const Lanes w{work.w, m};
  product(w, Lanes{work.hp, m}, m, m, q, work.s, none);
  double* const gain = work.hp;
  product(Transposed{Lanes{work.s, m}}, w, q, m, m, gain, none);
  const Lanes k{gain, q};

  for (size_t i = 0; i < m; ++i) {
    Vec e = get(step.y, i);
    for (size_t j = 0; j < all; ++j) e = minus(e, c(i, j), get(step.mean, j));
    put(hn::Mul(get(step.there, i), e), work.s, i);
  }
  for (size_t i = 0; i < m; ++i) {
    Vec white = hn::Zero(tag);
    for (size_t j = 0; j <= i; ++j) white = plus(white, w(i, j), get(work.s, j));
    squares = plus(squares, white, white);
  }
  for (size_t i = 0; i < q; ++i) {
    Vec mean = get(step.mean, i);
    for (size_t j = 0; j < m; ++j) mean = plus(mean, k(i, j), get(work.s, j));
    put(mean, step.mean, i);
  }

  product(k, h, q, m, q, work.left, none);
  subtract_from_identity(q, work.left);
  const Lanes left{work.left, q};
  product(left, Lanes{p, q}, q, q, q, work.s, none);
  symmetric_product(Lanes{work.s, q}, Transposed{left}, q, q, step.filtered, none);
  product(k, r, q, m, m, work.s, none);
  symmetric_product(Lanes{work.s, q}, Transposed{k}, q, m, step.filtered, Lanes{step.filtered, q});
  if (last) return;

  // An experiment that has ended continues with zeros, so that its numbers stay finite.
  const auto on = hn::Gt(get(step.on, 0), hn::Zero(tag));
  for (size_t i = 0; i < n; ++i) {
    Vec next = hn::Zero(tag);
    for (size_t j = 0; j < all; ++j) next = plus(next, f(i, j), get(step.mean, j));
    put(hn::IfThenElseZero(on, next), step.next_predicted, i);
  }
  product(f, Lanes{step.filtered, q}, n, q, q, work.hp, none);
  symmetric_product(Lanes{work.hp, n}, Transposed{f}, n, q, work.p, process);
  for (size_t i = 0; i < n * n; ++i) put(hn::IfThenElseZero(on, get(work.p, i)), work.p, i);
  if (!smooth) return;
  inverse_root(work.p, n, work.w, [](Vec) {});
  product(Lanes{work.w, n}, Lanes{work.hp, n}, n, n, q, work.s, none);
  product(Transposed{Lanes{work.s, n}}, Lanes{work.w, n}, q, n, n, step.smoother, none);
}

// Replaces the filtered mean by the smoothed one, and computes the covariance work.smoothed (q × q) from that of the
// next step.
HWY_INLINE void backward(const LaneStep& step, bool last, const Work& work) {
  const size_t n = step.n, q = step.q;
  if (last) {
    for (size_t i = 0; i < q * q; ++i) put(get(step.filtered, i), work.smoothed, i);
    return;
  }
  const Shared f{step.f, n}, process{step.noise_q, n};
  const Lanes j{step.smoother, q};
  product(j, f, q, n, q, work.left, none);
  subtract_from_identity(q, work.left);
  const Lanes left{work.left, q};
  product(left, Lanes{step.filtered, q}, q, q, q, work.part, none);
  symmetric_product(Lanes{work.part, q}, Transposed{left}, q, q, work.smoothed, none);
  for (size_t b = 0; b < n; ++b)
    for (size_t a = 0; a < n; ++a) put(hn::Add(process(a, b), get(work.next_smoothed, b * n + a)), work.sum, b * n + a);
  product(j, Lanes{work.sum, n}, q, n, n, work.part, none);
  symmetric_product(Lanes{work.part, q}, Transposed{j}, q, n, work.smoothed, Lanes{work.smoothed, q});
  for (size_t i = 0; i < q; ++i) {
    Vec mean = get(step.mean, i);
    for (size_t k = 0; k < n; ++k)
      mean = plus(mean, j(i, k), hn::Sub(get(step.next_mean, k), get(step.next_predicted, k)));
    put(mean, step.mean, i);
  }
}

// The second moments of [z; x⁺] and [z; y] of a step in each lane, in the order of LaneSmoother::add_moments(). A lane
// that has no x⁺ or y has zeros instead.
// Returns their number.
HWY_INLINE size_t terms(const LaneStep& step, bool last, const kalman::LaneSamples::Pattern& pattern, const Work& work,
                        double* const begin) {
  double* out = begin;
  const Tag tag;
  const Vec zero = hn::Zero(tag), one = hn::Set(tag, 1.0);
  const size_t n = step.n, m = step.m, q = step.q, l = n + step.r;
  const auto on = hn::Gt(get(step.on, 0), zero), measured = hn::Gt(get(step.measured, 0), zero);
  const Lanes smoothed{work.smoothed, q};
  const auto z = [&](size_t i) { return get(step.mean, i); };
  const auto add = [&](Vec term) { put(term, std::exchange(out, out + block), 0); };
  const auto cov = [&](size_t i, size_t j) { return i < q && j < q ? smoothed(i, j) : zero; };
  // [z; x⁺]
  for (size_t j = 0; j < l; ++j)
    for (size_t i = j; i < l; ++i) {
      const Vec term = plus(cov(i, j), z(i), z(j));
      put(term, work.s, j * l + i);
      add(hn::IfThenElseZero(on, term));
    }
  if (!last) {
    const Lanes next{work.next_smoothed, n};
    product(next, Transposed{Lanes{step.smoother, q}}, n, n, q, work.part, none);
    for (size_t j = 0; j < l; ++j)
      for (size_t i = 0; i < n; ++i)
        add(hn::IfThenElseZero(on, plus(j < q ? get(work.part, j * n + i) : zero, get(step.next_mean, i), z(j))));
    for (size_t j = 0; j < n; ++j)
      for (size_t i = j; i < n; ++i)
        add(hn::IfThenElseZero(on, plus(next(i, j), get(step.next_mean, i), get(step.next_mean, j))));
  }
  // [z; y]
  if (!pattern.counts_agree)
    for (size_t j = 0; j < l; ++j)
      for (size_t i = j; i < l; ++i) add(hn::IfThenElseZero(measured, get(work.s, j * l + i)));
  if (!pattern.misses_some_outputs) {
    for (size_t j = 0; j < l; ++j)
      for (size_t i = 0; i < m; ++i) add(hn::IfThenElseZero(measured, hn::Mul(get(step.y, i), z(j))));
    for (size_t j = 0; j < m; ++j)
      for (size_t i = j; i < m; ++i) add(hn::IfThenElseZero(measured, hn::Mul(get(step.y, i), get(step.y, j))));
    return size_t(out - begin) / block;
  }
  // Missing outputs follow from the available ones: y = L y + (I - L) [C D] z + noise. L = R_{·,there}
  // R_{there,there}⁻¹ in the columns of the available outputs.
  const Shared r{step.noise_r, m}, c{step.h, m};
  for (size_t j = 0; j < m; ++j)
    for (size_t i = 0; i < m; ++i) {
      const Vec both = hn::Mul(get(step.there, i), get(step.there, j));
      const Vec known = hn::Mul(both, r(i, j));
      put(i == j ? hn::Add(known, hn::Sub(one, both)) : known, work.sum, j * m + i);
      put(hn::Mul(get(step.there, j), r(i, j)), work.hp, j * m + i);
    }
  inverse_root(work.sum, m, work.w, [](Vec) {});
  const Lanes w{work.w, m};
  product(Lanes{work.hp, m}, Transposed{w}, m, m, m, work.left, none);
  product(Lanes{work.left, m}, w, m, m, m, work.hp, none);  // L
  for (size_t j = 0; j < m; ++j)
    for (size_t i = 0; i < m; ++i) {
      const Vec missing = hn::Sub(one, get(step.there, i));
      put(hn::Mul(missing, hn::Sub(i == j ? one : zero, get(work.hp, j * m + i))), work.sum, j * m + i);
    }
  const Lanes rest{work.sum, m};  // I - L in the rows of missing outputs
  product(rest, c, m, m, l, work.h, none);
  const Lanes map{work.h, m};
  double* const y = work.w;
  double* const noise = work.s;
  product(rest, r, m, m, m, work.left, none);
  symmetric_product(Lanes{work.left, m}, Transposed{rest}, m, m, noise, none);
  for (size_t i = 0; i < m; ++i) {
    Vec sum = zero;
    for (size_t j = 0; j < m; ++j) sum = plus(sum, get(work.hp, j * m + i), get(step.y, j));
    sum = plus(get(step.y, i), hn::Sub(one, get(step.there, i)), sum);
    for (size_t j = 0; j < l; ++j) sum = plus(sum, map(i, j), z(j));
    put(sum, y, i);
  }
  product(map, smoothed, m, q, q, work.part, none);  // covariance of y and the latent vector
  for (size_t j = 0; j < l; ++j)
    for (size_t i = 0; i < m; ++i)
      add(hn::IfThenElseZero(measured, plus(j < q ? get(work.part, j * m + i) : zero, get(y, i), z(j))));
  symmetric_product(Lanes{work.part, m}, Transposed{map}, m, q, noise, Lanes{noise, m});
  for (size_t j = 0; j < m; ++j)
    for (size_t i = j; i < m; ++i) add(hn::IfThenElseZero(measured, plus(get(noise, j * m + i), get(y, i), get(y, j))));
  return size_t(out - begin) / block;
}

// Sums over the lanes in an order that no instruction set changes.
HWY_INLINE void sum_lanes(const double* from, size_t entries, double* to) {
  for (size_t i = 0; i < entries; ++i, from += block)
    to[i] = ((from[0] + from[4]) + (from[2] + from[6])) + ((from[1] + from[5]) + (from[3] + from[7]));
}

LaneStep part_of(LaneStep step, size_t offset) {
  for (const double** in : {&step.u, &step.y, &step.there, &step.variance, &step.measured, &step.on}) *in += offset;
  for (double** out :
       {&step.predicted, &step.mean, &step.filtered, &step.smoother, &step.next_predicted, &step.next_mean})
    *out += offset;
  return step;
}

// `work` begins with the covariance of the initial state (n × n). Writes Σ log of the roots of the innovation
// covariances, and the sums of squares of the whitened innovations.
void Filter(const LaneStep* steps, size_t count, size_t size, bool smooth, double* work, double* log_root,
            double* squares) {
  for (size_t offset = 0; offset < block; offset += lanes) {
    const Work part(work + offset, size);
    Product volume;
    Vec sum = hn::Zero(Tag());
    for (size_t t = 0; t < count; ++t) forward(part_of(steps[t], offset), t + 1 == count, smooth, part, volume, sum);
    hn::StoreU(sum, Tag(), squares + offset);
    HWY_ALIGN double mantissa[lanes], invalid[lanes];
    HWY_ALIGN std::uint64_t exponents[lanes];
    hn::Store(volume.mantissa, Tag(), mantissa);
    hn::Store(volume.invalid, Tag(), invalid);
    hn::Store(volume.exponents, hn::RebindToUnsigned<Tag>(), exponents);
    for (size_t i = 0; i < lanes; ++i)
      log_root[offset + i] =
          linalg::log(mantissa[i]) + double(std::int64_t(exponents[i])) * std::numbers::ln2 + invalid[i];
  }
}

// Writes the sums of each step from `sums` on, `entries` apart, and the covariance of the first state to `first`.
void Smooth(const LaneStep* steps, const kalman::LaneSamples::Pattern* pattern, size_t count, size_t size, double* work,
            double* list, double* sums, size_t entries, double* first) {
  for (size_t t = count; t-- > 0;) {
    size_t terms_of_step = 0;
    for (size_t offset = 0; offset < block; offset += lanes) {
      const Work part(work + offset, size);
      const LaneStep step = part_of(steps[t], offset);
      backward(step, t + 1 == count, part);
      terms_of_step = terms(step, t + 1 == count, pattern[t], part, list + offset);
      double* const next = t == 0 ? first + offset : part.next_smoothed;
      for (size_t j = 0; j < step.n; ++j)
        for (size_t i = 0; i < step.n; ++i) put(get(part.smoothed, j * step.q + i), next, j * step.n + i);
    }
    sum_lanes(list, terms_of_step, sums + t * entries);
  }
}

}  // namespace lane_smoother
}  // namespace tokid::linalg::HWY_NAMESPACE
// clang-format off
HWY_AFTER_NAMESPACE();
// clang-format on

#if HWY_ONCE
namespace tokid::linalg {
namespace {
auto filter_kernel() { return TOKID_KERNEL(lane_smoother::Filter); }
auto smooth_kernel() { return TOKID_KERNEL(lane_smoother::Smooth); }
}  // namespace
}  // namespace tokid::linalg

namespace tokid::kalman {

namespace {

// The number of different second moments of a step, and of the entries of the largest matrix.
Index moments_of(Index n, Index r, Index m) {
  const Index l = n + r;
  return l * (l + 1) + n * l + n * (n + 1) / 2 + m * l + m * (m + 1) / 2;
}
Index largest(Index n, Index r, Index m) { return std::max(n + r, m) * std::max(n + r, m); }

constexpr Index matrices = 10;  // of the work memory
constexpr Index lanes = LaneSamples::lanes;

// Adds the next numbers to the lower triangle of a matrix, from its row and column `from` on, and to their mirror.
template <class M>
const double* add_triangle(const double* next, Index from, Index size, M&& sum) {
  for (Index j = 0; j < size; ++j)
    for (Index i = j; i < size; ++i, ++next) {
      sum(from + i, from + j) += *next;
      if (i != j) sum(from + j, from + i) += *next;
    }
  return next;
}

// Adds the next numbers to the rows from `from` on, and to their mirror.
template <class M>
const double* add_rows(const double* next, Index from, Index rows, Index cols, M&& sum) {
  for (Index j = 0; j < cols; ++j)
    for (Index i = 0; i < rows; ++i, ++next) {
      sum(from + i, j) += *next;
      sum(j, from + i) += *next;
    }
  return next;
}

}  // namespace

LaneSamples::LaneSamples(const Samples& samples, std::span<const SingleRow> members)
    : rows(members.begin(), members.end()),
      steps(std::ranges::max(members, {}, [](const SingleRow& one) { return one.group->end; }).group->end),
      pattern(size_t(steps)),
      memory(lanes, {{&u, steps * samples.u_square.size()},
                     {&y, steps * samples.y_square.size()},
                     {&there, steps * samples.y_square.size()},
                     {&variance, steps * samples.u_square.size()},
                     {&measured, steps},
                     {&on, steps}}) {
  const Index r = samples.u_square.size(), m = samples.y_square.size();
  for (Index lane = 0; lane < Index(rows.size()); ++lane) {
    const auto& [row, group] = rows[size_t(lane)];
    for (Index t = 0; t < group->end; ++t) {
      const size_t s = size_t(t);
      for (Index i = 0; i < r; ++i) u[(t * r + i) * lanes + lane] = samples.u[s](row, i);
      for (Index j = 0; j < m; ++j) y[(t * m + j) * lanes + lane] = samples.y[s](row, j);
      for (const Index i : group->unknowns[s]) variance[(t * r + i) * lanes + lane] = samples.u_square(i);
      for (const Index j : group->outputs[s]) there[(t * m + j) * lanes + lane] = 1.0;
      measured[t * lanes + lane] = group->outputs[s].empty() ? 0.0 : 1.0;
      on[t * lanes + lane] = t + 1 < group->end ? 1.0 : 0.0;
      outputs[size_t(lane)] += double(group->outputs[s].size());
      Pattern& step = pattern[s];
      step.misses_inputs |= !group->unknowns[s].empty();
      step.misses_some_outputs |= partly_missing(group->outputs[s], m);
      step.counts_agree &= measured[t * lanes + lane] == on[t * lanes + lane];
      step.measured += measured[t * lanes + lane];
      step.moved += on[t * lanes + lane];
    }
  }
}

LaneModel::LaneModel(const Model& model, Index steps)
    : n(model.n(model.k_begin)),
      r(model.inputs),
      m(model.outputs),
      x0_mean(Vector::Zero(n)),
      x0_cov(Matrix::Zero(n, n)) {
  const auto append = [](std::vector<double>& list, const auto& matrix) {
    list.insert(list.end(), matrix.data(), matrix.data() + matrix.size());
  };
  for (Index t = 0; t < steps; ++t) {
    const Step& step = model.step[size_t(t)];
    append(f, step.A());
    append(f, step.B());
    append(h, step.C());
    append(h, step.D());
    append(process, step.Q());
    append(measurement, step.R());
  }
  if (model.x0_mean.size() > 0) x0_mean = model.x0_mean;
  if (model.x0_cov.size() > 0) x0_cov = model.x0_cov;
}

LaneSmoother::LaneSmoother(Index steps, Index states, Index inputs, Index outputs)
    : n_(states),
      r_(inputs),
      m_(outputs),
      sums_(size_t(steps * moments_of(n_, r_, m_))),
      memory_(lanes, {{&predicted_, (steps + 1) * n_},
                      {&mean_, (steps + 1) * (n_ + r_)},
                      {&filtered_, steps * (n_ + r_) * (n_ + r_)},
                      {&smoother_, steps * (n_ + r_) * n_},
                      {&terms_, moments_of(n_, r_, m_)},
                      {&first_cov_, n_ * n_},
                      {&work_, matrices * largest(n_, r_, m_)}}) {}

std::vector<LaneStep> LaneSmoother::steps_of(const LaneModel& model, const LaneSamples& samples) const {
  const Index l = n_ + r_;
  std::vector<LaneStep> list;
  list.reserve(size_t(samples.steps));
  for (Index t = 0; t < samples.steps; ++t) {
    const auto of = [t](const double* all, Index size) { return all + t * size * lanes; };
    const auto at = [](double* all, Index size, Index step) { return all + step * size * lanes; };
    const bool misses_inputs = samples.pattern[size_t(t)].misses_inputs;
    list.push_back({size_t(n_),
                    size_t(r_),
                    size_t(m_),
                    size_t(misses_inputs ? l : n_),
                    model.f.data() + t * n_ * l,
                    model.h.data() + t * m_ * l,
                    model.process.data() + t * n_ * n_,
                    model.measurement.data() + t * m_ * m_,
                    of(samples.u, r_),
                    of(samples.y, m_),
                    of(samples.there, m_),
                    of(samples.variance, r_),
                    of(samples.measured, 1),
                    of(samples.on, 1),
                    at(predicted_, n_, t),
                    at(mean_, l, t),
                    at(filtered_, l * l, t),
                    at(smoother_, l * n_, t),
                    at(predicted_, n_, t + 1),
                    at(mean_, l, t + 1)});
  }
  return list;
}

void LaneSmoother::filter(const std::vector<LaneStep>& steps, const LaneModel& model, const LaneSamples& samples,
                          bool smooth, Vector& log_likelihood) {
  for (Index lane = 0; lane < lanes; ++lane) {
    for (Index i = 0; i < n_; ++i) predicted_[i * lanes + lane] = model.x0_mean(i);
    for (Index i = 0; i < n_ * n_; ++i) work_[i * lanes + lane] = model.x0_cov.data()[i];
  }
  double log_root[lanes], squares[lanes];
  linalg::filter_kernel()(steps.data(), steps.size(), size_t(largest(n_, r_, m_)), smooth, work_, log_root, squares);
  const double log_two_pi = std::log(2 * std::numbers::pi);
  for (size_t lane = 0; lane < samples.rows.size(); ++lane)
    log_likelihood(samples.rows[lane].row) =
        -0.5 * (squares[lane] + 2 * log_root[lane] + samples.outputs[lane] * log_two_pi);
}

void LaneSmoother::filter(const LaneModel& model, const LaneSamples& samples, Vector& log_likelihood) {
  filter(steps_of(model, samples), model, samples, false, log_likelihood);
}

void LaneSmoother::smooth(const LaneModel& model, const LaneSamples& samples, Vector& log_likelihood, Moments& sums) {
  const std::vector<LaneStep> steps = steps_of(model, samples);
  filter(steps, model, samples, true, log_likelihood);
  linalg::smooth_kernel()(steps.data(), samples.pattern.data(), steps.size(), size_t(largest(n_, r_, m_)), work_,
                          terms_, sums_.data(), size_t(moments_of(n_, r_, m_)), first_cov_);
  add_moments(samples, sums);
}

void LaneSmoother::add_moments(const LaneSamples& samples, Moments& sums) const {
  const Index l = n_ + r_;
  const bool together = sums.measured_count.size() == 1;  // all steps have one sum
  for (Index t = 0; t < samples.steps; ++t) {
    const Index place = together ? 0 : t;
    auto moved = sums.moved[size_t(place)], measured = sums.measured[size_t(place)];
    const LaneSamples::Pattern& pattern = samples.pattern[size_t(t)];
    const double* const z = sums_.data() + t * moments_of(n_, r_, m_);
    const double* next = add_triangle(z, 0, l, moved);
    if (t + 1 < samples.steps) {
      next = add_rows(next, l, n_, l, moved);
      next = add_triangle(next, l, n_, moved);
    }
    const double* const measured_z = pattern.counts_agree ? z : next;
    const double* const after = add_triangle(measured_z, 0, l, measured);
    next = add_rows(pattern.counts_agree ? next : after, l, m_, l, measured);
    add_triangle(next, l, m_, measured);
    sums.moved_count(place) += pattern.moved;
    sums.measured_count(place) += pattern.measured;
  }
  for (Index lane = 0; lane < Index(samples.rows.size()); ++lane) {
    if (samples.rows[size_t(lane)].group->end == 0) continue;
    Vector x0(n_);
    Matrix cov(n_, n_);
    for (Index i = 0; i < n_; ++i) x0(i) = mean_[i * lanes + lane];
    for (Index i = 0; i < n_ * n_; ++i) cov.data()[i] = first_cov_[i * lanes + lane];
    sums.x0 += x0;
    sums.x0_square += cov + x0 * x0.transpose();
    sums.x0_count += 1;
  }
}

}  // namespace tokid::kalman
#endif
