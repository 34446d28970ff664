// Properties of windows and their factors, over sizes, lag orders, initial states, missing samples and mean motions.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/windows.hpp"

#include <gtest/gtest.h>

#include <functional>

#include "data/pooled_windows.hpp"
#include "testing.hpp"

namespace tokid::testing {
namespace {

struct Sample {
  const Ensemble& ensemble;
  Index lags;
  InitialState initial;
  Nominal nominal;  // any trajectory, not the mean
};

constexpr Index steps = 12;

// Experiments about a motion that is larger than they are. A gap of all experiments leaves some windows without rows.
Ensemble moving_experiments(const SystemSize& size, Index experiments, bool gaps, Random& random) {
  const auto seed = std::uint64_t(random.uniform(0, 1e9));
  Ensemble e = random_experiments(random_system(size, steps, 1.0, seed), experiments, seed + 1, 1.0);
  e.samples().rowwise() += 5.0 * random.matrix(1, e.samples().cols()).row(0);
  if (!gaps) return e;
  Eigen::Ref<Matrix> samples = e.samples();
  for (double& sample : samples.reshaped())
    if (random.uniform(0, 1) < 0.02) sample = nan;
  e.output(steps / 2).col(0).setConstant(nan);
  return e;
}

void for_each_sample(const std::function<void(const Sample&)>& check) {
  Random random(1);
  for (const SystemSize& size : {SystemSize{1, 1, 1}, {3, 2, 1}, {4, 1, 3}})
    for (const Index experiments : {1, 8, 60})
      for (const bool gaps : {false, true}) {
        const Ensemble e = moving_experiments(size, experiments, gaps, random);
        for (const Index lags : {Index{1}, Index{4}, steps - 1})
          for (const InitialState initial : {InitialState::zero, InitialState::unknown}) {
            SCOPED_TRACE(name(size) + ", N = " + std::to_string(experiments) + ", p = " + std::to_string(lags) +
                         (gaps ? ", gaps" : "") + (initial == InitialState::unknown ? ", unknown initial states" : ""));
            check({e, lags, initial, {random.matrix(steps, size.r), random.matrix(steps, size.m)}});
          }
      }
}

// [v_{k-p} … v_k] as tokid/windows.hpp defines it.
Matrix window(const Ensemble& e, Index k, Index lags) {
  const Index d = e.channels();
  std::vector<Index> complete;
  Matrix rows = Matrix::Zero(e.experiments(), (lags + 1) * d);
  for (Index n = 0; n < e.experiments(); ++n) {
    for (Index j = std::max<Index>(0, k - lags); j <= k; ++j)
      for (Index c = 0; c < d; ++c) rows(n, (lags - k + j) * d + c) = e.samples()(n, j * d + c);
    if (!rows.row(n).hasNaN()) complete.push_back(n);
  }
  return rows(complete, Eigen::all);
}

Matrix gram(const Matrix& a) { return a.transpose() * a; }

Matrix with_ones(const Matrix& window) {
  Matrix result = Matrix::Ones(window.rows(), window.cols() + 1);
  result.rightCols(window.cols()) = window;
  return result;
}

// What products of a factor may be off. A Householder factorisation moves each column by ε × rows × columns at worst,
// relative to its norm, and by far less on average. Successive steps share a factorisation, and its norm: hence all
// samples.
double tolerance(const Ensemble& e, Index lags, double factorisations = 1.0) {
  const Matrix known = e.samples().array().isNaN().select(0.0, e.samples());
  return factorisations * epsilon * double((lags + 1) * e.channels() + e.experiments()) *
         (known.squaredNorm() + double(e.experiments()));
}

// Statistics are sums over experiments: each of N additions rounds once.
void expect_same_statistics(const WindowFactors& found, const WindowFactors& needed) {
  EXPECT_EQ(found.experiments, needed.experiments);
  EXPECT_EQ(found.rows, needed.rows);
  EXPECT_EQ(found.count, needed.count);
  for (Index c = 0; c < needed.sum.size(); ++c) {
    const double n = needed.count(c), squares = needed.spread(c) + needed.sum(c) * needed.sum(c) / std::max(1.0, n);
    EXPECT_NEAR(found.sum(c), needed.sum(c), epsilon * n * std::sqrt(n * squares));
    EXPECT_NEAR(found.spread(c), needed.spread(c), epsilon * n * squares);
  }
}

TEST(Windows, OfAnEnsembleAreItsSamples) {
  for_each_sample([](const Sample& s) {
    const Windows windows(s.ensemble);
    for (Index k = 0; k < steps; ++k) {
      const Matrix needed = window(s.ensemble, k, s.lags);
      EXPECT_EQ(windows.rows(k, s.lags), needed) << k;
      EXPECT_EQ(windows.count(k, s.lags), needed.rows()) << k;
    }
  });
}

TEST(Windows, OfFactorsHaveTheProductsOfTheSamples) {
  for_each_sample([](const Sample& s) {
    const WindowFactors f = window_factors(s.ensemble, s.lags, s.initial);
    const Windows windows(f);
    const double most = tolerance(s.ensemble, s.lags);
    EXPECT_EQ(f.begin(), s.initial == InitialState::zero ? 0 : s.lags);
    for (Index k = 0; k < steps; ++k) {
      const Matrix all = window(s.ensemble, k, s.lags), r = f.of(k);
      EXPECT_TRUE(r.isUpperTriangular(0.0)) << k;
      EXPECT_EQ(f.rows[size_t(k)], k < f.begin() ? 0 : all.rows()) << k;
      EXPECT_LE((gram(r) - (k < f.begin() ? 0.0 : 1.0) * gram(with_ones(all))).norm(), most) << k;
      if (k < f.begin()) continue;
      EXPECT_EQ(windows.count(k, s.lags), all.rows()) << k;
      for (Index lags = 0; lags <= s.lags; ++lags) {  // shorter windows are the last columns
        const Index width = (lags + 1) * s.ensemble.channels();
        EXPECT_LE((gram(windows.rows(k, lags)) - gram(all.rightCols(width))).norm(), most) << k << ", " << lags;
      }
    }
  });
}

// The products of all windows of the steps begin … end-1.
Matrix pooled_gram(const Ensemble& e, Index lags, Index begin, Index end) {
  Matrix sum = Matrix::Zero((lags + 1) * e.channels(), (lags + 1) * e.channels());
  for (Index k = begin; k < end; ++k) sum += gram(window(e, k, lags));
  return sum;
}

void expect_pooled(const Ensemble& e, Index lags, Index begin, Index end) {
  const Matrix needed = pooled_gram(e, lags, begin, end), found = pooled_window_factor(e, lags, begin, end, {1, {}});
  EXPECT_TRUE(found.isUpperTriangular(0.0));
  // Each column is off relative to its own norm: by the roundings of its sums, or of its factorisation.
  const Vector norm = needed.diagonal().cwiseSqrt();
  const double most = epsilon * double(e.experiments() * e.steps() + needed.cols());
  const Matrix off = gram(found) - needed;
  for (Index i = 0; i < off.rows(); ++i)
    for (Index j = 0; j < off.cols(); ++j) EXPECT_LE(std::abs(off(i, j)), most * norm(i) * norm(j)) << i << ", " << j;
  for (const int threads : {2, 3}) EXPECT_EQ(pooled_window_factor(e, lags, begin, end, {threads, {}}), found);
}

// Enough windows for sums of products, and too few of them; all steps, and those in the middle.
TEST(PooledWindows, HaveTheProductsOfAllWindows) {
  for (const Index length : {40, 3000})
    for (const Index experiments : {1, 7}) {
      SCOPED_TRACE(length);
      Ensemble e = random_experiments(random_system({3, 2, 2}, length, 0.9, 5), experiments, 6, 1.0);
      for (const Index lags : {1, 4}) {
        expect_pooled(e, lags, 0, length);
        expect_pooled(e, lags, lags, length);
        expect_pooled(e, lags, 10, length - 7);
      }
      e.y(0, length / 2, 1) = nan;
      expect_pooled(e, 3, 0, length);
    }
}

// Sums of products would lose small differences: those of samples that die out, of an output without noise, and of a
// channel that is zero.
TEST(PooledWindows, KeepTheDigitsOfAFactorisation) {
  constexpr Index length = 2000, lags = 3;
  Random random(11);
  Ensemble decaying(2, length, 1, 1), exact = decaying, silent = decaying;
  for (Index k = 0; k < length; ++k)
    for (Index n = 0; n < 2; ++n) {
      const double u = random.uniform(-1, 1), size = std::exp(-0.5 * double(k));
      decaying.u(n, k, 0) = u * size;
      decaying.y(n, k, 0) = random.uniform(-1, 1) * size;
      exact.u(n, k, 0) = silent.u(n, k, 0) = u;
      exact.y(n, k, 0) = k > 0 ? 0.5 * exact.y(n, k - 1, 0) + exact.u(n, k - 1, 0) : 0.0;
      silent.y(n, k, 0) = 0.0;
    }
  for (const Ensemble* e : {&decaying, &exact, &silent}) expect_pooled(*e, lags, 0, length);
  const Matrix r = pooled_window_factor(exact, lags, lags, length, {1, {}});
  // y_k is determined by y_{k-1} and u_{k-1}: its own pivot is a rounding error, not the root of one.
  EXPECT_LE(std::abs(r(r.rows() - 1, r.cols() - 1)), 1e3 * epsilon * r.col(r.cols() - 1).norm());
}

TEST(PooledWindows, CountTheExperimentsOfEachStep) {
  Ensemble e = random_experiments(random_system({2, 1, 1}, 20, 0.9, 5), 4, 6, 1.0);
  EXPECT_EQ(window_counts(e, 2, 3, 6), (std::vector<Index>{4, 4, 4}));
  e.u(1, 5, 0) = nan;
  EXPECT_EQ(window_counts(e, 2, 4, 9), (std::vector<Index>{4, 3, 3, 3, 4}));
}

TEST(Windows, OfFactorsDepartFromAnyNominal) {
  for_each_sample([](const Sample& s) {
    const WindowFactors f = window_factors(s.ensemble, s.lags, s.initial);
    const Nominal mean = nominal_trajectory(s.ensemble), own = f.nominal();
    // Each of N additions of a mean rounds once.
    const double rounding = std::sqrt(tolerance(s.ensemble, s.lags) * epsilon * double(s.ensemble.experiments()));
    EXPECT_LE((own.u - mean.u).norm() + (own.y - mean.y).norm(), rounding);
    for (const Nominal& nominal : {own, s.nominal}) {
      const Ensemble rest = departures(s.ensemble, nominal);
      const Windows windows(f, &nominal);
      for (Index k = f.begin(); k < steps; ++k)
        EXPECT_LE((gram(windows.rows(k, s.lags)) - gram(window(rest, k, s.lags))).norm(),
                  tolerance(s.ensemble, s.lags) + tolerance(rest, s.lags))
            << k;
      EXPECT_LE((windows.channel_sizes() - Windows(rest).channel_sizes()).norm(), rounding);
    }
    EXPECT_LE((Windows(f).channel_sizes() - Windows(s.ensemble).channel_sizes()).norm(), rounding);
  });
}

// In whatever portions, in whatever order.
TEST(WindowFactors, MergeToThoseOfAllExperiments) {
  for_each_sample([](const Sample& s) {
    const Index n = s.ensemble.experiments();
    const auto part = [&](Index begin, Index end) {
      return window_factors(s.ensemble.subset(range(begin, end)), s.lags, s.initial);
    };
    const WindowFactors whole = window_factors(s.ensemble, s.lags, s.initial);
    WindowFactors in_order = part(0, n / 4), backwards = part(n / 2, n), rest = part(n / 4, n / 4 + n / 4);
    merge(in_order, rest);
    merge(in_order, backwards);
    merge(rest, part(0, n / 4));
    merge(backwards, rest, {3, {}});
    for (const WindowFactors& merged : {in_order, backwards}) {
      expect_same_statistics(merged, whole);
      for (Index k = 0; k < steps; ++k) {
        EXPECT_LE((gram(merged.of(k)) - gram(whole.of(k))).norm(), tolerance(s.ensemble, s.lags, 3.0)) << k;
        EXPECT_TRUE(Matrix(merged.of(k)).isUpperTriangular(0.0));
      }
    }
  });
}

TEST(WindowFactors, AreTheSameForAnyNumberOfThreads) {
  for_each_sample([](const Sample& s) {
    const WindowFactors one = window_factors(s.ensemble, s.lags, s.initial);
    const WindowFactors three = window_factors(s.ensemble, s.lags, s.initial, {3, {}});
    EXPECT_EQ(one.factor, three.factor);
    EXPECT_EQ(one.rows, three.rows);
  });
}

// Rounding errors of a channel that never departs would pass for motion of a channel in other units.
TEST(Windows, ChannelsThatEqualTheirMeanDepartByNothing) {
  Random random(2);
  Ensemble e = moving_experiments({3, 2, 2}, 30, false, random);
  for (Index k = 0; k < steps; ++k) e.input(k).col(1).setConstant(1e3 * random.normal());
  const WindowFactors f = window_factors(e, 3, InitialState::zero);
  const Nominal mean = f.nominal();
  const Windows windows(f, &mean);
  for (Index k = 0; k < steps; ++k) {
    const Matrix rows = windows.rows(k, 3);
    for (Index j = 0; j < 4; ++j) {
      EXPECT_EQ(rows.col(4 * j + 1).norm(), 0.0);
      if (k + j >= 3) {
        EXPECT_GT(rows.col(4 * j).norm(), 1.0);
      }
    }
  }
}

TEST(WindowFactors, RefuseOtherLagOrdersAndKinds) {
  Random random(3);
  const Ensemble e = moving_experiments({3, 2, 1}, 9, false, random);
  for (const Index lags : {Index{0}, steps})
    EXPECT_EQ(message([&] { window_factors(e, lags, InitialState::zero); }),
              "lags: " + std::to_string(lags) + " found, 1 to 11 needed");
  WindowFactors f = window_factors(e, 2, InitialState::zero);
  EXPECT_EQ(message([&] { Windows(f).rows(5, 3); }), "lags: 3 found, the window factors permit at most 2");
  EXPECT_EQ(message([&] { merge(f, window_factors(e, 3, InitialState::zero)); }),
            "lag order: 3 found, 2 needed as in the earlier experiments");
  EXPECT_EQ(message([&] { merge(f, window_factors(e, 2, InitialState::unknown)); }),
            "initial states: unknown found, zero needed as in the earlier experiments");
  Ensemble other = e;
  other.names.output_units = {"", "rad"};
  f.names.output_units = {"m", "deg"};
  EXPECT_EQ(message([&] { merge(f, window_factors(other, 2, InitialState::zero)); }),
            "unit: rad found, deg needed as in the earlier experiments");
  EXPECT_EQ(f.experiments, 9);
}

}  // namespace
}  // namespace tokid::testing
