// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/dependence.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "base/statistics.hpp"
#include "data/check.hpp"
#include "data/extents.hpp"
#include "data/noise_of.hpp"
#include "data/rows.hpp"
#include "data/scales.hpp"
#include "data/subjects.hpp"
#include "data/unused.hpp"

namespace tokid {

namespace {

// The larger of these two numbers limits the operations of a search: a total, and a number for each sample.
constexpr double most_operations = 4e9;
constexpr double operations_per_sample = 200;
// Least number of sums minus the number of experiments in the basis. With fewer sums, a small residual may be chance.
constexpr Index most_spare = 16;
// The residual of a combination may exceed the rounding of its terms by this factor.
constexpr double slack = 3.0;
// A term is dropped if this adds less than this share of the allowed residual.
constexpr double counted = 0.5;
// A combination of at most this many terms is fitted again, without the other experiments of the basis.
constexpr Index most_fitted = 32;
// The part of a term that no other term explains must exceed rounding by this factor, also in two thirds of the record.
constexpr double visible = 8.0;
// A residual above this share of an experiment is not rounding.
constexpr double surely_apart = 0.1;
// Shares that differ by less than this factor count as equal. The order of the experiments then decides.
constexpr double tie = 1.1;
// If all combinations together have more terms than this for each experiment, they are verified at some of the steps
// only.
constexpr double most_verified = 50;

// For each experiment and channel (N × d), the mean squares per sample of the rounding error, and of the departure from
// the median over the experiments.
struct Sizes {
  Matrix rounding, departure;
  Vector unit;  // (d) size of a channel; infinite if the channel is zero everywhere
  // (N) means over the channels in these units; `share`: root mean square of an experiment
  Vector all_rounding, all_departure, share;
};

Sizes sizes_of(const Ensemble& e, const Scales& s) {
  const Index N = e.experiments(), d = e.channels();
  Sizes result{Matrix::Zero(N, d), s.own.array().square().matrix(), Vector(d), {}, {}, {}};
  Matrix raw = Matrix::Zero(N, d);
  for (Index c = 0; c < d; ++c)
    for (Index n = 0; n < N; ++n) {
      double count = 0;
      for (const Index k : s.steps) {
        const double x = e.samples()(n, k * d + c);
        if (!std::isfinite(x)) continue;
        raw(n, c) += x * x;
        // The mean square of a uniform distribution.
        result.rounding(n, c) += std::pow(s.precision_of(n, c).rounding(x), 2) / 3;
        ++count;
      }
      if (count > 0) raw(n, c) /= count, result.rounding(n, c) /= count;
      // Values of few digits may be exact, such as those of an input with two values. Then they have no rounding error.
      if (result.rounding(n, c) > coarsest_share * coarsest_share * s.departure(c) * s.departure(c))
        result.rounding(n, c) = 0.0;
      result.rounding(n, c) += rounding_of_sizes * rounding_of_sizes * raw(n, c);
    }
  for (Index c = 0; c < d; ++c) {
    const double size = s.departure(c) > 0 ? s.departure(c) : std::sqrt(raw.col(c).maxCoeff());
    result.unit(c) = size > 0 ? size : std::numeric_limits<double>::infinity();
  }
  const Vector weights = result.unit.array().square().inverse() / double(d);
  result.all_rounding = result.rounding * weights;
  result.all_departure = result.departure * weights;
  // If all experiments share a large motion, only the departures from this motion show which experiment is the sum. The
  // medians need several experiments.
  constexpr Index several = 8;
  const Vector all = raw * weights;
  const double usual = statistics::median({all.begin(), all.end()}),
               apart = statistics::median({result.all_departure.begin(), result.all_departure.end()});
  result.share = (N >= several && usual > 2 * apart ? result.all_departure : all).cwiseSqrt();
  constexpr double least = 1e-3;  // keeps shares above zero
  result.share = result.share.cwiseMax(least * result.share.maxCoeff());
  return result;
}

// Each experiment as a column of fewer numbers, which are sums of its samples with random signs. If an experiment is a
// combination of others, so is its column. The norms are about those of the experiments. Each third of the sums covers
// a third of the record.
struct Sketch {
  std::vector<Index> experiments;  // examined experiments, ascending
  Matrix sums;                     // (p × their number)
  double samples = 0;              // in each column
};

// The experiments that are examined, and the samples that all of these experiments have.
struct Complete {
  std::vector<Index> experiments;
  std::vector<bool> column;  // empty: all of them
  Index columns = 0;
};

// Takes experiments in the order of their missing samples, fewest first, as long as they have enough samples in common.
Complete complete_samples(const Ensemble& e) {
  const Index N = e.experiments(), C = e.samples().cols();
  Complete result;
  for (Index n = 0; n < N; ++n) result.experiments.push_back(n);
  std::vector<bool> gap(static_cast<size_t>(C));
  std::vector<Index> missing(static_cast<size_t>(N));
  for (Index c = 0; c < C; ++c) {
    if (std::isfinite(e.samples().col(c).sum())) continue;
    gap[size_t(c)] = true;
    for (Index n = 0; n < N; ++n) missing[size_t(n)] += !std::isfinite(e.samples()(n, c));
  }
  result.columns = C;
  if (std::none_of(gap.begin(), gap.end(), [](bool g) { return g; })) return result;
  std::vector<Index>& order = result.experiments;
  std::stable_sort(order.begin(), order.end(),
                   [&](Index a, Index b) { return missing[size_t(a)] < missing[size_t(b)]; });
  // `whole`: for each column, how many experiments from the beginning of this order have the sample. `count`: number of
  // columns for each value of `whole`.
  std::vector<Index> whole(static_cast<size_t>(C), N), count(static_cast<size_t>(N) + 1, 0);
  for (Index c = 0; c < C; ++c) {
    if (gap[size_t(c)])
      whole[size_t(c)] =
          std::find_if(order.begin(), order.end(), [&](Index n) { return !std::isfinite(e.samples()(n, c)); }) -
          order.begin();
    ++count[size_t(whole[size_t(c)])];
  }
  Index chosen = N, common = count[size_t(N)], any = C - count[0];
  while (chosen > 1 && common < std::min(2 * (chosen + most_spare), any / 2)) common += count[size_t(--chosen)];
  order.resize(size_t(chosen));
  std::sort(order.begin(), order.end());
  result.columns = common;
  result.column.resize(size_t(C));
  for (Index c = 0; c < C; ++c) result.column[size_t(c)] = whole[size_t(c)] >= chosen;
  return result;
}

// Random signs that are the same on every machine (splitmix64).
double sign(std::uint64_t i) {
  i = (i + 1) * 0x9e3779b97f4a7c15U;
  i = (i ^ (i >> 30U)) * 0xbf58476d1ce4e5b9U;
  i = (i ^ (i >> 27U)) * 0x94d049bb133111ebU;
  return (i >> 63U) != 0 ? -1.0 : 1.0;
}

Sketch sketch(const Ensemble& e, const Sizes& sizes) {
  Complete whole = complete_samples(e);
  const Index N = Index(whole.experiments.size()), C = whole.columns, d = e.channels();
  const double operations = std::max(most_operations, operations_per_sample * double(N) * double(C));
  const Index affordable = Index(std::sqrt(operations / double(4 * N)));
  const Index p = std::min({C, 2 * (N + most_spare), std::max(affordable, 8 * most_spare)});
  Sketch result;
  result.samples = double(C);
  Matrix sums = Matrix::Zero(e.experiments(), p);
  Index third = 0, i = 0;
  for (Index c = 0; c < e.samples().cols() && p > 0; ++c) {
    if (!whole.column.empty() && !whole.column[size_t(c)]) continue;
    while (i >= (third + 1) * C / 3) ++third;
    const Index begin = third * p / 3, count = (third + 1) * p / 3 - begin;
    if (count > 0)
      sums.col(begin + (i - third * C / 3) % count) +=
          (sign(std::uint64_t(i)) / sizes.unit(c % d)) * e.samples().col(c);
    ++i;
  }
  result.sums = sums(whole.experiments, Eigen::all).transpose();
  result.experiments = std::move(whole.experiments);
  return result;
}

// Searches the sketch for experiments that are combinations of others. Experiments are numbered as columns of the
// sketch.
class Combinations {
 public:
  Combinations(const Sketch& s, const Sizes& sizes) : s_(s), sizes_(sizes) {}

  struct Parts {
    std::vector<Index> basis, dependent;
  };

  // Goes through the experiments in their order. An experiment that is a combination of the basis is dependent. Every
  // other experiment is added to the basis, as long as the basis has room.
  Parts parts() const {
    const Index p = s_.sums.rows(), N = s_.sums.cols(), width = 32;
    const Index limit = std::min(N, p - std::min(most_spare, std::max<Index>(2, p / 4)));
    Parts result;
    if (limit < 1) return result;
    if (all_independent(limit)) {
      for (Index n = 0; n < limit; ++n) result.basis.push_back(n);
      return result;
    }
    Matrix q(p, limit), r = Matrix::Zero(limit, limit);
    Index K = 0;
    for (Index begin = 0; begin < N; begin += width) {
      const Index count = std::min(width, N - begin), before = K;
      Matrix a = s_.sums.middleCols(begin, count), t = Matrix::Zero(limit, count);
      for (int pass = 0; pass < 2; ++pass) {  // the second pass corrects rounding errors of the first
        const Matrix more = q.leftCols(K).transpose() * a;
        a.noalias() -= q.leftCols(K) * more;
        t.topRows(K) += more;
      }
      for (Index j = 0; j < count; ++j) {
        const Index n = begin + j;
        for (int pass = 0; pass < 2; ++pass) {
          const Vector more = q.middleCols(before, K - before).transpose() * a.col(j);
          a.col(j).noalias() -= q.middleCols(before, K - before) * more;
          t.col(j).segment(before, K - before) += more;
        }
        const double left = a.col(j).norm(), size = s_.sums.col(n).norm();
        if (size == 0) continue;
        if (K > 0 && left <= surely_apart * size) {
          const Vector weights = r.topLeftCorner(K, K).triangularView<Eigen::Upper>().solve(t.col(j).head(K));
          if (mean_square(left, p - K) <= allowed(n, result.basis, weights)) {
            result.dependent.push_back(n);
            continue;
          }
        }
        if (K == limit || left == 0) continue;
        q.col(K) = a.col(j) / left;
        r.col(K).head(K) = t.col(j).head(K);
        r(K, K) = left;
        ++K;
        result.basis.push_back(n);
      }
    }
    return result;
  }

  // The dependent experiments as combinations of the basis, without terms at rounding level and without combinations
  // that may be chance.
  std::vector<DependentExperiment> combinations(const Parts& parts) const {
    if (parts.dependent.empty()) return {};
    const Fit all = fit(parts.basis, parts.dependent);
    const Index K = Index(parts.basis.size());
    const Vector of_all = distances_of_thirds(parts.basis);
    std::vector<DependentExperiment> result;
    for (size_t i = 0; i < parts.dependent.size(); ++i) {
      const Index n = parts.dependent[i];
      const double bound = allowed(n, parts.basis, all.weights.col(Index(i)));
      std::vector<Index> terms, rows;
      for (Index b = 0; b < K; ++b)
        if (std::pow(all.weights(b, Index(i)) * all.distance(b), 2) > counted * counted * bound) {
          terms.push_back(b);
          rows.push_back(parts.basis[size_t(b)]);
        }
      if (rows.empty()) continue;
      // If the terms are few, a fit without the other experiments of the basis gives better weights.
      const bool few = Index(rows.size()) <= most_fitted;
      const Vector weights = few ? fit(rows, {n}).weights.col(0) : Vector(all.weights.col(Index(i))(terms));
      const double permitted = allowed(n, rows, weights), unit = permitted / (1 + weights.squaredNorm());
      const double left = (s_.sums.col(n) - s_.sums(Eigen::all, rows) * weights).norm();
      if (!(mean_square(left, s_.sums.rows() - Index(rows.size())) <= permitted)) continue;
      const auto clear = [&](const Vector& distance) {
        return distance.array().square().minCoeff() >= visible * visible * unit;
      };
      // The distance of a term to the other terms is at least its distance to the whole basis, which is cheaper.
      if (clear(of_all(terms)) || (few && clear(distances_of_thirds(rows))))
        result.push_back({n, std::move(rows), {weights.begin(), weights.end()}});
    }
    return result;
  }

  // Exchanges experiments between basis and combinations, until the experiments with the largest shares are
  // combinations. Among experiments with equal shares, the last one is a combination.
  Parts exchanged(const Parts& parts, const std::vector<DependentExperiment>& combinations) const {
    Parts result{parts.basis, {}};
    const Index K = Index(parts.basis.size()), D = Index(combinations.size());
    Matrix w = Matrix::Zero(K, D);  // weights in units of the shares
    for (Index j = 0; j < D; ++j) {
      const DependentExperiment& c = combinations[size_t(j)];
      result.dependent.push_back(c.experiment);
      for (size_t i = 0; i < c.of.size(); ++i) {
        const auto b = std::lower_bound(parts.basis.begin(), parts.basis.end(), c.of[i]) - parts.basis.begin();
        w(b, j) = c.weights[i] * share(c.of[i]) / share(c.experiment);
      }
    }
    const auto swap = [&](Index b, Index j) {
      std::swap(result.basis[size_t(b)], result.dependent[size_t(j)]);
      const double pivot = w(b, j);
      const Vector column = w.col(j);
      const Eigen::RowVectorXd row = w.row(b) / pivot;
      w.noalias() -= column * row;
      w.row(b) = row;
      w.col(j) = -column / pivot;
      w(b, j) = 1 / pivot;
    };
    for (Index swaps = 0; swaps < 4 * (K + D); ++swaps) {
      Index b = 0, j = 0;
      if (!(w.cwiseAbs().maxCoeff(&b, &j) > tie)) break;
      swap(b, j);
    }
    for (bool changed = true; changed;) {
      changed = false;
      for (Index j = 0; j < D && !changed; ++j)
        for (Index b = 0; b < K && !changed; ++b)
          if (std::abs(w(b, j)) >= 1 / tie && result.dependent[size_t(j)] < result.basis[size_t(b)])
            swap(b, j), changed = true;
    }
    // A dependent experiment without a valid combination may have one in the new basis.
    for (const Index n : parts.dependent)
      if (std::none_of(combinations.begin(), combinations.end(),
                       [&](const DependentExperiment& c) { return c.experiment == n; }))
        result.dependent.push_back(n);
    std::sort(result.basis.begin(), result.basis.end());
    std::sort(result.dependent.begin(), result.dependent.end());
    return result;
  }

 private:
  struct Fit {
    Matrix weights;   // (K × D)
    Vector distance;  // (K) root mean square distance of each column of the basis from the other columns
  };

  // True if no experiment is a combination of the first `limit` experiments before it. One factorisation shows this
  // much faster than the search, and few ensembles have dependent experiments.
  bool all_independent(Index limit) const {
    Matrix sums = s_.sums;
    const Matrix r = linalg::triangular_factor(sums);
    std::vector<Index> basis;
    for (Index n = 0; n < r.cols(); ++n) {
      const Index K = Index(basis.size());
      const double left = r.col(n).segment(K, std::min(n + 1, r.rows()) - K).norm(), size = s_.sums.col(n).norm();
      if (size == 0 || left == 0) return false;
      if (K > 0 && left <= surely_apart * size) {
        const Vector weights = r.topLeftCorner(K, K).triangularView<Eigen::Upper>().solve(r.col(n).head(K));
        if (mean_square(left, s_.sums.rows() - K) <= allowed(n, basis, weights)) return false;
      }
      if (K < limit) basis.push_back(n);
    }
    return true;
  }

  // Mean square per sample of a residual. `free`: number of sums minus the number of fitted weights.
  double mean_square(double norm, Index free) const {
    return norm * norm / s_.samples * double(s_.sums.rows()) / double(std::max<Index>(1, free));
  }

  Fit fit(const std::vector<Index>& basis, const std::vector<Index>& dependent) const {
    const Index K = Index(basis.size()), D = Index(dependent.size());
    Matrix all(s_.sums.rows(), K + D);
    all << s_.sums(Eigen::all, basis), s_.sums(Eigen::all, dependent);
    const Matrix r = linalg::triangular_factor(all);
    const auto triangle = r.topLeftCorner(K, K).triangularView<Eigen::Upper>();
    return {triangle.solve(r.topRightCorner(K, D)), distances_of(r.topLeftCorner(K, K), s_.sums.rows())};
  }

  // Root mean square distance of each column from the others, by the rows of R⁻¹. `r`: triangular factor R of this
  // number of sums.
  Vector distances_of(const Matrix& r, Index sums) const {
    const Index K = r.rows();
    const Matrix inverse = r.triangularView<Eigen::Upper>().solve(Matrix::Identity(K, K));
    const double samples = s_.samples * double(sums) / double(s_.sums.rows());
    const double scale = std::sqrt(double(sums) / double(std::max<Index>(1, sums - K + 1)) / samples);
    return scale * inverse.rowwise().norm().cwiseInverse();
  }

  // The smaller of the distances in the first two thirds and in the last two thirds of the record.
  Vector distances_of_thirds(const std::vector<Index>& columns) const {
    const Index p = s_.sums.rows();
    return distances(0, 2 * p / 3, columns).cwiseMin(distances(p / 3, p - p / 3, columns));
  }

  // Distance of each column from the span of the others, in `sums` sums from `begin` on; zero if these sums are too
  // few.
  Vector distances(Index begin, Index sums, const std::vector<Index>& columns) const {
    const Index K = Index(columns.size());
    if (sums < K + std::min(most_spare / 2, std::max<Index>(2, sums / 4))) return Vector::Zero(K);
    Matrix part = s_.sums(Eigen::seqN(begin, sums), columns);
    const Matrix r = linalg::triangular_factor(part);
    if ((r.diagonal().array() == 0).any()) return Vector::Zero(K);
    return distances_of(r, sums);
  }

  // Largest mean square of a residual that counts as rounding.
  double allowed(Index n, const std::vector<Index>& basis, const Vector& weights) const {
    double rounding = sizes_.all_rounding(row(n)), departure = sizes_.all_departure(row(n));
    for (size_t i = 0; i < basis.size(); ++i) {
      const double square = weights(Index(i)) * weights(Index(i));
      rounding += square * sizes_.all_rounding(row(basis[i]));
      departure += square * sizes_.all_departure(row(basis[i]));
    }
    return std::max(slack * slack * rounding, rounding_of_departures * rounding_of_departures * departure);
  }

  Index row(Index n) const { return s_.experiments[size_t(n)]; }
  double share(Index n) const { return sizes_.share(row(n)); }

  const Sketch& s_;
  const Sizes& sizes_;
};

// Verifies combinations by the samples that an experiment and all of its terms have. These must be at least half of the
// samples of the experiment.
std::vector<DependentExperiment> verified(const Ensemble& e, const Sizes& sizes,
                                          std::vector<DependentExperiment> combinations) {
  const Index C = e.samples().cols(), d = e.channels(), D = Index(combinations.size());
  Matrix square = Matrix::Zero(D, d), count = Matrix::Zero(D, d);
  Vector own = Vector::Zero(D);
  double terms = 0;
  for (const DependentExperiment& c : combinations) terms += double(c.of.size());
  // The stride counts steps, so that all channels have the same number of samples.
  const Index stride = std::max<Index>(1, Index(terms / (most_verified * double(e.experiments()))));
  for (Index k = 0; k < C / d; k += stride)
    for (Index c = 0; c < d; ++c) {
      const double* sample = e.samples().col(k * d + c).data();
      for (Index j = 0; j < D; ++j) {
        const DependentExperiment& made = combinations[size_t(j)];
        double apart = sample[made.experiment];
        if (!std::isfinite(apart)) continue;
        ++own(j);
        for (size_t i = 0; i < made.of.size(); ++i) apart -= made.weights[i] * sample[made.of[i]];
        if (!std::isfinite(apart)) continue;
        square(j, c) += apart * apart;
        ++count(j, c);
      }
    }
  std::vector<DependentExperiment> result;
  for (Index j = 0; j < D; ++j) {
    DependentExperiment& made = combinations[size_t(j)];
    bool holds = 2 * count.row(j).sum() >= own(j);
    for (Index c = 0; c < d; ++c) {
      double rounding = sizes.rounding(made.experiment, c), departure = sizes.departure(made.experiment, c);
      for (size_t i = 0; i < made.of.size(); ++i) {
        const double weight = made.weights[i] * made.weights[i];
        rounding += weight * sizes.rounding(made.of[i], c);
        departure += weight * sizes.departure(made.of[i], c);
      }
      const double bound =
          std::max(slack * slack * rounding, rounding_of_departures * rounding_of_departures * departure);
      holds = holds && square(j, c) <= bound * count(j, c);
    }
    if (holds) result.push_back(std::move(made));
  }
  return result;
}

// Were the sums made on purpose? Experiments without noise and with little excitation are also dependent, but each of
// them is a combination of all independent experiments.
bool chosen(const std::vector<DependentExperiment>& combinations, size_t independent) {
  return combinations.size() == 1 ||
         std::any_of(combinations.begin(), combinations.end(),
                     [&](const DependentExperiment& c) { return c.of.size() < independent; });
}

std::vector<DependentExperiment> made_of_others(const Ensemble& e, const Scales& s) {
  if (e.experiments() < 2 || e.steps() == 0 || e.outputs() == 0) return {};
  const Sizes sizes = sizes_of(e, s);
  const Sketch sums = sketch(e, sizes);
  const Combinations search(sums, sizes);
  Combinations::Parts parts = search.parts();
  std::vector<DependentExperiment> found = search.combinations(parts);
  for (size_t before = 0; found.size() > before;) {
    before = found.size();
    parts = search.exchanged(parts, found);
    found = search.combinations(parts);
  }
  if (found.empty()) return found;
  const auto row = [&](Index& n) { n = sums.experiments[size_t(n)]; };
  std::for_each(parts.basis.begin(), parts.basis.end(), row);
  for (DependentExperiment& c : found) {
    row(c.experiment);
    std::for_each(c.of.begin(), c.of.end(), row);
  }
  found = verified(e, sizes, std::move(found));
  if (found.empty()) return found;
  const Noise noise = noise_of(e, parts.basis, s);
  return noise == Noise::visible || (noise == Noise::unknown && chosen(found, parts.basis.size()))
             ? found
             : std::vector<DependentExperiment>();
}

}  // namespace

Dependence find_dependence(const Ensemble& ensemble) {
  check_samples(ensemble);
  return find_dependence(ensemble, scales(ensemble));
}

Dependence find_dependence(const Ensemble& ensemble, const Scales& scales) {
  Dependence result;
  result.combinations = made_of_others(ensemble, scales);
  std::vector<Index> dependent;
  for (const DependentExperiment& c : result.combinations) dependent.push_back(c.experiment);
  result.used = other_rows(ensemble.experiments(), dependent);
  return result;
}

Dependence dependence_beside(const Copies& copies, const Ensemble& ensemble) {
  if (Index(copies.used.size()) == ensemble.experiments()) return find_dependence(ensemble);
  const auto row = [&](Index& n) { n = copies.used[size_t(n)]; };
  Dependence result = find_dependence(ensemble.subset(copies.used));
  std::for_each(result.used.begin(), result.used.end(), row);
  for (DependentExperiment& c : result.combinations) {
    row(c.experiment);
    std::for_each(c.of.begin(), c.of.end(), row);
  }
  return result;
}

namespace {

// If no experiment has a sample, all of them stay, so that the checks of the samples say so.
void leave_out_empty(UsedExperiments& used, const Ensemble& ensemble) {
  const std::vector<Extent> all = extents(ensemble);
  for (Index n = 0; n < ensemble.experiments(); ++n)
    if (all[size_t(n)].begin == all[size_t(n)].end) used.empty.push_back(n);
  if (Index(used.empty.size()) == ensemble.experiments()) used.empty.clear();
  std::erase_if(used.dependent.used,
                [&](Index n) { return std::binary_search(used.empty.begin(), used.empty.end(), n); });
}

}  // namespace

UsedExperiments used_experiments(const Ensemble& ensemble) {
  const Scales s = scales(ensemble);
  UsedExperiments result{find_copies(ensemble, s), {}};
  const bool all = Index(result.copies.used.size()) == ensemble.experiments();
  result.dependent = all ? find_dependence(ensemble, s) : dependence_beside(result.copies, ensemble);
  leave_out_empty(result, ensemble);
  return result;
}

Findings findings_of(const Dependence& dependence, const Ensemble& e) {
  if (dependence.combinations.empty()) return {};
  Finding result{.kind = Finding::Kind::experiments_dependent, .numbers = {{"experiments", double(e.experiments())}}};
  for (const DependentExperiment& c : dependence.combinations) {
    result.experiments.push_back(experiment(e, c.experiment));
    result.groups.push_back(experiments(e, c.of));
  }
  return {std::move(result)};
}

Findings findings_of(const UsedExperiments& used, const Ensemble& ensemble) {
  Findings result;
  if (!used.empty.empty())
    result.push_back({.kind = Finding::Kind::experiments_empty,
                      .experiments = experiments(ensemble, used.empty),
                      .numbers = {{"experiments", double(ensemble.experiments())}}});
  append(result, findings_of(used.copies, ensemble));
  append(result, findings_of(used.dependent, ensemble));
  return result;
}

std::string remark_on_unused(const Ensemble& ensemble) {
  std::string text;
  if (ensemble.samples().array().isInf().any()) return text;  // its message names the sample
  for (const std::string& sentence : in_words(findings_of(used_experiments(ensemble), ensemble)))
    text += "; " + sentence;
  return text;
}

}  // namespace tokid
