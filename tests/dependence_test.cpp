// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/dependence.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <numeric>
#include <set>

#include "testing.hpp"
#include "tokid/cross_validate.hpp"
#include "tokid/identify.hpp"
#include "tokid/provenance.hpp"
#include "tokid/refine_model.hpp"
#include "tokid/uncertainty.hpp"
#include "tokid/update.hpp"

namespace tokid::testing {
namespace {

using Rows = std::vector<Index>;

Rows rows(Index begin, Index end) {
  Rows list(static_cast<size_t>(end - begin));
  std::iota(list.begin(), list.end(), begin);
  return list;
}

Ensemble campaign(const SystemSize& size, Index experiments, Index steps, std::uint64_t seed, double noise,
                  double initial = 0.0) {
  const Ensemble e = random_experiments(random_system(size, steps, 0.9, seed), experiments, seed + 100, initial);
  return noise > 0 ? with_noise(e, noise, seed + 200) : e;
}

// The experiments and more that are combinations of them: a row of weights for each.
Ensemble with(const Ensemble& e, const Matrix& weights) {
  const Index N = e.experiments();
  Rows order = rows(0, N);
  order.resize(size_t(N + weights.rows()), 0);
  Ensemble result = e.subset(order);
  result.samples().bottomRows(weights.rows()) = weights * e.samples();
  return result;
}

// Sums of neighbours, a multiple, a difference, the mean of all and a mixture of all.
Matrix some_of_each(Index N, std::uint64_t seed) {
  Matrix weights = Matrix::Zero(N / 2 + 4, N);
  for (Index i = 0; i < N / 2; ++i) weights(i, i) = weights(i, i + 1) = 1.0;
  weights(N / 2, N - 1) = 2.0;
  weights(N / 2 + 1, 0) = 1.0, weights(N / 2 + 1, N - 1) = -1.0;
  weights.row(N / 2 + 2).setConstant(1 / double(N));
  weights.row(N / 2 + 3) = Random(seed).matrix(1, N);
  return weights;
}

Ensemble as_text(Ensemble e, const char* format) {
  for (Index c = 0; c < e.samples().cols(); ++c)
    for (Index n = 0; n < e.experiments(); ++n) {
      char text[64];
      std::snprintf(text, sizeof text, format, e.samples()(n, c));
      e.samples()(n, c) = std::atof(text);
    }
  return e;
}

Ensemble in_single_precision(Ensemble e) {
  e.samples() = e.samples().cast<float>().cast<double>().eval();
  return e;
}

Ensemble far_from_zero(Ensemble e, double size, std::uint64_t seed) {
  Random random(seed);
  for (Index c = 0; c < e.samples().cols(); ++c) e.samples().col(c).array() += size * random.normal();
  return e;
}

std::string described(const SystemSize& size, Index N, Index T, double noise, std::uint64_t seed) {
  return name(size) + ", N " + std::to_string(N) + ", T " + std::to_string(T) + ", noise " + std::to_string(noise) +
         ", seed " + std::to_string(seed);
}

void expect_found(const Ensemble& all, Index originals, const std::string& what) {
  EXPECT_EQ(find_dependence(all).used, rows(0, originals)) << what;
}

void expect_none(const Ensemble& all, const std::string& what) {
  const UsedExperiments used = used_experiments(all);  // copies are another matter
  EXPECT_EQ(used.dependent.used, used.copies.used) << what;
}

TEST(Dependence, IsFoundInWhatMakesNoise) {
  for (const SystemSize& size : {SystemSize{2, 1, 1}, SystemSize{3, 2, 1}, SystemSize{4, 2, 3}})
    for (const Index N : {8, 20, 40})
      for (const Index T : {60, 200})
        for (const double noise : {1e-3, 1e-2, 0.3})
          for (const std::uint64_t seed : {1, 2}) {
            if (noise < 1e-2 && N == 40 && T == 60) continue;  // two thirds have hardly more samples than experiments
            const std::string what = described(size, N, T, noise, seed);
            const Ensemble e = campaign(size, N, T, seed, noise, seed == 2 ? 1.0 : 0.0);
            const Matrix weights = some_of_each(N, seed);
            const Ensemble all = with(e, weights);
            expect_found(all, N, what);
            expect_found(in_single_precision(all), N, what + ", single precision");
            expect_found(with(far_from_zero(e, 3.0, seed), weights), N, what + ", nominal motion");
            expect_none(e, what);
          }
}

TEST(Dependence, HasTheWeights) {
  const Ensemble e = campaign({3, 2, 1}, 12, 60, 1, 0.05);
  const Matrix weights = some_of_each(12, 1);
  const Dependence found = find_dependence(with(e, weights));
  ASSERT_EQ(found.combinations.size(), size_t(weights.rows()));
  for (Index i = 0; i < weights.rows(); ++i) {
    const DependentExperiment& c = found.combinations[size_t(i)];
    EXPECT_EQ(c.experiment, 12 + i);
    Vector all = Vector::Zero(12);
    for (size_t t = 0; t < c.of.size(); ++t) all(c.of[t]) = c.weights[t];
    // Solutions of well conditioned equations: rounding of sums of 360 samples.
    EXPECT_LT((all - weights.row(i).transpose()).cwiseAbs().maxCoeff(), 1e4 * epsilon);
    EXPECT_EQ(Index(c.of.size()), (weights.row(i).array() != 0).count());
  }
}

// Noise of 0.1 beside digits that resolve 10⁻⁴ and six digits.
TEST(Dependence, IsFoundInTextOfFewDigits) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Ensemble e = campaign({3, 2, 1}, 12, 100, seed, 0.1);
    const Ensemble all = with(e, some_of_each(12, seed));
    for (const char* format : {"%.4f", "%.6g"}) {
      expect_found(as_text(all, format), 12, format);
      expect_found(with(as_text(e, format), some_of_each(12, seed)), 12, format);
      expect_none(as_text(e, format), format);
    }
    // Digits that hide the noise tell nothing.
    expect_none(as_text(all, "%.0f"), "%.0f");
  }
}

// Sums go, wherever they stand: they are the larger part of what they have in common with their terms.
TEST(Dependence, SparesTheTermsOfSumsThatComeFirst) {
  for (const std::uint64_t seed : {1, 2, 3})
    for (const double nominal : {0.0, 3.0}) {
      const Ensemble e = far_from_zero(campaign({3, 2, 1}, 16, 80, seed, 0.05), nominal, seed);
      Matrix weights = Matrix::Zero(5, 16);
      for (Index i = 0; i < 4; ++i) weights(i, 3 * i) = weights(i, 3 * i + 1) = 1.0;
      weights.row(4).setConstant(1.0 / 16);
      Rows order = rows(16, 21);
      for (Index n = 0; n < 16; ++n) order.push_back(n);
      EXPECT_EQ(find_dependence(with(e, weights).subset(order)).used, rows(5, 21)) << seed << ", " << nominal;
    }
}

TEST(Dependence, IsFoundBesideMissingSamples) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    Ensemble e = campaign({3, 2, 1}, 12, 200, seed, 0.05);
    Random random(seed);
    for (Index n = 0; n < 12; ++n)
      for (Index k = 0; k < 200; ++k)
        if (random.uniform(0, 1) < 0.05) e.y(n, k, 1) = nan;
    for (Index k = 150; k < 200; ++k) e.y(3, k, 0) = e.y(3, k, 1) = e.u(3, k, 0) = nan;
    expect_none(e, "gaps");
    Matrix weights = Matrix::Zero(2, 12);
    weights(0, 1) = weights(0, 2) = weights(1, 3) = 1.0, weights(1, 7) = 0.5;
    Ensemble pairs = e.subset([] {
      Rows order = rows(0, 12);
      order.insert(order.end(), {0, 0});
      return order;
    }());
    for (Index i = 0; i < 2; ++i) {
      pairs.samples().row(12 + i).setZero();
      for (Index n = 0; n < 12; ++n)
        if (weights(i, n) != 0) pairs.samples().row(12 + i) += weights(i, n) * e.samples().row(n);
    }
    for (Index k = 0; k < 200; k += 9) pairs.y(12, k, 0) = nan;  // and some of their own
    expect_found(pairs, 12, "sums with gaps");
    // Nothing is known of experiments without samples in common.
    Ensemble apart = pairs;
    for (Index k = 0; k < 200; ++k)
      for (Index c = 0; c < 3; ++c) {
        const Index column = 3 * k + c;
        if (k >= 100) apart.samples()(12, column) = apart.samples()(13, column) = nan;
        if (k < 100) apart.samples()(1, column) = apart.samples()(3, column) = nan;
      }
    expect_none(apart, "nothing in common");
  }
}

TEST(Dependence, GoesWithCopies) {
  const Ensemble e = campaign({3, 2, 1}, 12, 60, 4, 0.05);
  Ensemble all = with(e, some_of_each(12, 4));
  Rows order{5, 0, 5};
  for (Index n = 0; n < all.experiments(); ++n) order.push_back(n);
  order.push_back(14);  // a sum, once more
  all = all.subset(order);
  const UsedExperiments used = used_experiments(all);
  EXPECT_EQ(used.copies.groups, (std::vector<Rows>{{0, 2, 8}, {1, 3}, {17, Index(order.size()) - 1}}));
  EXPECT_EQ(used.rows(), (Rows{0, 1, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14}));
  EXPECT_EQ(used.dependent.combinations.front().experiment, 15);
  EXPECT_EQ(used.dependent.combinations.front().of, (Rows{1, 4}));
  EXPECT_EQ(findings_of(used, all).size(), 2);
}

// Without noise experiments are combinations of each other, whether somebody made them or the system did.
TEST(Dependence, LeavesDataWithoutNoiseAlone) {
  for (const SystemSize& size : {SystemSize{2, 1, 1}, SystemSize{3, 2, 1}, SystemSize{4, 2, 3}})
    for (const Index T : {10, 20, 60})
      for (const Index N : {5, 12, 40, 100})
        for (const std::uint64_t seed : {1, 2}) {
          const std::string what = described(size, N, T, 0.0, seed);
          const Ensemble e = campaign(size, N, T, seed, 0.0);
          expect_none(e, what);
          expect_none(in_single_precision(e), what + ", single precision");
          expect_none(as_text(e, "%.5g"), what + ", five digits");
          expect_none(with(e, some_of_each(N, seed)), what + ", sums");
          expect_none(far_from_zero(e, 3.0, seed), what + ", nominal motion");
          expect_none(campaign(size, N, T, seed, 0.0, 1.0), what + ", initial states");
          // Amplitudes of a few courses of the inputs.
          const Ensemble few = campaign(size, 3, T, seed, 0.0);
          Ensemble scaled = few.subset(Rows(size_t(N), 0));
          scaled.samples() = Random(seed).matrix(N, 3) * few.samples();
          expect_none(scaled, what + ", designed");
        }
  // From initial states that nobody knows it takes experiments for a window.
  for (const std::uint64_t seed : {1, 2, 3})
    expect_none(with(campaign({2, 1, 1}, 20, 40, seed, 0.0, 1.0), some_of_each(20, seed)), "sums, initial states");
}

// Inputs may be repeated, multiplied and added: the noise of the outputs is what counts.
TEST(Dependence, SparesDesignedInputs) {
  for (const double noise : {1e-4, 1e-2, 1.0})
    for (const Index courses : {1, 2, 5})
      for (const Index T : {10, 50})
        for (const std::uint64_t seed : {1, 2, 3}) {
          const Ensemble few = campaign({3, 2, 1}, courses, T, seed, 0.0);
          Ensemble e = few.subset(Rows(60, 0));
          e.samples() = Random(seed).matrix(60, courses) * few.samples();
          expect_none(with_noise(e, noise, seed), "designed");
          Rows again(60);
          for (Index n = 0; n < 60; ++n) again[size_t(n)] = n % courses;
          expect_none(with_noise(few.subset(again), noise, seed), "repeated");
        }
}

TEST(Dependence, IsNoAccident) {
  int wrong = 0;
  for (std::uint64_t seed = 1; seed <= 300; ++seed) {
    Random random(seed);
    const auto between = [&](double a, double b) { return Index(random.uniform(a, b)); };
    const SystemSize size{between(1, 6), between(1, 4), between(1, 4)};
    Ensemble e = campaign(size, between(2, 80), between(6, 60), seed, std::pow(10.0, random.uniform(-5, 0)),
                          random.uniform(0, 1) < 0.5 ? 0.0 : 1.0);
    const double kind = random.uniform(0, 4);
    if (kind < 1) e = in_single_precision(std::move(e));
    if (kind > 3) e = as_text(std::move(e), "%.4g");
    wrong += !find_dependence(e).combinations.empty();
  }
  EXPECT_EQ(wrong, 0);
}

// Noise of a few dimensions, of which more experiments than dimensions are combinations by their number alone.
TEST(Dependence, SparesSmoothNoise) {
  for (const std::uint64_t seed : {1, 2, 3})
    for (const Index N : {10, 40, 120}) {
      const Index T = 120, shapes = 15;
      Ensemble e = campaign({3, 2, 1}, N, T, seed, 0.0);
      for (Index k = 0; k < T; ++k) e.input(k).rowwise() = Eigen::RowVectorXd(e.input(k).row(0));
      Random random(seed);
      const Matrix weights = random.matrix(N, shapes), more = random.matrix(N, shapes);
      for (Index k = 0; k < T; ++k)
        for (Index b = 0; b < shapes; ++b) {
          const double wave = std::cos(M_PI * double(b) * (double(k) + 0.5) / double(T));
          e.output(k).col(0) += wave * weights.col(b);
          e.output(k).col(1) += wave * more.col(b);
        }
      expect_none(e, "smooth noise of " + std::to_string(N));
    }
}

// More experiments than samples of each: what is made of few is found all the same, where its terms are among the
// first.
TEST(Dependence, OfFewTermsIsFoundWhereExperimentsOutnumberSamples) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Ensemble e = campaign({2, 1, 1}, 150, 30, seed, 0.1);
    expect_none(e, "more experiments than samples");
    Matrix weights = Matrix::Zero(3, 150);
    weights(0, 3) = weights(0, 8) = 1.0, weights(1, 5) = -2.0, weights(2, 0) = 0.5, weights(2, 1) = 0.5;
    expect_found(with(e, weights), 150, "few terms");
    // Any number of them where the samples outnumber the originals.
    expect_found(with(campaign({2, 1, 1}, 15, 30, seed, 0.1), Random(seed).matrix(100, 15)), 15, "many");
  }
}

// Inputs of two values, or of whole numbers, have few digits, and sums of them have no more rounding than they.
TEST(Dependence, IsFoundBesideInputsOfFewValues) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed)
    for (const double levels : {1.0, 3.0}) {
      const Model system = random_system({3, 2, 1}, 60, 0.9, seed);
      Ensemble inputs = random_experiments(system, 20, seed);
      for (Index k = 0; k < 60; ++k)
        inputs.input(k) = inputs.input(k).unaryExpr(
            [&](double u) { return levels == 1.0 ? (u < 0 ? -1.0 : 1.0) : std::round(u * levels); });
      const Ensemble e = with_noise(simulate(system, inputs), 0.05, seed);
      EXPECT_TRUE(find_dependence(e).combinations.empty()) << seed << ' ' << levels;
      Matrix weights = Matrix::Zero(1, 20);
      weights(0, 3) = weights(0, 5) = 1.0;
      const Dependence found = find_dependence(with(e, weights));
      ASSERT_EQ(found.combinations.size(), 1u) << seed << ' ' << levels;
      EXPECT_EQ(found.combinations.front().of, (Rows{3, 5}));
      EXPECT_NE(in_words(findings_of(found, with(e, weights))).front().find("This experiment adds no information"),
                std::string::npos);
    }
}

TEST(Dependence, IsToldByTheRowsAndNames) {
  const Ensemble e = campaign({3, 2, 1}, 12, 60, 1, 0.05);
  Matrix weights = Matrix::Zero(3, 12);
  weights(0, 2) = weights(0, 5) = 1.0, weights(1, 11) = -3.0;
  weights.row(2).setConstant(1.0 / 12);
  Ensemble all = with(e, weights);
  const Dependence found = find_dependence(all);
  EXPECT_EQ(
      in_words(findings_of(found, all)),
      (std::vector<std::string>{
          "3 of 15 experiments are sums or multiples of other experiments, within rounding: experiment 12 of "
          "experiments 2 and 5; experiment 13 of experiment 11; experiment 14 of experiments 0, 1, 2, 3 and 8 more. "
          "These experiments add no information and are not used"}));
  std::vector<std::string> names;
  for (Index n = 0; n < 15; ++n) names.push_back("run " + std::to_string(n + 1));
  set_experiment_names(all, names);
  EXPECT_NE(in_words(findings_of(found, all))
                .front()
                .find("\"run 13\" (row 12) of experiments \"run 3\" (row 2) and \"run 6\" (row 5)"),
            std::string::npos);
  EXPECT_EQ(in_words(findings_of(find_dependence(all.subset(rows(0, 13))), all.subset(rows(0, 13))))
                .front()
                .rfind("1 of 13 experiments is a sum or multiple of other experiments", 0),
            0);
}

// The model is that of the independent experiments, to the last bit; but it knows the whole data.
TEST(Dependence, IsLeftAside) {
  const Ensemble own = campaign({3, 2, 1}, 24, 40, 7, 0.05);
  Matrix weights = Matrix::Zero(10, 24);
  for (Index i = 0; i < 10; ++i)  // sums and multiples
    i % 2 == 0 ? (weights(i, i) = weights(i, i + 5) = 1.0) : (weights(i, i) = 2.0);
  const Ensemble all = with(own, weights);
  const IdentifyOptions stated{.states = 3, .lags = 2, .refine = false};
  const Identification plain = identify(own, stated), found = identify(all, stated);
  EXPECT_EQ(testing::all(found.model, &Step::A), testing::all(plain.model, &Step::A));
  EXPECT_EQ(testing::all(found.model, &Step::G), testing::all(plain.model, &Step::G));
  EXPECT_EQ(found.experiments, 24);
  EXPECT_EQ(found.dependent.used, rows(0, 24));
  EXPECT_EQ(found.dependent.combinations.size(), 10);
  EXPECT_EQ(found.findings.size(), plain.findings.size() + 1);
  EXPECT_TRUE(has_seen(found.model.provenance, all));
  IdentifyOptions half = stated;
  half.hold_out = 0.5;
  EXPECT_EQ(testing::all(identify(all, half).model, &Step::A), testing::all(identify(own, half).model, &Step::A));

  const CrossValidation folds = cross_validate(all, stated, {.folds = 4});
  EXPECT_EQ(folds.simulation.fit, cross_validate(own, stated, {.folds = 4}).simulation.fit);
  std::set<Index> judged;
  for (const Fold& fold : folds.folds) judged.insert(fold.experiments.begin(), fold.experiments.end());
  EXPECT_EQ(judged.size(), 24);
  EXPECT_EQ(folds.findings.size(), 1);

  EXPECT_EQ(confidence(plain.model, all).freedom, confidence(plain.model, own).freedom);
  const Validation validation = validate_distinct(plain.model, all);
  EXPECT_EQ(validation.simulation.fit, validate(plain.model, own).simulation.fit);
  EXPECT_EQ(
      in_words(validation.findings).front().rfind("10 of 34 experiments are sums or multiples of other experiments", 0),
      0);

  UpdateState state = update_state(all, found, stated), plain_state = update_state(own, plain, stated);
  EXPECT_EQ(state.factors.factor, plain_state.factors.factor);
  const Ensemble more = campaign({3, 2, 1}, 12, 40, 7, 0.07);
  EXPECT_EQ(update(state, with(more, some_of_each(12, 1))).size(), 1);
  EXPECT_EQ(state.factors.experiments, 36);
}

// Sums correlate the noise of experiments that regressions take for independent.
TEST(Dependence, SpoilsNoModel) {
  const Model system = random_system({3, 2, 1}, 60, 0.8, 5);
  const Ensemble own = with_noise(random_experiments(system, 20, 6), 0.2, 7);
  const Ensemble fresh = random_experiments(system, 40, 8);
  Matrix weights = Matrix::Zero(20, 20);
  for (Index i = 0; i < 20; ++i) {
    weights(i, i) = i < 10 ? 1.0 : 2.0;
    if (i < 10) weights(i, i + 10) = 1.0;
  }
  const Vector plain = validate(identify(own).model, fresh).simulation.fit;
  const Vector found = validate(identify(with(own, weights)).model, fresh).simulation.fit;
  EXPECT_EQ(found, plain);
  EXPECT_GT(plain.minCoeff(), 50);
}

// Time of the processor that grows with the samples, not with the square of the number of experiments.
TEST(Dependence, TakesTimeThatIsLinear) {
  const auto time = [](Index experiments) {
    const Ensemble e = with_noise(random_experiments(random_system({2, 1, 1}, 20, 0.8, 1), experiments, 2), 0.1, 3);
    const std::clock_t begin = std::clock();
    EXPECT_TRUE(find_dependence(e).combinations.empty());
    return double(std::clock() - begin);
  };
  const double small = std::min(time(2000), time(2000));
  EXPECT_LT(time(32000), 100 * small);  // 16 times as many; squares would take 256 times as long
}

}  // namespace
}  // namespace tokid::testing
