// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/gtv_arx.hpp"
#include "tokid/lag_orders.hpp"

#include <gtest/gtest.h>

#include <tuple>

#include "testing.hpp"

namespace tokid::testing {
namespace {

TEST(GtvArx, ExplainsNoiseFreeDataCompletely) {
  for (const SystemSize size : {SystemSize{1, 1, 1}, {4, 2, 2}, {3, 1, 2}, {3, 2, 1}, {2, 3, 1}, {6, 2, 3}})
    for (const Index extra : {0, 2}) {
      const Index p = smallest_lag_order(size) + extra, n = minimum_experiments(size.r, size.m, p) + 5;
      const Ensemble e = random_experiments(random_system(size, 20, 1.0, 7), n, 8);
      GtvArxOptions options;
      options.lags = {p};
      options.leverages = true;
      const GtvArx arx = gtv_arx(e, options);
      ASSERT_EQ(arx.steps(), 20);
      for (Index k = 0; k < 20; ++k) {
        const GtvArxStep& s = arx.step[size_t(k)];
        EXPECT_EQ(s.lags, std::min(p, k));
        EXPECT_EQ(s.rows, n);
        // Least-squares residuals are rounding errors of the outputs, whatever the condition of the window.
        const Matrix residual = e.output(k) - e.window(k, s.lags) * arx.coefficients(k).transpose();
        EXPECT_LE(residual.norm(), 1e4 * epsilon * e.output(k).norm()) << name(size) << " k " << k;
        // Rank: the inputs and the states they reached (docs/math.md, rank-deficient windows).
        EXPECT_LE(s.rank, size.r * (s.lags + 1) + size.n);
        EXPECT_NEAR(arx.leverages(k).sum(), double(s.rank), 1e-8);  // the trace of a projector
      }
    }
}

TEST(GtvArx, CoefficientsOfTheSmallestOrderAreThoseOfTheDeadbeatObserver) {
  // Scalar system x⁺ = a x + b u, y = x: y_k = a y_{k-1} + b u_{k-1}.
  const Model system = random_system({1, 1, 1}, 12, 0.9, 3);
  Model plain = system;
  for (Step& step : plain.step) step.C().setOnes();
  for (Step& step : plain.step) step.D().setZero();
  const GtvArx arx = gtv_arx(random_experiments(plain, 10, 4), {});
  for (Index k = 2; k < 12; ++k) {
    EXPECT_NEAR(arx.output_block(k, 1)(0, 0), plain.step[size_t(k - 1)].A()(0, 0), 1e-12);
    EXPECT_NEAR(arx.input_block(k, 1)(0, 0), plain.step[size_t(k - 1)].B()(0, 0), 1e-12);
    EXPECT_NEAR(arx.D(k)(0, 0), 0.0, 1e-12);
  }
}

TEST(GtvArx, MinimumNormSolutionIsThatOfThePseudoInverseInScaledColumns) {
  const SystemSize size{3, 2, 1};
  const Ensemble e = random_experiments(random_system(size, 14, 1.0, 5), 60, 6);
  GtvArxOptions options;
  options.lags = {4};  // p·m = 8 > n = 3: rank deficient
  const GtvArx arx = gtv_arx(e, options);
  for (Index k = 7; k < 14; ++k) {  // from here on the states of step k - 4 span all directions
    const GtvArxStep& s = arx.step[size_t(k)];
    EXPECT_EQ(s.rank, size.r * 5 + size.n) << k;
    Matrix w = e.window(k, 4);
    const Vector norms = w.colwise().norm();
    w *= norms.cwiseInverse().asDiagonal();
    const Matrix expected =
        (norms.cwiseInverse().asDiagonal() * (linalg::pseudo_inverse(w, 1e-11) * e.output(k))).transpose();
    EXPECT_LE((arx.coefficients(k) - expected).norm(), 1e-9 * expected.norm()) << k;
  }
}

TEST(GtvArx, LagOrderMayDifferPerStep) {
  const Ensemble e = random_experiments(random_system({2, 1, 1}, 10, 1.0, 9), 30, 10);
  GtvArxOptions options;
  for (Index k = 0; k < 10; ++k) options.lags.push_back(2 + k % 3);
  options.lags.erase(options.lags.begin());
  const GtvArx arx = gtv_arx(e, options);
  for (Index k = 0; k < 10; ++k) {
    const Index p = std::min(k, options.lags[size_t(k)]);
    EXPECT_EQ(arx.step[size_t(k)].lags, p);
    GtvArxOptions alone;
    alone.lags = {std::max<Index>(1, p)};
    alone.block = 1;
    EXPECT_EQ(arx.coefficients(k), gtv_arx(e, alone).coefficients(k));
  }
}

TEST(GtvArx, UnknownInitialStatesLeaveTheStepsFromPOnExact) {
  const SystemSize size{4, 2, 1};
  const Ensemble e = random_experiments(random_system(size, 15, 1.0, 11), 20, 12, 100.0);
  GtvArxOptions options;
  options.lags = {2};
  options.initial_state = InitialState::unknown;
  const GtvArx arx = gtv_arx(e, options);
  EXPECT_EQ(arx.k_begin, 2);
  EXPECT_EQ(arx.coefficients(1).size(), 0);
  for (Index k = 2; k < 15; ++k) {
    EXPECT_LE((e.output(k) - e.window(k, 2) * arx.coefficients(k).transpose()).norm(),
              1e4 * epsilon * e.output(k).norm());
  }
}

TEST(GtvArx, MissingSamplesRemoveTheRowsOfTheStepsTheyTouchAndNothingElse) {
  const Ensemble e = with_noise(random_experiments(random_system({2, 1, 1}, 12, 1.0, 13), 25, 14), 0.1, 15);
  Ensemble holes = e;
  holes.y(3, 6, 0) = nan;
  holes.u(7, 6, 0) = nan;
  std::vector<Index> others;
  for (Index n = 0; n < 25; ++n)
    if (n != 3 && n != 7) others.push_back(n);
  GtvArxOptions options;
  options.lags = {2};
  options.block = 1;
  const GtvArx whole = gtv_arx(e, options), with_holes = gtv_arx(holes, options),
               without = gtv_arx(e.subset(others), options);
  for (Index k = 0; k < 12; ++k) {
    const bool touched = k >= 6 && k <= 8;
    EXPECT_EQ(with_holes.step[size_t(k)].rows, touched ? 23 : 25) << k;
    EXPECT_EQ(with_holes.coefficients(k), (touched ? without : whole).coefficients(k)) << k;
  }
}

TEST(GtvArx, LeveragesAreTheDiagonalOfTheProjector) {
  const Ensemble noisy = with_noise(random_experiments(random_system({2, 1, 1}, 8, 1.0, 16), 20, 17), 0.1, 18);
  const Ensemble clean = random_experiments(random_system({2, 1, 1}, 8, 1.0, 16), 20, 17);
  GtvArxOptions options;
  options.lags = {4};
  options.leverages = true;
  for (const Ensemble& e : {noisy, clean}) {  // full rank, rank deficient
    const GtvArx arx = gtv_arx(e, options);
    Matrix w = e.window(6, 4);
    w *= Vector(w.colwise().norm().cwiseInverse()).asDiagonal();
    const Vector expected = (w * linalg::pseudo_inverse(w, 1e-11)).diagonal();
    EXPECT_LE((arx.leverages(6) - expected).norm(), 1e-9);
  }
}

TEST(GtvArx, FewerExperimentsThanUnknownsAreInterpolatedAndSaySo) {
  const Ensemble e = with_noise(random_experiments(random_system({2, 1, 1}, 8, 1.0, 19), 4, 20), 0.1, 21);
  GtvArxOptions options;
  options.lags = {3};
  const GtvArx arx = gtv_arx(e, options);
  EXPECT_EQ(arx.step[5].rank, 4);
  EXPECT_EQ(arx.step[5].freedom, 0);
  EXPECT_EQ(arx.residual_cov(5).norm(), 0.0);
  EXPECT_LE((e.output(5) - e.window(5, 3) * arx.coefficients(5).transpose()).norm(), 1e-10);
}

// residual_cov ⊗ X Xᵀ is the covariance of the coefficients: over 400 noise realisations of a fixed window the scaled
// squared deviations have mean 1, with a standard error of sqrt(2/400) = 0.07 per coefficient.
TEST(GtvArx, CoefficientCovarianceIsThatOfRepeatedNoise) {
  const Index p = 2, k = 5;
  const Ensemble clean = random_experiments(random_system({2, 1, 1}, 8, 1.0, 22), 30, 23);
  GtvArxOptions options;
  options.lags = {p};
  const Matrix truth = gtv_arx(clean, options).coefficients(k);
  Vector sum = Vector::Zero(truth.cols());
  const Index runs = 400;
  Random random(24);
  for (Index run = 0; run < runs; ++run) {
    Ensemble e = clean;
    e.output(k) += 0.5 * random.matrix(30, 1);  // noise on the output of the step alone keeps its window
    const GtvArx arx = gtv_arx(e, options);
    const Vector variance = 0.25 * arx.noise_shape(k).rowwise().squaredNorm();
    sum += ((arx.coefficients(k) - truth).transpose().array().square() / variance.array()).matrix();
  }
  for (const double mean : sum / double(runs)) EXPECT_NEAR(mean, 1.0, 5 * std::sqrt(2.0 / double(runs)));
}

Ensemble random_samples(Index experiments, Index steps, Index r, Index m, std::uint64_t seed) {
  Random random(seed);
  Ensemble e(experiments, steps, r, m);
  for (Index k = 0; k < steps; ++k) {
    e.input(k) = random.matrix(experiments, r);
    e.output(k) = 1e3 * random.matrix(experiments, m);
  }
  return e;
}

struct SharedCase {
  Index experiments, lags, block;
};

TEST(GtvArx, StepsThatShareAFactorisationHaveTheRegressionsThatTheyHaveAlone) {
  constexpr Index steps = 23, r = 2, m = 3;
  for (const SharedCase c : {SharedCase{60, 3, 2},
                             {60, 3, 5},
                             {60, 5, 40},
                             {25, 3, 6},
                             {17, 3, 4},
                             {9, 3, 3},
                             {2, 1, 7},
                             {60, 3, 0},
                             {60, 5, 0},
                             {25, 1, 0},
                             {24, 3, 0},
                             {19, 3, 0},
                             {300, 2, 0}})
    for (const InitialState initial : {InitialState::zero, InitialState::unknown}) {
      const Ensemble e = random_samples(c.experiments, steps, r, m, 5);
      GtvArxOptions o;
      o.lags = {c.lags};
      o.initial_state = initial;
      o.block = c.block;
      const GtvArx shared = gtv_arx(e, o);
      o.block = 1;
      const GtvArx alone = gtv_arx(e, o);
      ASSERT_EQ(shared.k_begin, alone.k_begin);
      for (Index k = alone.k_begin; k < steps; ++k) {
        const GtvArxStep &a = shared.step[size_t(k)], &b = alone.step[size_t(k)];
        ASSERT_EQ(std::tuple(a.lags, a.rows, a.freedom, a.rank), std::tuple(b.lags, b.rows, b.freedom, b.rank));
        // Rounding errors of two backward stable factorisations, in units of the condition.
        const double tolerance = 1e2 * epsilon * double(alone.regressors(k)) * b.condition;
        EXPECT_NEAR(a.condition / b.condition, 1.0, tolerance);
        EXPECT_LE((shared.coefficients(k) - alone.coefficients(k)).norm(), tolerance * alone.coefficients(k).norm());
        EXPECT_LE((shared.residual_cov(k) - alone.residual_cov(k)).norm(), tolerance * 1e6);
        EXPECT_LE((shared.output_rms(k) - alone.output_rms(k)).norm(), tolerance * alone.output_rms(k).norm());
        const Matrix x = shared.noise_shape(k) * shared.noise_shape(k).transpose();
        const Matrix y = alone.noise_shape(k) * alone.noise_shape(k).transpose();
        EXPECT_LE((x - y).norm(), tolerance * b.condition * y.norm());
      }
    }
}

// Residuals and their orthogonality to the regressors do not suffer from the condition, nor from dropping old samples.
TEST(GtvArx, SharedFactorisationsAreBackwardStable) {
  constexpr Index steps = 30, r = 2, m = 1, experiments = 80;
  for (const double apart : {1e-3, 1e-9, 1e-12}) {
    Ensemble e = random_samples(experiments, steps, r, m, 6);
    for (Index k = 0; k < steps; ++k) e.input(k).col(1) = e.input(k).col(0) + apart * e.input(k).col(1);
    GtvArxOptions o;
    o.lags = {4};
    for (const Index block : {0, 1, 4, 30}) {
      o.block = block;
      const GtvArx arx = gtv_arx(e, o);
      for (Index k = 0; k < steps; ++k) {
        const Matrix w = e.window(k, std::min<Index>(4, k)), y = e.output(k);
        const GtvArx::View coefficients = arx.coefficients(k);
        const double size = w.norm() * coefficients.norm() + y.norm(), unit = epsilon * double(steps * (r + m));
        const Matrix residual = y - w * coefficients.transpose();
        EXPECT_LE((w.transpose() * residual).norm(), 10 * unit * w.norm() * size) << apart << " " << block << " " << k;
        const Matrix best = y - w * linalg::minimum_norm(w, y, 1e-15).x;
        EXPECT_LE(residual.norm(), best.norm() + 10 * unit * size) << apart << " " << block << " " << k;
      }
    }
  }
}

TEST(GtvArx, EveryRouteHasTheSameBitsForAnyNumberOfThreads) {
  const Ensemble e = random_samples(50, 40, 2, 2, 7);
  for (const Index block : {0, 1, 3}) {
    GtvArxOptions o;
    o.lags = {4};
    o.block = block;
    const GtvArx one = gtv_arx(e, o);
    for (const int threads : {2, 3, 8}) {
      o.execution.threads = threads;
      const GtvArx more = gtv_arx(e, o);
      for (Index k = 0; k < 40; ++k) {
        EXPECT_EQ(more.coefficients(k), one.coefficients(k));
        EXPECT_EQ(more.residual_cov(k), one.residual_cov(k));
      }
    }
  }
  EXPECT_THROW(gtv_arx(e, {.block = -1}), std::invalid_argument);
}

// A lane whose problem is rank deficient or hopeless goes its own way, the others go on.
TEST(GtvArx, StepsWithoutExcitationLeaveTheirNeighboursAlone) {
  constexpr Index steps = 40;
  Ensemble e = random_samples(40, steps, 2, 2, 9);
  e.input(20).setZero();
  e.input(21).col(0) = e.input(21).col(1);
  GtvArxOptions o;
  o.lags = {2};
  const GtvArx lanes = gtv_arx(e, o);
  o.block = 1;
  const GtvArx alone = gtv_arx(e, o);
  for (Index k = 0; k < steps; ++k) {
    const GtvArxStep &a = lanes.step[size_t(k)], &b = alone.step[size_t(k)];
    EXPECT_EQ(a.rank, b.rank) << k;
    EXPECT_EQ(a.rank < lanes.regressors(k), k >= 20 && k <= 23) << k;
    EXPECT_LE((lanes.coefficients(k) - alone.coefficients(k)).norm(),
              1e3 * epsilon * b.condition * alone.coefficients(k).norm());
  }
}

// Columns of zeros take no row of the triangular factor, however few experiments there are.
TEST(GtvArx, InputsAtRestWithFewExperiments) {
  for (const Index experiments : {1, 6, 10, 11, 12, 14})
    for (const Index block : {0, 1, 3}) {
      constexpr Index steps = 12, r = 2, m = 2;
      Ensemble e = random_samples(experiments, steps, r, m, 10);
      for (const Index k : {0, 5, 6}) e.input(k).col(0).setZero();
      GtvArxOptions o;
      o.lags = {2};
      o.block = block;
      const GtvArx arx = gtv_arx(e, o);
      const WindowFactors kept = window_factors(e, 2, InitialState::zero);
      const GtvArx factors = gtv_arx(Windows(kept), o);
      for (Index k = 0; k < steps; ++k) {
        const Matrix w = e.window(k, std::min<Index>(2, k)), y = e.output(k);
        const Matrix best = linalg::pseudo_inverse(w) * y;
        for (const GtvArx* found : {&arx, &factors}) {
          EXPECT_LE((w * found->coefficients(k).transpose() - w * best).norm(), 1e-9 * y.norm())
              << experiments << " " << block << " " << k;
          const Index freedom = found->step[size_t(k)].freedom;
          const Matrix residual = y - w * best;
          if (freedom > 0) {
            EXPECT_LE((found->residual_cov(k) * double(freedom) - residual.transpose() * residual).norm(),
                      1e-9 * y.squaredNorm())
                << experiments << " " << block << " " << k;
          }
        }
      }
    }
}

TEST(GtvArx, ViewsHaveTheShapesOfTheirSteps) {
  constexpr Index steps = 9, r = 2, m = 3, d = r + m, experiments = 40;
  const Ensemble e = random_samples(experiments, steps, r, m, 8);
  GtvArxOptions o;
  o.lags = {3};
  const GtvArx lean = gtv_arx(e, {.lags = {3}, .noise_shape = false});
  GtvArx arx = gtv_arx(e, o);
  EXPECT_TRUE(arx.has_noise_shape());
  EXPECT_FALSE(lean.has_noise_shape());
  EXPECT_THROW(lean.require_noise_shape(), std::invalid_argument);
  for (Index k = 0; k < steps; ++k) {
    const Index lags = std::min<Index>(3, k), regressors = lags * d + r;
    EXPECT_EQ(arx.regressors(k), regressors);
    EXPECT_EQ(std::pair(arx.coefficients(k).rows(), arx.coefficients(k).cols()), std::pair(m, regressors));
    EXPECT_EQ(std::pair(arx.residual_cov(k).rows(), arx.residual_cov(k).cols()), std::pair(m, m));
    EXPECT_EQ(std::pair(arx.noise_shape(k).rows(), arx.noise_shape(k).cols()),
              std::pair(regressors, arx.step[size_t(k)].rank));
    EXPECT_EQ(arx.output_rms(k).size(), m);
    EXPECT_EQ(arx.leverages(k).size(), 0);
    EXPECT_EQ(arx.D(k), arx.coefficients(k).rightCols(r));
    for (Index j = 1; j <= lags; ++j) {
      EXPECT_EQ(arx.input_block(k, j), arx.coefficients(k).middleCols((lags - j) * d, r));
      EXPECT_EQ(arx.output_block(k, j), arx.coefficients(k).middleCols((lags - j) * d + r, m));
    }
    // Without noise shapes all else is the same.
    EXPECT_EQ(std::pair(lean.noise_shape(k).rows(), lean.noise_shape(k).cols()), std::pair(regressors, Index(0)));
    EXPECT_EQ(lean.coefficients(k), arx.coefficients(k));
    EXPECT_EQ(lean.residual_cov(k), arx.residual_cov(k));
    EXPECT_EQ(lean.output_rms(k), arx.output_rms(k));
  }
  o.leverages = true;
  EXPECT_EQ(gtv_arx(e, o).leverages(4).size(), experiments);

  const GtvArx copy = arx;
  const Matrix coefficients = arx.coefficients(5), shape = arx.noise_shape(5);
  arx.coefficients(5).setZero();
  arx.noise_shape(5).setZero();
  EXPECT_EQ(copy.coefficients(5), coefficients);
  EXPECT_EQ(copy.noise_shape(5), shape);

  arx = copy;
  arx.begin_at(3);
  EXPECT_EQ(arx.k_begin, 3);
  for (Index k = 0; k < steps; ++k) {
    EXPECT_EQ(arx.coefficients(k).cols(), k < 3 ? 0 : 3 * d + r);
    EXPECT_EQ(arx.noise_shape(k).size() > 0, k >= 3);
    EXPECT_EQ(arx.residual_cov(k), k < 3 ? Matrix(Matrix::Zero(m, m)) : Matrix(copy.residual_cov(k)));
    EXPECT_EQ(arx.step[size_t(k)].rows, k < 3 ? 0 : experiments);
  }
}

TEST(GtvArx, RefusesLagOrdersThatMakeNoSense) {
  const Ensemble e = random_experiments(random_system({2, 1, 1}, 8, 1.0, 25), 10, 26);
  for (const std::vector<Index>& lags : {std::vector<Index>{}, {0}, {1, 2}, {-1}}) {
    GtvArxOptions options;
    options.lags = lags;
    EXPECT_THROW(gtv_arx(e, options), std::invalid_argument);
  }
  EXPECT_THROW(gtv_arx(Ensemble(3, 0, 1, 1)), std::invalid_argument);
  EXPECT_THROW(gtv_arx(Ensemble(3, 4, 1, 0)), std::invalid_argument);
}

TEST(LagOrder, CountsExperiments) {
  EXPECT_EQ(minimum_experiments(2, 2, 2), 10);
  EXPECT_EQ(largest_lag_order(10, 2, 2), 2);
  EXPECT_EQ(largest_lag_order(9, 2, 2), 1);
  EXPECT_EQ(largest_lag_order(1, 2, 2), 0);
}

TEST(LagOrder, LeaveOneOutErrorsAreThoseOfRefitting) {
  const Index count = 24, p_max = 3;
  const Ensemble e = with_noise(random_experiments(random_system({2, 1, 1}, 12, 1.0, 27), count, 28), 0.3, 29);
  LagOrderOptions options;
  options.p_max = p_max;
  const LagOrderErrors errors = lag_order_errors(e, options);
  ASSERT_EQ(errors.error.cols(), p_max);
  for (size_t s = 0; s < errors.steps.size(); s += 3) {
    const Index k = errors.steps[s];
    for (Index p = 1; p <= p_max; ++p) {
      double sum = 0.0;
      for (Index out = 0; out < count; ++out) {
        std::vector<Index> rest;
        for (Index n = 0; n < count; ++n)
          if (n != out) rest.push_back(n);
        GtvArxOptions arx_options;
        arx_options.lags = {p};
        const GtvArx fit = gtv_arx(e.subset(rest), arx_options);
        sum += std::pow(e.y(out, k, 0) - (e.window(k, p).row(out) * fit.coefficients(k).transpose())(0), 2);
      }
      EXPECT_NEAR(errors.error(Index(s), p - 1), std::log(sum / e.output(k).squaredNorm()), 1e-9) << k << " " << p;
    }
  }
}

TEST(LagOrder, NoiseFreeDataChooseTheSmallestExactOrder) {
  for (const SystemSize size : {SystemSize{4, 2, 2}, {3, 1, 1}, {2, 2, 1}}) {
    const Ensemble e = random_experiments(random_system(size, 40, 1.0, 30), 60, 31);
    LagOrderOptions options;
    options.p_max = 5;
    EXPECT_EQ(lag_order_errors(e, options).best, smallest_lag_order(size)) << name(size);
  }
}

TEST(LagOrder, OrdersWithoutADegreeOfFreedomAreNotChosen) {
  const Ensemble e = with_noise(random_experiments(random_system({2, 1, 1}, 20, 1.0, 32), 6, 33), 0.1, 34);
  LagOrderOptions options;
  options.p_max = 8;
  const LagOrderErrors errors = lag_order_errors(e, options);
  EXPECT_LE(errors.best, 2);
  for (Index p = 3; p <= 8; ++p) EXPECT_TRUE(std::isinf(errors.mean(p - 1)));
}

}  // namespace
}  // namespace tokid::testing
