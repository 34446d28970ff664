// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/smooth_arx.hpp"

#include <gtest/gtest.h>

#include <Eigen/QR>

#include "noisy.hpp"
#include "testing.hpp"

namespace tokid::testing {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

SmoothArxOptions with(Index lags, double smoothing, Index period = 0, InitialState initial = InitialState::zero) {
  SmoothArxOptions o;
  o.lags = lags;
  o.variation = {smoothing, period};
  o.initial_state = initial;
  return o;
}

// Four states, slowly turning: nothing of it is zero, and no two steps are the same.
Ensemble measured(Index experiments, std::uint64_t seed, Index steps = 20) {
  return noisy_experiments(oscillator(steps), experiments, seed);
}

// [W Y] of one step with zeros before the experiments, whole rows only.
Matrix padded_rows(const Ensemble& e, Index k, Index p) {
  const Index lags = std::min(k, p);
  const std::vector<Index> rows = e.complete_rows(k, lags);
  Matrix block = Matrix::Zero(Index(rows.size()), (p + 1) * e.channels());
  block.rightCols((lags + 1) * e.channels()) = e.window_and_output(k, lags)(rows, Eigen::all);
  return block;
}

Matrix least_squares(const Matrix& rows, Index right) {
  const Index l = rows.cols() - right;
  return rows.leftCols(l).colPivHouseholderQr().solve(rows.rightCols(right)).transpose();
}

// Coefficients of all p lags and the inputs, those of lags before the experiment left out.
double difference(const GtvArx::View& own, const Matrix& all) {
  return (own - all.rightCols(own.cols())).cwiseAbs().maxCoeff();
}

// Every unknown of all steps in one dense system: the definition, written down.
std::vector<Matrix> dense_solution(const Ensemble& e, Index p, double smoothing, Index first) {
  const Index d = e.channels(), m = e.outputs(), steps = e.steps(), l = (p + 1) * d - m;
  Vector rms(d);
  for (Index c = 0; c < d; ++c) {
    double sum = 0.0;
    Index count = 0;
    for (Index k = 0; k < steps; ++k)
      for (Index n = 0; n < e.experiments(); ++n)
        if (const double value = e.samples()(n, k * d + c); !std::isnan(value)) sum += value * value, ++count;
    rms(c) = std::sqrt(sum / double(count));
  }
  std::vector<Matrix> blocks;
  Index rows = 0;
  for (Index k = 0; k < steps; ++k) {
    blocks.push_back(k < first ? Matrix(0, l + m) : padded_rows(e, k, p));
    rows += blocks.back().rows();
  }
  const double weight = std::sqrt(smoothing * double(rows) / double(steps));
  Matrix left = Matrix::Zero(rows + (steps - 1) * l, steps * l), right = Matrix::Zero(left.rows(), m);
  Index row = 0;
  for (Index k = 0; k < steps; ++k) {
    const Matrix& block = blocks[size_t(k)];
    left.block(row, k * l, block.rows(), l) = block.leftCols(l);
    right.middleRows(row, block.rows()) = block.rightCols(m);
    row += block.rows();
  }
  for (Index k = 0; k + 1 < steps; ++k)
    for (Index i = 0; i < l; ++i, ++row) {
      left(row, k * l + i) = -weight * rms(i % d);
      left(row, (k + 1) * l + i) = weight * rms(i % d);
    }
  const Matrix x = left.colPivHouseholderQr().solve(right);
  std::vector<Matrix> result;
  for (Index k = 0; k < steps; ++k) result.emplace_back(x.middleRows(k * l, l).transpose());
  return result;
}

// One-step errors of the regressions on other data, relative to the outputs, over the steps p … T-1.
double fresh_error(const GtvArx& arx, const Ensemble& fresh, Index p) {
  double error = 0.0, square = 0.0;
  for (Index k = p; k < fresh.steps(); ++k) {
    error +=
        (fresh.output(k) - fresh.window(k, arx.step[size_t(k)].lags) * arx.coefficients(k).transpose()).squaredNorm();
    square += fresh.output(k).squaredNorm();
  }
  return std::sqrt(error / square);
}

TEST(SmoothArx, WithoutPenaltyEachStepIsTheRegressionOfThePaper) {
  const Ensemble e = measured(40, 1);
  for (const InitialState initial : {InitialState::zero, InitialState::unknown}) {
    const GtvArx plain = gtv_arx(e, {.lags = {3}, .initial_state = initial});
    const GtvArx arx = smooth_arx(e, with(3, 0.0, 0, initial));
    ASSERT_EQ(arx.steps(), 20);
    EXPECT_EQ(arx.inputs, 2);
    EXPECT_EQ(arx.outputs, 2);
    for (Index k = 0; k < 20; ++k) {
      const GtvArxStep &a = arx.step[size_t(k)], &b = plain.step[size_t(k)];
      ASSERT_EQ(arx.regressors(k), plain.regressors(k)) << k;
      if (k < arx.k_begin) continue;
      EXPECT_EQ(a.lags, b.lags);
      EXPECT_EQ(a.rows, b.rows);
      EXPECT_LE(difference(arx.coefficients(k), plain.coefficients(k)), 1e-12);
      EXPECT_LE((arx.output_rms(k) - plain.output_rms(k)).norm(), 1e-12);
      // EᵀE is the same, divided by the experiments here and by the degrees of freedom there.
      EXPECT_LE((arx.residual_cov(k) * double(a.rows) - plain.residual_cov(k) * double(b.freedom)).norm(), 1e-11);
    }
  }
}

TEST(SmoothArx, AnInfinitePenaltyIsOneRegressionForAllSteps) {
  const Ensemble e = measured(10, 2);
  const Index p = 3;
  for (const InitialState initial : {InitialState::zero, InitialState::unknown}) {
    const Index first = initial == InitialState::zero ? 0 : p;
    Matrix all(10 * (20 - first), (p + 1) * 4);
    for (Index k = first; k < 20; ++k) all.middleRows(10 * (k - first), 10) = padded_rows(e, k, p);
    const Matrix pooled = least_squares(all, 2);
    for (const auto& [smoothing, tolerance] : {std::pair{infinity, 1e-12}, {1e10, 1e-6}}) {
      const GtvArx arx = smooth_arx(e, with(p, smoothing, 0, initial));
      EXPECT_EQ(arx.k_begin, first);
      for (Index k = first; k < 20; ++k) EXPECT_LE(difference(arx.coefficients(k), pooled), tolerance) << k;
    }
    // Period 1 is the same model by another name.
    const GtvArx invariant = smooth_arx(e, with(p, 0.0, 1, initial));
    for (Index k = first; k < 20; ++k) EXPECT_LE(difference(invariant.coefficients(k), pooled), 1e-12) << k;
  }
}

TEST(SmoothArx, StepsOfOnePhaseShareTheirRegression) {
  const Ensemble e = measured(10, 3, 21);
  const Index p = 2, period = 4;
  for (const InitialState initial : {InitialState::zero, InitialState::unknown}) {
    const Index first = initial == InitialState::zero ? 0 : p;
    const GtvArx arx = smooth_arx(e, with(p, 0.0, period, initial));
    for (Index phase = 0; phase < period; ++phase) {
      Matrix all(0, (p + 1) * 4);
      for (Index k = phase; k < 21; k += period) {
        if (k < first) continue;
        all.conservativeResize(all.rows() + 10, Eigen::NoChange);
        all.bottomRows(10) = padded_rows(e, k, p);
      }
      const Matrix pooled = least_squares(all, 2);
      for (Index k = phase; k < 21; k += period) {
        if (k < first) continue;
        EXPECT_LE(difference(arx.coefficients(k), pooled), 1e-12) << k;
      }
    }
  }
}

TEST(SmoothArx, MinimisesWhatItsHeaderSaysWhateverIsMissing) {
  const Index p = 2, steps = 8;
  Ensemble missing = measured(7, 4, steps), unequal = missing;
  for (Index n = 0; n < 7; ++n) missing.y(n, n, n % 2) = nan;
  missing.u(6, 3, 1) = nan;
  unequal.length = {8, 3, 8, 5, 8, 8, 4};
  for (Index n = 0; n < 7; ++n)
    for (Index k = unequal.length[size_t(n)]; k < steps; ++k)
      for (Index c = 0; c < 2; ++c) unequal.u(n, k, c) = unequal.y(n, k, c) = nan;
  Ensemble hole = missing;  // steps that no experiment has whole
  hole.output(4).setConstant(nan);
  for (const Ensemble& e : {measured(7, 4, steps), missing, unequal, hole})
    for (const InitialState initial : {InitialState::zero, InitialState::unknown})
      for (const double smoothing : {1e-3, 1.0, 300.0}) {
        const GtvArx arx = smooth_arx(e, with(p, smoothing, 0, initial));
        const std::vector<Matrix> dense = dense_solution(e, p, smoothing, initial == InitialState::zero ? 0 : p);
        for (Index k = arx.k_begin; k < steps; ++k) {
          EXPECT_LE(difference(arx.coefficients(k), dense[size_t(k)]), 1e-10) << k;
          EXPECT_EQ(arx.step[size_t(k)].rows, Index(e.complete_rows(k, std::min(k, p)).size()));
        }
      }
}

TEST(SmoothArx, UnknownInitialStatesLeaveTheFirstStepsWithoutARegression) {
  const GtvArx arx = smooth_arx(measured(20, 5), with(4, 1.0, 0, InitialState::unknown));
  EXPECT_EQ(arx.k_begin, 4);
  for (Index k = 0; k < 4; ++k) EXPECT_EQ(arx.coefficients(k).size(), 0);
  for (Index k = 4; k < 20; ++k) EXPECT_EQ(arx.step[size_t(k)].lags, 4);
}

TEST(SmoothArx, UnitsOfTheChannelsDoNotMatter) {
  const Ensemble e = measured(8, 6);
  Ensemble scaled = e;
  const Vector units = (Vector(4) << 1e3, 1e-5, 1e6, 1e-2).finished();
  for (Index k = 0; k < 20; ++k)
    for (Index c = 0; c < 2; ++c) scaled.input(k).col(c) *= units(c), scaled.output(k).col(c) *= units(2 + c);
  for (const double smoothing : {0.01, 1.0, infinity}) {
    const GtvArx a = smooth_arx(e, with(2, smoothing)), b = smooth_arx(scaled, with(2, smoothing));
    for (Index k = 0; k < 20; ++k) {
      Matrix back = units.tail(2).cwiseInverse().asDiagonal() * b.coefficients(k);
      for (Index i = 0; i < back.cols(); ++i) back.col(i) *= units(i % 4);
      EXPECT_LE(difference(a.coefficients(k), back), 1e-10) << k;
    }
  }
}

TEST(SmoothArx, SameBitsForAnyNumberOfThreads) {
  const Ensemble e = measured(12, 7);
  for (const SmoothArxOptions& options : {with(2, 0.0), with(2, 1.0), with(2, infinity), with(2, 0.0, 3)}) {
    const GtvArx reference = smooth_arx(e, options);
    for (const int threads : {2, 3, 8}) {
      SmoothArxOptions o = options;
      o.execution.threads = threads;
      const GtvArx arx = smooth_arx(e, o);
      for (Index k = 0; k < 20; ++k) EXPECT_EQ(arx.coefficients(k), reference.coefficients(k));
    }
  }
}

TEST(SmoothArx, FewerExperimentsThanUnknownsLendEachOtherWhatTheyKnow) {
  const Ensemble e = measured(5, 8, 40), fresh = measured(200, 9, 40);
  const GtvArx arx = smooth_arx(e, with(3, 1.0));  // 14 unknowns per output and step
  for (Index k = 0; k < arx.steps(); ++k) ASSERT_TRUE(arx.coefficients(k).allFinite());
  // Measured: 0.086 against 0.50 for the solutions of smallest norm.
  EXPECT_LT(fresh_error(arx, fresh, 3), 0.12);
  EXPECT_GT(fresh_error(smooth_arx(e, with(3, 0.0)), fresh, 3), 0.3);
}

TEST(SmoothArx, MistakesAreNamed) {
  const Ensemble e = measured(5, 10, 6);
  const auto message = [&](const SmoothArxOptions& o) -> std::string {
    try {
      smooth_arx(e, o);
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "no exception";
  };
  EXPECT_EQ(message(with(0, 1.0)), "lags: 0 found, 1 to 5 needed");
  EXPECT_EQ(message(with(6, 1.0)), "lags: 6 found, 1 to 5 needed");
  EXPECT_EQ(message(with(2, -1.0)), "smoothing: -1 found, 0 or more needed");
  EXPECT_EQ(message(with(2, nan)), "smoothing: nan found, 0 or more needed");
  EXPECT_EQ(message(with(2, 1.0, -3)), "period: -3 found, 1 or more needed");
  EXPECT_EQ(message(with(5, 1.0)), "no exception");
}

SmoothingChoice choose(const Ensemble& e, std::vector<Index> lags, std::optional<double> smoothing = {}) {
  SmoothingOptions o;
  o.lags = std::move(lags);
  o.smoothing = smoothing;
  return choose_smoothing(e, o);
}

double chosen_error(const Ensemble& e, const Ensemble& fresh, Index p) {
  return fresh_error(smooth_arx(e, with(p, choose(e, {p}).smoothing)), fresh, p);
}

TEST(ChooseSmoothing, SystemsThatDoNotChangeAreHeldStill) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5})
    EXPECT_GE(choose(noisy_experiments(constant_system({3, 2, 1}, 40, 0.9, seed), 20, seed), {3}).smoothing, 100.0);
}

TEST(ChooseSmoothing, SlowlyVaryingSystemsGain) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Ensemble e = measured(40, seed, 60), fresh = measured(300, seed + 100, 60);
    // Measured: 0.83 to 0.87.
    EXPECT_LT(chosen_error(e, fresh, 4), 0.9 * fresh_error(smooth_arx(e, with(4, 0.0)), fresh, 4));
  }
}

TEST(ChooseSmoothing, AJumpAtHalfTimeCostsNothing) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
    Model system = constant_system({3, 2, 1}, 40, 0.9, seed);
    const Model other = constant_system({3, 2, 1}, 40, 0.9, seed + 50);
    for (size_t k = 20; k < 40; ++k)
      system.step[k].A() = other.step[k].A(), system.step[k].B() = other.step[k].B(),
      system.step[k].C() = other.step[k].C(), system.step[k].D() = other.step[k].D();
    const Ensemble e = noisy_experiments(system, 60, seed), fresh = noisy_experiments(system, 300, seed + 100);
    const double plain = fresh_error(smooth_arx(e, with(3, 0.0)), fresh, 3);
    EXPECT_LE(chosen_error(e, fresh, 3), plain) << seed;  // measured: 0.97 to 0.99 of it
  }
}

// Hardly more experiments than unknowns of a step need some penalty, and little noise a small one.
TEST(ChooseSmoothing, LittleNoiseNeedsLittlePenalty) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const auto measured_by = [](Index count, std::uint64_t of) {
      return experiments(oscillator(60), {.experiments = count, .seed = of, .measurement_noise = 1e-3});
    };
    const Ensemble e = measured_by(14, seed), fresh = measured_by(300, seed + 100);
    const double chosen = choose(e, {2}).smoothing;
    EXPECT_LT(chosen, 1e-3);
    for (const double other : {1.0, 0.003})
      EXPECT_LT(fresh_error(smooth_arx(e, with(2, chosen)), fresh, 2),
                0.9 * fresh_error(smooth_arx(e, with(2, other)), fresh, 2));
  }
}

TEST(ChooseSmoothing, StepsThatHaveNothingInCommonAreLeftAlone) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
    const Model system = random_system({3, 2, 1}, 30, 0.9, seed);
    const Ensemble e = noisy_experiments(system, 60, seed), fresh = noisy_experiments(system, 300, seed + 100);
    EXPECT_LE(choose(e, {3}).smoothing, 0.03);
    // Measured: 0.989 to 0.995.
    EXPECT_LE(chosen_error(e, fresh, 3), fresh_error(smooth_arx(e, with(3, 0.0)), fresh, 3)) << seed;
  }
}

TEST(ChooseSmoothing, ReportsWhatItTriedAndTakesWhatIsGiven) {
  const Ensemble e = measured(20, 11, 30);
  const SmoothingChoice choice = choose(e, {1, 2, 4, 6});
  double least = infinity;
  bool listed = false;
  for (const SmoothingTrial& t : choice.trials) {
    least = std::min(least, t.error);
    listed = listed || (t.lags == choice.lags && t.smoothing == choice.smoothing && t.error == choice.error);
  }
  EXPECT_TRUE(listed);
  EXPECT_EQ(choice.error, least);  // it climbs down: what it ends with is the best of what it saw
  EXPECT_GT(choice.error, 0.0);
  EXPECT_LT(choice.error, 1.0);
  for (const SmoothingTrial& t : choose(e, {1, 2, 4}, 0.7).trials) EXPECT_EQ(t.smoothing, 0.7);
  for (const SmoothingTrial& t : choose(e, {3}).trials) EXPECT_EQ(t.lags, 3);
  SmoothingOptions invariant;
  invariant.lags = {1, 2, 3};
  invariant.period = 1;
  EXPECT_EQ(choose_smoothing(e, invariant).smoothing, 0.0);
  // No output is a hundred times better known because its unit is larger: errors are relative, and so is the choice.
  Ensemble scaled = e;
  for (Index k = 0; k < 30; ++k) scaled.output(k).col(1) *= 1024.0;
  EXPECT_EQ(choose(scaled, {1, 2, 4, 6}).smoothing, choice.smoothing);
  EXPECT_NEAR(choose(scaled, {1, 2, 4, 6}).error, choice.error, 1e-12);
}

TEST(ChooseSmoothing, SameBitsForAnyNumberOfThreads) {
  const Ensemble e = measured(12, 12, 30);
  SmoothingOptions o;
  o.lags = {1, 2, 4};
  const SmoothingChoice reference = choose_smoothing(e, o);
  for (const int threads : {2, 3, 8}) {
    o.execution.threads = threads;
    const SmoothingChoice choice = choose_smoothing(e, o);
    ASSERT_EQ(choice.trials.size(), reference.trials.size());
    for (size_t i = 0; i < choice.trials.size(); ++i) EXPECT_EQ(choice.trials[i].error, reference.trials[i].error);
  }
}

TEST(ChooseSmoothing, LongEnsemblesAreJudgedByStretches) {
  const Ensemble e = measured(12, 13, 300);
  SmoothingOptions o;
  o.lags = {2};
  o.smoothing = 1.0;
  const double parts = choose_smoothing(e, o).error;
  o.steps = 300;
  const double whole = choose_smoothing(e, o).error;
  EXPECT_NE(parts, whole);
  EXPECT_NEAR(parts, whole, 0.1 * whole);
}

TEST(ChooseSmoothing, MistakesAreNamed) {
  SmoothingOptions o;
  EXPECT_THROW(choose_smoothing(measured(5, 14), o), std::invalid_argument);
  o.lags = {2};
  EXPECT_THROW(choose_smoothing(measured(1, 14), o), std::invalid_argument);
  o.lags = {2, 20};
  EXPECT_THROW(choose_smoothing(measured(5, 14), o), std::invalid_argument);
}

TEST(Fold, EveryExperimentIsLeftOutOnce) {
  for (const Index experiments : {2, 7, 10, 11, 23}) {
    const Index folds = fold_count(experiments);
    EXPECT_EQ(folds, experiments <= 10 ? experiments : 5);
    const Ensemble e = measured(experiments, 15);
    double sum = 0.0;
    Index count = 0;
    for (Index f = 0; f < folds; ++f) {
      const Split parts = fold(e, f, folds, false);
      EXPECT_EQ(parts.training.experiments() + parts.held_out.experiments(), experiments);
      count += parts.held_out.experiments();
      sum += parts.held_out.samples().sum();
    }
    EXPECT_EQ(count, experiments);
    EXPECT_NEAR(sum, e.samples().sum(), 1e-9);
  }
}

// Five departures from their common mean add up to zero: what four of them tell, the fifth repeats. Outputs that answer
// to nothing are then "predicted" without error by any regression that fits the four exactly.
TEST(Fold, DeparturesFromTheMeanMotionDoNotLeak) {
  Random random(16);
  Ensemble e(5, 30, 2, 1);
  for (Index k = 0; k < 30; ++k) e.input(k) = random.matrix(5, 2), e.output(k) = random.matrix(5, 1);
  const Ensemble about_mean = departures(e, nominal_trajectory(e));
  SmoothingOptions o;
  o.lags = {4};
  o.smoothing = 0.0;
  o.initial_state = InitialState::unknown;  // 14 unknowns at every step
  EXPECT_LT(choose_smoothing(about_mean, o).error, 1e-9);
  o.centred = true;
  EXPECT_GT(choose_smoothing(about_mean, o).error, 0.9);  // noise can't be predicted
}

}  // namespace
}  // namespace tokid::testing
