// SPDX-License-Identifier: BSD-3-Clause
#include "data/pooled_windows.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <optional>

namespace tokid {

namespace {

// With fewer windows per column, a factorisation takes little time.
constexpr Index many_windows = 8;
// The smallest squared pivot relative to its column, and the smallest sum of squares of a channel relative to its
// largest one. Rounding errors are then far below the standard errors of what the windows determine.
constexpr double least_pivot = 1e-9, least_change = 1e-4;
// Samples of a channel in one product: few enough for the cache.
constexpr Index chunk_samples = 2560;
constexpr Index most_pieces = 16;

// Sums of products of windows from sums of products of samples.
class WindowProducts {
 public:
  WindowProducts(const Ensemble& data, Index lags, Index begin, Index end)
      : data_(data),
        lags_(lags),
        begin_(begin),
        end_(end),
        channels_(data.channels()),
        experiments_(data.experiments()) {}

  // Σ_k V_kᵀV_k. The block (a, b) is that of (a-1, b-1), without the first step and with the step after the last one.
  Matrix sum(const Execution& execution) const {
    const Index d = channels_, width = (lags_ + 1) * d;
    Matrix gram(width, width);
    gram.topRows(d) = first_rows(execution);
    const Matrix in = window(end_), out = window(begin_);
    for (Index a = 1; a <= lags_; ++a)
      for (Index b = a; b <= lags_; ++b) {
        auto block = gram.block(a * d, b * d, d, d);
        block = gram.block((a - 1) * d, (b - 1) * d, d, d);
        block += in.middleCols((a - 1) * d, d).transpose() * in.middleCols((b - 1) * d, d);
        block -= out.middleCols((a - 1) * d, d).transpose() * out.middleCols((b - 1) * d, d);
      }
    gram.triangularView<Eigen::StrictlyLower>() = gram.transpose();
    return gram;
  }

 private:
  // [v_{k-p} … v_{k-1}] (N × p·d), zero before the start of the experiments.
  Matrix window(Index k) const {
    const Index known = std::min(k, lags_) * channels_;
    Matrix result = Matrix::Zero(experiments_, lags_ * channels_);
    result.rightCols(known) = data_.samples().middleCols(k * channels_ - known, known);
    return result;
  }

  // Σ_j v_jᵀ [v_j … v_{j+p}] over the first steps j of all windows.
  Matrix first_rows(const Execution& execution) const {
    const Index first = std::max<Index>(0, begin_ - lags_), last = std::max(first, end_ - lags_);
    const Index pieces = std::clamp<Index>((last - first) / 256, 1, most_pieces);
    std::vector<Matrix> sums(size_t(pieces), Matrix::Zero(channels_, (lags_ + 1) * channels_));
    parallel_for(0, pieces, {execution.threads, {}}, [&](Index from, Index to) {
      for (Index i = from; i < to; ++i)
        add(first + i * (last - first) / pieces, first + (i + 1) * (last - first) / pieces, sums[size_t(i)]);
    });
    Matrix sum = sums.front();
    for (size_t i = 1; i < sums.size(); ++i) sum += sums[i];
    return sum;
  }

  void add(Index from, Index to, Matrix& sum) const {
    const Index d = channels_, N = experiments_, steps = std::max<Index>(1, chunk_samples / std::max<Index>(1, N));
    Matrix by_channel, products;
    for (Index now = from; now < to; now += steps) {
      const Index count = std::min(steps, to - now), all = count + lags_;
      by_channel.resize(all * N, d);  // the samples of each channel, step by step
      for (Index j = 0; j < all; ++j) by_channel.middleRows(j * N, N) = data_.samples().middleCols((now + j) * d, d);
      for (Index c = 0; c < d; ++c) {
        // Column b has the samples b steps later.
        const Eigen::Map<const Matrix, 0, Eigen::OuterStride<>> later(by_channel.col(c).data(), count * N, lags_ + 1,
                                                                      Eigen::OuterStride<>(std::max<Index>(1, N)));
        products.noalias() = by_channel.topRows(count * N).transpose() * later;
        for (Index b = 0; b <= lags_; ++b) sum.col(b * d + c) += products.col(b);
      }
    }
  }

  const Ensemble& data_;
  Index lags_, begin_, end_, channels_, experiments_;
};

// Empty if rounding errors may matter.
std::optional<Matrix> factor_of_products(const Matrix& gram, Index channels) {
  const Vector squares = gram.diagonal();
  for (Index c = 0; c < channels; ++c) {
    const auto own = squares(Eigen::seq(c, Eigen::last, channels));
    if (!(own.minCoeff() > least_change * own.maxCoeff())) return std::nullopt;
  }
  const Vector size = squares.cwiseSqrt();
  const Eigen::LLT<Matrix> cholesky(size.cwiseInverse().asDiagonal() * gram * size.cwiseInverse().asDiagonal());
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  Matrix factor = cholesky.matrixU();
  if (!(factor.diagonal().cwiseAbs2().minCoeff() > least_pivot)) return std::nullopt;
  factor *= size.asDiagonal();
  return factor;
}

}  // namespace

Matrix pooled_window_factor(const Windows& windows, Index lags, Index begin, Index end, const Execution& execution) {
  const Index width = (lags + 1) * windows.channels();
  const Ensemble* data = windows.ensemble();
  if (data && data->experiments() * (end - begin) >= many_windows * width && data->missing() == 0)
    if (auto factor = factor_of_products(WindowProducts(*data, lags, begin, end).sum(execution), windows.channels()))
      return *factor;
  linalg::RowStack stack(width);
  Matrix rows;
  for (Index k = begin; k < end; ++k) {
    windows.rows(k, lags, rows);
    stack.add(rows);
  }
  return stack.factor();
}

std::vector<Index> window_counts(const Windows& windows, Index lags, Index begin, Index end) {
  std::vector<Index> counts(size_t(std::max<Index>(0, end - begin)), windows.experiments());
  if (windows.ensemble() && windows.ensemble()->missing() == 0) return counts;
  for (size_t i = 0; i < counts.size(); ++i) counts[i] = windows.count(begin + Index(i), lags);
  return counts;
}

}  // namespace tokid
