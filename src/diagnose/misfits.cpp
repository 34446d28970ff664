// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/misfits.hpp"

#include <algorithm>
#include <cmath>

#include "base/integers.hpp"
#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "data/rows.hpp"
#include "diagnose/outliers/sketch.hpp"

namespace tokid {

namespace {

// Number of innovations that the usual size of a step needs, and that an experiment must have.
constexpr Index for_median = 40, fewest_innovations = 6;

// (T) median of |ε_k| of output j, over these rows and over as many neighbouring steps as give enough innovations.
Vector usual_sizes(const Innovations& innovations, Index j, const std::vector<Index>& rows) {
  const Index T = Index(innovations.size()), reach = ceil_div(for_median, std::max<Index>(1, Index(rows.size()))) / 2;
  Vector result(T);
  for (Index k = 0; k < T; ++k) {
    std::vector<double> sizes;
    for (Index i = std::max<Index>(0, k - reach); i <= std::min(T - 1, k + reach); ++i)
      for (const Index n : rows)
        if (const double e = innovations[size_t(i)](n, j); !std::isnan(e)) sizes.push_back(std::abs(e));
    result(k) = statistics::median(std::move(sizes));
  }
  return result;
}

// Fills the sizes of one output, of experiments whose innovations are those of models of the same data.
void add_sizes(const Innovations& innovations, Index j, const std::vector<Index>& rows, const std::vector<char>& out,
               Sizes& result) {
  std::vector<Index> of_models;
  for (const Index n : rows)
    if (!out[size_t(n)]) of_models.push_back(n);
  const Vector of_step = usual_sizes(innovations, j, of_models);
  std::vector<double> sizes_of_models;
  for (const Index n : rows) {
    std::vector<double> sizes;
    for (size_t k = 0; k < innovations.size(); ++k)
      if (const double size = std::abs(innovations[k](n, j)) / of_step(Index(k)); std::isfinite(size))
        sizes.push_back(size);
    const Index count = Index(sizes.size());
    result.count(n, j) = double(count);
    if (count < fewest_innovations) continue;
    result.ratio(n, j) = trimmed_mean(std::move(sizes));
    if (!out[size_t(n)]) sizes_of_models.push_back(result.ratio(n, j));
  }
  const double typical = statistics::median(std::move(sizes_of_models));
  for (const Index n : rows) result.ratio(n, j) /= typical;
}

}  // namespace

Sizes innovation_sizes(const Innovations& innovations, const std::vector<char>& out, Index folds) {
  const Index N = Index(out.size()), m = innovations.empty() ? 0 : innovations.front().cols(),
              groups = std::max<Index>(1, folds);
  Sizes result{Matrix::Constant(N, m, nan), Matrix::Zero(N, m)};
  for (Index g = 0; g < groups; ++g) {
    const std::vector<Index> rows = fold_rows(N, g, groups);
    for (Index j = 0; j < m; ++j) add_sizes(innovations, j, rows, out, result);
  }
  return result;
}

namespace {

// An experiment with larger outputs than the others may have larger innovations, up to this factor.
constexpr double most_allowed = 10.0;

// (N) Thresholds of the sizes of one output. They are higher for experiments with few innovations.
Vector size_thresholds(const Vector& ratio, const Vector& count, const std::vector<char>& out, double tests) {
  std::vector<double> deviations, counts;
  for (Index n = 0; n < ratio.size(); ++n)
    if (!out[size_t(n)] && !std::isnan(ratio(n))) {
      deviations.push_back(std::abs(std::log(ratio(n))));
      counts.push_back(count(n));
    }
  const LogScatter scatter = log_scatter(std::move(deviations), tests);
  const double most = statistics::median(std::move(counts));
  Vector result(ratio.size());
  for (Index n = 0; n < ratio.size(); ++n)
    result(n) = std::exp(scatter.quantile * std::sqrt(scatter.variance + variance_of_few(count(n), most)));
  return result;
}

}  // namespace

Matrix misfit(const Sizes& sizes, const Matrix& response, const std::vector<char>& out) {
  const Index N = sizes.ratio.rows(), m = sizes.ratio.cols();
  Matrix result(N, m);
  for (Index j = 0; j < m; ++j) {
    const Vector threshold = size_thresholds(sizes.ratio.col(j), sizes.count.col(j), out, double(N * m));
    std::vector<double> responses;
    for (Index n = 0; n < N; ++n)
      if (!out[size_t(n)] && !std::isnan(response(n, j))) responses.push_back(response(n, j));
    const double typical = statistics::median(std::move(responses));
    for (Index n = 0; n < N; ++n) {
      const double relative = typical > 0 ? response(n, j) / typical : 1.0;
      const double allowed = std::isnan(relative) ? 1.0 : std::clamp(relative, 1.0, most_allowed);
      result(n, j) = sizes.ratio(n, j) / std::max(of_consequence, threshold(n) * allowed);
    }
  }
  return result;
}

}  // namespace tokid
