// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/observer.hpp"

namespace tokid::testing {
namespace {

Model observed_system(const SystemSize& size, Index steps, std::uint64_t seed, double growth = 1.0) {
  Model model = random_system(size, steps, growth, seed);
  Random random(seed + 1);
  for (Step& step : model.step) step.G() = 0.3 * random.matrix(size.n, size.m);
  for (Step& step : model.step) step.set_lags(smallest_lag_order(size));
  return model;
}

// Random basis changes, well conditioned.
std::vector<Matrix> bases(const Model& model, std::uint64_t seed) {
  Random random(seed);
  std::vector<Matrix> S;
  for (const Index n : state_dims(model))
    S.emplace_back(random.orthogonal(n) * (1 + random.matrix(n, 1).array().abs()).matrix().asDiagonal() *
                   random.orthogonal(n));
  return S;
}

TEST(Model, SimulatesEquationsOneAndTwo) {
  const Model model = observed_system({3, 2, 2}, 15, 60);
  const Matrix x0 = Random(61).matrix(3, 4);
  Ensemble u(4, 15, 2, 0);
  for (Index k = 0; k < 15; ++k) u.input(k) = Random(std::uint64_t(62 + k)).matrix(4, 2);
  const Ensemble y = simulate(model, u, x0);
  for (Index n = 0; n < 4; ++n) {
    Vector x = x0.col(n);
    for (size_t k = 0; k < 15; ++k) {
      const Vector uk = u.input(Index(k)).row(n).transpose();
      const Vector expected = model.step[k].C() * x + model.step[k].D() * uk;
      EXPECT_LE((y.output(Index(k)).row(n).transpose() - expected).norm(), 1e3 * epsilon * (1 + expected.norm()));
      x = model.step[k].A() * x + model.step[k].B() * uk;
    }
  }
}

TEST(Model, StepsWithoutAModelAndMissingInputsAreNaN) {
  Model model = from_step(observed_system({2, 1, 1}, 10, 63), 3);
  Ensemble u(2, 12, 1, 0);
  for (Index k = 0; k < 12; ++k) u.input(k).setOnes();
  u.u(1, 6, 0) = nan;
  const Ensemble y = simulate(model, u);
  for (Index k = 0; k < 12; ++k) {
    EXPECT_EQ(std::isnan(y.y(0, k, 0)), k < 3 || k >= 10) << k;
    EXPECT_EQ(std::isnan(y.y(1, k, 0)), k < 3 || k >= 6) << k;
  }
}

TEST(Model, NominalTrajectoryIsTakenAwayAndAddedBack) {
  Model model = observed_system({2, 1, 1}, 10, 64);
  const Ensemble plain = random_experiments(model, 3, 65);
  Model moved = model;
  moved.u_nominal = Random(66).matrix(10, 1);
  moved.y_nominal = Random(67).matrix(10, 1);
  Ensemble data = plain;
  for (Index k = 0; k < 10; ++k)
    data.input(k).rowwise() += moved.u_nominal.row(k), data.output(k).rowwise() += moved.y_nominal.row(k);
  EXPECT_LE(output_error(data, simulate(moved, data)), 1e3 * epsilon);
  EXPECT_LE(output_error(data, predict(moved, data).y), 1e3 * epsilon);
}

TEST(Predict, IsTheObserverOfEquationNine) {
  const Model model = observed_system({3, 2, 1}, 12, 68);
  const Ensemble e = random_experiments(model, 2, 69, 1.0);  // unknown to the observer, which starts from zero
  for (const Index horizon : {1, 2, 4}) {
    PredictOptions options{horizon, InitialState::zero};
    const Prediction prediction = predict(model, e, options);
    for (Index n = 0; n < 2; ++n) {
      std::vector<Vector> state{Vector::Zero(3)};  // x̂_{k|k-1}
      for (size_t k = 0; k < 12; ++k)
        state.emplace_back(model.at(Index(k)).closed_loop() * state.back() +
                           (model.step[k].B() + model.step[k].G() * model.step[k].D()) *
                               e.input(Index(k)).row(n).transpose() -
                           model.step[k].G() * e.output(Index(k)).row(n).transpose());
      for (Index k = 0; k < 12; ++k) {
        const Index origin = std::max<Index>(0, k - horizon + 1);
        Vector x = state[size_t(origin)];
        for (Index j = origin; j < k; ++j)
          x = model.step[size_t(j)].A() * x + model.step[size_t(j)].B() * e.input(j).row(n).transpose();
        const Vector expected =
            model.step[size_t(k)].C() * x + model.step[size_t(k)].D() * e.input(k).row(n).transpose();
        EXPECT_LE((prediction.y.output(k).row(n).transpose() - expected).norm(), 1e3 * epsilon * (1 + expected.norm()));
        if (horizon == 1) {
          EXPECT_LE((prediction.innovations[size_t(k)].row(n).transpose() - (e.output(k).row(n).transpose() - expected))
                        .norm(),
                    1e3 * epsilon * (1 + expected.norm()));
        }
      }
    }
  }
}

TEST(Predict, UnknownInitialStatesAreFoundFromTheFirstSamples) {
  for (const SystemSize size : {SystemSize{4, 2, 2}, {3, 1, 1}, {2, 3, 1}}) {
    const Model model = observed_system(size, 20, 70);
    const Ensemble e = random_experiments(model, 5, 71, 50.0);
    const Index p = model.max_lags();
    const Prediction prediction = predict(model, e, {1, InitialState::unknown});
    for (Index k = 0; k < 20; ++k) EXPECT_EQ(prediction.y.output(k).allFinite(), k >= p) << k;
    EXPECT_LE(output_error(e, prediction.y), 1e-10) << name(size);
    const Prediction ahead = predict(model, e, {3, InitialState::unknown});
    for (Index k = 0; k < 20; ++k) EXPECT_EQ(ahead.y.output(k).allFinite(), k >= p + 2) << k;
    EXPECT_LE(output_error(e, ahead.y), 1e-10) << name(size);
  }
}

TEST(Predict, MissingOutputsCorrectNothingAndMissingInputsBlindTheObserver) {
  const Model model = observed_system({2, 2, 1}, 20, 72);
  Ensemble e = random_experiments(model, 3, 73);
  e.y(0, 5, 1) = nan;
  e.u(1, 8, 0) = nan;
  const Prediction prediction = predict(model, e);
  // Noise-free, the state is exact, so a missing output changes no prediction.
  for (Index k = 0; k < 20; ++k) {
    EXPECT_TRUE(prediction.y.output(k).row(0).allFinite());
    EXPECT_EQ(prediction.y.output(k).row(1).allFinite(), k < 8 || k > 8 + model.max_lags()) << k;
    EXPECT_TRUE(prediction.y.output(k).row(2).allFinite());
  }
  EXPECT_TRUE(std::isnan(prediction.innovations[5](0, 1)));
  Ensemble whole = random_experiments(model, 3, 73);
  EXPECT_LE(output_error(whole.subset({0, 2}), prediction.y.subset({0, 2})), 1e3 * epsilon);
}

// Gains that cancel the noise which outputs have in common would double it where one of them is missing alone.
TEST(Predict, WhatOtherOutputsSayOfMissingOnesIsNotLost) {
  const Model system = kalman_observer(with_noise(oscillator(30), {.process_noise = 0.1, .measurement_noise = 0.3}));
  const Ensemble plain =
      experiments(system, {.experiments = 20, .seed = 74, .process_noise = 0.1, .measurement_noise = 0.3});
  const Index m = system.outputs;
  // All outputs twice, and a gain that leans on the difference of the two, which is always zero.
  const double lean = 1e4;
  Model twice = system;
  twice.outputs = 2 * m;
  Ensemble e(plain.experiments(), plain.steps(), plain.inputs(), 2 * m, plain.dt);
  const auto doubled = [](const Matrix& a) { return (Matrix(2 * a.rows(), a.cols()) << a, a).finished(); };
  for (Index k = 0; k < system.steps(); ++k) {
    const size_t s = size_t(k);
    const Step& one = system.step[s];
    Matrix gain(system.n(k + 1), 2 * m);
    gain << (0.5 + lean) * one.G(), (0.5 - lean) * one.G();
    twice.step[s] = Step(one.A(), one.B(), doubled(one.C()), doubled(one.D()), gain);
    twice.step[s].set_innovation_cov(doubled(doubled(one.innovation_cov()).transpose()));
    e.input(k) = plain.input(k);
    e.output(k) << plain.output(k), plain.output(k);
  }
  twice.names = {};
  twice.check();
  for (Index n = 0; n < e.experiments(); ++n) e.y(n, n % 30, n % (2 * m)) = nan;
  const Ensemble expected = predict(system, plain).y, found = predict(twice, e).y;
  // The whitener lifts variances by ε times the size; the gain multiplies what that makes of the differences.
  for (Index k = 0; k < system.steps(); ++k)
    EXPECT_LE((found.output(k).leftCols(m) - expected.output(k)).norm(),
              lean * 1e3 * epsilon * expected.output(k).norm())
        << k;
}

TEST(Predict, AModelThatBeginsLateDoesNotTakeItsFirstStateForZero) {
  const Model whole = observed_system({4, 2, 1}, 20, 95);
  const Model late = from_step(whole, 5);
  Ensemble e = random_experiments(whole, 4, 96);
  e.initial_state = InitialState::zero;
  EXPECT_FALSE(starts_from_zero(late, InitialState::zero));
  EXPECT_TRUE(starts_from_zero(whole, InitialState::zero));
  EXPECT_FALSE(starts_from_zero(whole, InitialState::unknown));
  const Prediction prediction = predict(late, e);
  for (Index k = 0; k < 20; ++k) EXPECT_EQ(prediction.y.output(k).allFinite(), k >= 7) << k;
  EXPECT_LE(output_error(e, prediction.y), 1e-10);
}

TEST(Predict, StatesThatTheFirstSamplesDoNotTellAreWaitedFor) {
  Model model = observed_system({4, 2, 1}, 20, 97);
  set_gains(model, deadbeat_gain(model).G);
  Ensemble e = random_experiments(model, 3, 98, 10.0);
  e.y(1, 1, 0) = nan;  // p·m = n: every sample of the first two steps is needed
  const Prediction prediction = predict(model, e, {1, InitialState::unknown});
  const Ensemble truth = random_experiments(model, 3, 98, 10.0);
  for (Index k = 0; k < 20; ++k) {
    EXPECT_EQ(prediction.y.output(k).row(0).allFinite(), k >= 2) << k;
    EXPECT_EQ(prediction.y.output(k).row(1).allFinite(), k >= 3) << k;  // the third sample makes up for the missing one
  }
  EXPECT_LE(output_error(truth.subset({0, 1, 2}), prediction.y, 3), 1e-9);
}

TEST(Predict, NothingIsPredictedFromSamplesThatAreNotThere) {
  // p·m > n, gains far from deadbeat: what is not estimated is not forgotten either.
  Model model = observed_system({3, 2, 1}, 30, 101);
  const Ensemble truth = random_experiments(model, 4, 102, 10.0);
  Ensemble e = truth;
  for (Index k = 0; k < 12; ++k) e.output(k).row(1).setConstant(nan);
  e.u(2, 10, 0) = nan;
  for (Index k = 10; k < 16; ++k) e.output(k).row(2).setConstant(nan);
  e.u(3, 15, 0) = nan;
  const Prediction prediction = predict(model, e, {1, InitialState::unknown});
  for (Index k = 0; k < 30; ++k) {
    EXPECT_EQ(prediction.y.output(k).row(0).allFinite(), k >= 2) << k;
    EXPECT_EQ(prediction.y.output(k).row(1).allFinite(), k >= 14) << k;
    EXPECT_EQ(prediction.y.output(k).row(2).allFinite(), (k >= 2 && k < 10) || k >= 18) << k;
    EXPECT_EQ(prediction.y.output(k).row(3).allFinite(), (k >= 2 && k < 15) || k >= 18) << k;
    for (Index n = 0; n < 4; ++n)
      for (Index j = 0; j < 2; ++j)
        if (!std::isnan(prediction.y.y(n, k, j))) {
          EXPECT_NEAR(prediction.y.y(n, k, j), truth.y(n, k, j), 1e-9) << n << " " << k;
        }
  }
}

TEST(Predict, StateEstimatesUseTheSamplesThatAreThere) {
  const Model model = observed_system({3, 2, 1}, 12, 74);
  const Matrix x0 = Random(75).matrix(3, 4);
  Ensemble e(4, 12, 1, 2);
  for (Index k = 0; k < 12; ++k) e.input(k) = Random(std::uint64_t(76 + k)).matrix(4, 1);
  e = simulate(model, e, x0);
  e.y(1, 1, 0) = nan;
  e.y(2, 0, 0) = e.y(2, 0, 1) = nan;
  e.u(3, 1, 0) = nan;
  const Matrix x = estimate_state(model, e, 0, 4);
  EXPECT_LE((x.leftCols(3) - x0.leftCols(3)).norm(), 1e-10);
  EXPECT_TRUE(x.col(3).array().isNaN().all());  // the response to a missing input is not known
  EXPECT_THROW(estimate_state(model, e, 10, 4), std::invalid_argument);
}

TEST(Coordinates, ChangeNoOutputAndNoPulseResponse) {
  for (const SystemSize size : {SystemSize{1, 1, 1}, {4, 2, 2}, {5, 1, 3}}) {
    Model model = observed_system(size, 16, 77);
    for (Step& step : model.step) {
      step.set_K(Matrix::Ones(size.n, size.m));
      step.set_Q(Matrix::Identity(size.n, size.n));
    }
    const Model other = transform(model, bases(model, 78));
    other.check();
    EXPECT_TRUE(kinematically_similar(model, other, 1e-11).similar);
    const Ensemble e = random_experiments(model, 3, 79);
    EXPECT_LE(output_error(e, simulate(other, e)), 1e-11);
    for (Index k = 2; k < 16; ++k)
      EXPECT_LE((gain_pulse_response(model, k, k - 2) - gain_pulse_response(other, k, k - 2)).norm(), 1e-11);
    // C K is the same in all coordinates.
    EXPECT_LE((model.step[3].C() * model.step[3].K() - other.step[3].C() * other.step[3].K()).norm(),
              1e-11 * model.step[3].C().norm());
  }
}

TEST(Coordinates, SimilarityTellsModelsApart) {
  const Model model = observed_system({3, 2, 1}, 16, 80);
  Model other = model;
  other.step[7].A() *= 1 + 1e-6;
  const Similarity s = kinematically_similar(model, other);
  EXPECT_FALSE(s.similar);
  EXPECT_GT(s.max_difference, 1e-8);
  EXPECT_LT(s.max_difference, 1e-5);
  other = model;
  other.step[0].D() *= 1.01;
  EXPECT_FALSE(kinematically_similar(model, other).similar);
}

TEST(Coordinates, RelativeErrorIsThatOfEachResponse) {
  const Model truth = observed_system({3, 2, 2}, 12, 81);
  Model model = truth;
  // Twice the first output, and one and a half times the effect of the second input.
  for (Step& step : model.step) {
    step.C().row(0) *= 2;
    step.D().row(0) *= 2;
    step.B().col(1) *= 1.5;
    step.D().col(1) *= 1.5;
  }
  const Similarity found = kinematically_similar(model, truth, 1e-8, 5);
  const Matrix expected{{1.0, 2.0}, {0.0, 0.5}};
  // Sums of up to 12·5 squares in one order, of numbers that are products of three exact multiples.
  EXPECT_LE((found.relative_error - expected).cwiseAbs().maxCoeff(), 60 * epsilon);
  EXPECT_EQ(found.begin, 0);
  EXPECT_EQ(found.end, 12);
  EXPECT_EQ(found.band, 5);
  model = truth;
  for (Step& step : model.step) step.B().col(0).setZero(), step.D().col(0).setZero();
  EXPECT_TRUE(kinematically_similar(truth, model).relative_error.col(0).array().isNaN().all());
  EXPECT_TRUE((kinematically_similar(model, truth).relative_error.col(0).array() == 1).all());
}

TEST(Coordinates, SimilarityContinuesModelsThatGoOn) {
  Model a = observed_system({2, 1, 1}, 2, 83), b = observed_system({2, 1, 1}, 3, 84);
  a.period = 2;
  b.period = 3;
  const Similarity both = kinematically_similar(a, b, 1e-8, 4);
  EXPECT_EQ(both.end, 2 * 3 + 4);
  EXPECT_GT(both.max_difference, 1e-3);
  EXPECT_TRUE(kinematically_similar(a, continued(a, 11)).similar);
  const Model varying = cut(a, 1, 9);
  Model ends = varying;
  ends.period = 0;
  EXPECT_EQ(kinematically_similar(a, ends).end, 9);
  EXPECT_EQ(kinematically_similar(ends, a).begin, 1);
  EXPECT_TRUE(kinematically_similar(ends, a).similar);
  ends.at(8).D() *= 2;
  EXPECT_FALSE(kinematically_similar(a, ends).similar);
  EXPECT_NE(message([&] {
              kinematically_similar(cut(ends, 1, 3), cut(ends, 5, 7));
            }).find("steps 1 to 2 and 5 to 6 found, common steps needed"),
            std::string::npos);
}

TEST(Coordinates, ReferenceFrameEndsWhereItsCoordinatesFail) {
  Model model = random_system({2, 2, 1}, 30, 1.0, 99);
  for (size_t k = 0; k < 30; ++k) {
    model.step[k].A().setIdentity();
    model.step[k].C() = Matrix{{1, 0}, {0, k < 15 ? 1.0 : -1.0}};
  }
  // Rows from both sides of step 15 cancel in P O_k there.
  const FramedModel framed = reference_frame(model, 0, 2);
  EXPECT_EQ(framed.begin, 0);
  EXPECT_EQ(framed.end, 14);
  EXPECT_TRUE(kinematically_similar(framed.model, model, 1e-12).similar);
  std::vector<Matrix> singular(31, Matrix::Identity(2, 2));
  singular[3](0, 0) = 0;
  EXPECT_THROW(transform(model, singular), std::invalid_argument);
}

TEST(Coordinates, ReferenceFrameDoesNotDependOnTheBasisUpToOneSimilarity) {
  const Model model = observed_system({4, 2, 2}, 20, 81);
  const Model other = transform(model, bases(model, 82));
  const FramedModel a = reference_frame(model, 3, 3), b = reference_frame(other, 3, 3);
  EXPECT_EQ(a.begin, 0);
  EXPECT_EQ(a.end, 18);
  // The constant similarity is the change of basis at the reference step.
  const Matrix t = bases(model, 82)[3];
  for (Index k = 1; k + 1 < a.end; ++k) {
    const Matrix expected = t * a.model.at(k).closed_loop() * t.inverse();
    EXPECT_LE((b.model.at(k).closed_loop() - expected).norm(), 1e-9 * expected.norm()) << k;
  }
  EXPECT_EQ(a.model.frame, "reference");
  EXPECT_TRUE(kinematically_similar(model, a.model, 1e-9).similar);
  EXPECT_THROW(reference_frame(model, 18, 3), std::invalid_argument);
  EXPECT_THROW(reference_frame(model, -1, 3), std::invalid_argument);
}

TEST(Coordinates, AlignedModelsHaveTheMatricesOfTheReference) {
  for (const SystemSize size : {SystemSize{3, 2, 1}, {4, 1, 2}, {2, 3, 2}}) {
    Model reference = random_system(size, 20, 1.0, 70);
    Random random(71);
    for (Step& step : reference.step) step.G() = random.matrix(size.n, size.m);
    std::vector<Matrix> S;
    for (Index k = 0; k <= 20; ++k)
      S.emplace_back(random.orthogonal(size.n) * Vector::LinSpaced(size.n, 0.5, 2).asDiagonal());
    const Index rows = smallest_lag_order(size) + 1;
    const FramedModel aligned = align(transform(reference, S), reference, rows);
    EXPECT_EQ(aligned.begin, 0);
    EXPECT_EQ(aligned.end, 20 - rows + 1);  // later states have too few outputs ahead of them
    for (Index k = aligned.begin; k + 1 < aligned.end; ++k) {
      const size_t s = size_t(k);
      // Observability matrices of so few rows have condition numbers up to some 1e3.
      EXPECT_LE((aligned.model.step[s].A() - reference.step[s].A()).norm(), 1e-10) << name(size) << k;
      EXPECT_LE((aligned.model.step[s].B() - reference.step[s].B()).norm(), 1e-10 * reference.step[s].B().norm())
          << name(size) << k;
      EXPECT_LE((aligned.model.step[s].G() - reference.step[s].G()).norm(), 1e-10 * reference.step[s].G().norm())
          << name(size) << k;
    }
    EXPECT_TRUE(kinematically_similar(aligned.model, reference).similar);
  }
}

TEST(Coordinates, ModelsWithoutACommonStateDimensionAreNotAligned) {
  const Model a = random_system({3, 1, 1}, 20, 1.0, 72);
  EXPECT_THROW(align(a, random_system({2, 1, 1}, 20, 1.0, 73), 4), std::invalid_argument);
  EXPECT_THROW(align(a, random_system({3, 2, 1}, 20, 1.0, 73), 4), std::invalid_argument);
  EXPECT_THROW(align(a, random_system({3, 1, 1}, 3, 1.0, 73), 4), std::invalid_argument);
  EXPECT_THROW(align(a, random_system({3, 1, 1}, 20, 1.0, 73), 2), std::invalid_argument);  // two rows for three states
}

TEST(Coordinates, SmoothFrameVariesAsSlowlyAsTheSystem) {
  const Model system = oscillator(60);
  // Balanced coordinates, each step's turned at random: what a realisation hands over.
  const auto jumpiness = [](const Model& m) {
    double sum = 0.0;
    for (size_t k = 5; k < 50; ++k) sum += (m.step[k + 1].A() - m.step[k].A()).norm();
    return sum;
  };
  Random random(83);
  std::vector<Matrix> turns;
  for (const Index n : state_dims(system)) turns.push_back(random.orthogonal(n));
  const Model turned = transform(system, turns), smooth = smooth_frame(turned, 4);
  EXPECT_EQ(smooth.frame, "smooth");
  EXPECT_TRUE(kinematically_similar(smooth, system, 1e-10).similar);
  EXPECT_GT(jumpiness(turned), 20 * jumpiness(system));
  EXPECT_LT(jumpiness(smooth), 3 * jumpiness(system));
}

TEST(Coordinates, SmoothFrameAcceptsVaryingStateDimensions) {
  Model model = observed_system({3, 1, 2}, 8, 84);
  // Cut the first state down to two and the last to one.
  const Step first = model.step[0], last = model.step[7];
  model.step[0] = Step(first.A().leftCols(2), first.B(), first.C().leftCols(2), first.D(), first.G());
  model.step[7] = Step(last.A().topRows(1), last.B().topRows(1), last.C(), last.D(), last.G().topRows(1));
  for (const size_t s : {0, 7}) model.step[s].set_lags(3);
  const Model smooth = smooth_frame(model, 3);
  smooth.check();
  EXPECT_TRUE(kinematically_similar(smooth, model, 1e-10).similar);
  EXPECT_EQ(model.full_begin(), 1);
  EXPECT_EQ(model.full_end(), 8);
}

TEST(Model, CheckNamesWhatDisagrees) {
  const Model model = observed_system({2, 1, 1}, 4, 85);
  EXPECT_NO_THROW(model.check());
  const auto message = [](const Model& broken) -> std::string {
    try {
      broken.check();
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  Model broken = model;
  broken.step[2] = Step(2, 2, 3, 1);
  EXPECT_EQ(message(broken), "model: step 2 has 3 inputs and 1 outputs, 1 and 1 needed");
  broken = model;
  broken.step[1] = Step(2, 3, 1, 1);
  broken.step[1].set_lags(2);
  EXPECT_EQ(message(broken), "model: A[2] has 2 columns, 3 needed: the rows of A[1]");
  broken = model;
  broken.step[3].set_Q(Matrix::Identity(2, 2));
  EXPECT_EQ(message(broken),
            "model: Q is known at step 3 or at step 0, but not at both. State it at every step or at none");
  broken = model;
  broken.step[3] = Step(2, 1, 1, 1);
  broken.step[3].take_diagnostics_of(model.step[3]);
  EXPECT_EQ(message(broken), "");
  broken.period = 5;  // longer than the model, which therefore ends
  EXPECT_EQ(message(broken), "");
  broken.period = 3;
  EXPECT_EQ(message(broken),
            "model: 1 states found after step 3, 2 needed: those of step 1, a period of 3 steps before");
  EXPECT_THROW(simulate(broken, Ensemble(1, 9, 1, 0)), std::invalid_argument);
  broken = model;
  broken.x0_mean = Vector::Ones(3);
  EXPECT_EQ(message(broken), "model: x0_mean has 3 entries, 2 needed: the states of step 0");
  broken = model;
  broken.x0_cov = Matrix::Identity(1, 2);
  EXPECT_EQ(message(broken), "model: x0_cov is 1 x 2, 2 x 2 needed: the states of step 0");
  broken = model;
  broken.u_nominal.resize(4, 0);  // rows without a number
  EXPECT_NE(message(broken).find("model: u_nominal is 4 x 0"), std::string::npos);
  broken = model;
  for (Step& step : broken.step) step.set_lags(2'000'000);
  EXPECT_EQ(message(broken), "model: lags[0] is 2000000, 0 to 1000000 needed");
  broken = model;
  broken.k_begin = std::numeric_limits<Index>::max();
  EXPECT_NE(message(broken).find("model: first step 9223372036854775807 found"), std::string::npos);
  broken = model;
  broken.step[2] = broken.step[2].outline();
  EXPECT_EQ(message(broken), "model: step 2 has no matrices");
  broken = model;
  for (Step& step : broken.step) step.set_R(Matrix::Identity(1, 1));
  broken.step[3].set_R(Matrix::Constant(1, 1, nan));
  EXPECT_EQ(message(broken), "model: R[3] has a value that is not finite");
  broken = model;
  broken.step[1].G()(1, 0) = nan;
  EXPECT_EQ(message(broken), "model: G[1] has a value that is not finite");
  broken = model;
  broken.u_nominal = Matrix::Zero(4, 1);
  EXPECT_NE(message(broken), "");
  broken = model;
  broken.dt = 0;
  EXPECT_NE(message(broken), "");
  broken = model;
  broken.names.output_names = {"a", "b"};
  EXPECT_EQ(message(broken), "model: 2 entries of output_names found, 1 needed");
  broken = model;
  broken.names.input_units = {"N", "m"};
  EXPECT_EQ(message(broken), "model: 2 entries of input_units found, 1 needed");
}

TEST(Model, FromStepKeepsTheRest) {
  const Model model = observed_system({2, 1, 1}, 10, 86);
  const Model rest = from_step(model, 4);
  rest.check();
  EXPECT_EQ(rest.k_begin, 4);
  EXPECT_EQ(rest.k_end(), 10);
  EXPECT_EQ(rest.at(6).A(), model.step[6].A());
  EXPECT_EQ(rest.n(10), 2);
  EXPECT_THROW(from_step(model, 11), std::invalid_argument);
}

TEST(Model, CutKeepsTheStepsBetween) {
  Model model = observed_system({2, 1, 1}, 10, 86);
  model.x0_mean = Vector::Ones(2);
  const Model part = cut(model, 3, 7);
  part.check();
  EXPECT_EQ(part.k_begin, 3);
  EXPECT_EQ(part.k_end(), 7);
  EXPECT_EQ(part.at(6).A(), model.step[6].A());
  EXPECT_EQ(part.x0_mean.size(), 0);
  EXPECT_EQ(cut(model, 0, 4).x0_mean, model.x0_mean);
  EXPECT_NE(message([&] { cut(model, 3, 11); }).find("cut: steps 3 to 10 found, steps within 0 to 9 needed"),
            std::string::npos);
  EXPECT_THROW(cut(model, 7, 3), std::invalid_argument);
  EXPECT_THROW(cut(part, 2, 5), std::invalid_argument);
}

TEST(Model, CutContinuesPeriodicModels) {
  Model model = observed_system({2, 1, 1}, 4, 86);
  model.period = 4;
  const Model longer = cut(model, 2, 11);
  EXPECT_EQ(longer.k_end(), 11);
  EXPECT_EQ(longer.at(10).A(), model.step[2].A());
  EXPECT_EQ(longer.period, 4);
  // Whether the part goes on depends on its steps, not on those that the model stores.
  EXPECT_EQ(cut(continued(model, 12), 0, 8).period, 4);
  EXPECT_EQ(cut(model, 0, 8).period, 4);
  EXPECT_EQ(cut(model, 0, 3).period, 0);
  EXPECT_EQ(cut(model, 3, 4).period, 0);
  EXPECT_EQ(from_step(model, 3).period, 0);
  EXPECT_THROW(cut(model, 5, 5), std::invalid_argument);
  // The first steps of a model may differ from the period that it repeats.
  model.period = 1;
  EXPECT_EQ(cut(model, 0, 2).period, 0);
  EXPECT_EQ(cut(model, 1, 4).period, 1);
  EXPECT_EQ(cut(model, 0, 7).period, 1);
}

// Parts in different coordinates, cut from one system, make the system again.
TEST(Join, TwoPartsOfASystemMakeTheSystem) {
  for (const SystemSize size : {SystemSize{1, 1, 1}, {4, 2, 2}, {5, 1, 3}}) {
    const Index rows = smallest_lag_order(size);
    Model system = observed_system(size, 24, 91);
    for (Step& step : system.step) {
      step.set_Q(Matrix::Identity(size.n, size.n));
      step.set_K(Matrix::Ones(size.n, size.m));
      step.set_lags(rows);
    }
    const Model other = transform(system, bases(system, 92));
    const Model earlier = cut(system, 0, 12 + rows), later = cut(other, 8, 24);
    for (const Index k : {8, 10, 12}) {
      const JoinedModel joined = join(earlier, later, k, rows);
      joined.model.check();
      EXPECT_EQ(joined.model.k_begin, 0);
      EXPECT_EQ(joined.model.k_end(), 24);
      // Bases and observability matrices of few rows have condition numbers up to some 1e3 each.
      EXPECT_LE(joined.misfit, 1e-10) << name(size);
      EXPECT_TRUE(kinematically_similar(joined.model, system, 1e-9, 24).similar) << name(size);
      EXPECT_EQ(joined.model.at(k - 1).K(), earlier.at(k - 1).K());
      EXPECT_EQ(joined.model.at(k).lags(), rows);
      const Matrix Q = joined.model.at(k - 1).Q(), expected = other.at(k - 1).Q();  // of the state at k, as `later`
      EXPECT_LE((Q - expected).norm(), 1e-9 * expected.norm());
    }
  }
}

TEST(Join, KeepsNominalTrajectoriesAndCommonParts) {
  Model earlier = observed_system({2, 1, 1}, 12, 93), later = earlier;
  earlier.u_nominal = Matrix::Constant(12, 1, 1), earlier.y_nominal = Matrix::Constant(12, 1, 2);
  later.u_nominal = Matrix::Constant(12, 1, 3), later.y_nominal = Matrix::Constant(12, 1, 4);
  for (Step& step : later.step) step.set_R(Matrix::Identity(1, 1));
  earlier.provenance.data = {"a"}, later.provenance.data = {"a", "b"};
  const Model model = join(earlier, later, 5, 2).model;
  model.check();
  EXPECT_EQ(model.u_nominal(4, 0), 1);
  EXPECT_EQ(model.y_nominal(5, 0), 4);
  EXPECT_FALSE(model.has(&Step::has_R));
  EXPECT_EQ(model.provenance.data, (std::vector<std::string>{"a", "b"}));
  later.u_nominal.resize(0, 0), later.y_nominal.resize(0, 0);
  EXPECT_NE(message([&] { join(earlier, later, 5, 2); }).find("in the earlier model only"), std::string::npos);
}

// The misfit is of the order of the changes.
TEST(Join, TellsHowMuchTheModelsDiffer) {
  const Model system = observed_system({3, 2, 1}, 20, 94);
  for (const auto part : system_parts) {
    Model off = system;
    for (Step& step : off.step) (step.*part)() *= 1.01;
    const double misfit = join(system, off, 10, 3).misfit;
    EXPECT_GT(misfit, 1e-3);
    EXPECT_LT(misfit, 0.1);
  }
}

// One row of outputs leaves a state of two unknown, however well the outputs of this row agree.
TEST(Join, NeedsRowsThatDetermineTheState) {
  const Model system = observed_system({2, 1, 1}, 12, 95);
  const Model other = transform(system, bases(system, 96));
  EXPECT_NE(message([&] { join(system, other, 5, 1); }).find("1 block rows of step 5 don't determine its 2 states"),
            std::string::npos);
  EXPECT_LE(join(system, other, 5, 2).misfit, 1e-10);  // as in the first test of joints
  Model unseen = system;
  for (Step& step : unseen.step) step.C().setZero();
  EXPECT_THROW(join(unseen, unseen, 5, 3), std::invalid_argument);
}

TEST(Join, ContinuesPeriodicModelsAndKeepsWhatItCan) {
  Model cycle = observed_system({2, 1, 1}, 4, 97);
  cycle.period = 4;
  cycle.x0_mean = Vector::Ones(2);
  cycle.method = "tvera";
  Model later = cut(cycle, 2, 14);
  later.method = "subspace";
  for (Model* model : {&cycle, &later})
    for (Step& step : model->step) step.set_lags(2), step.set_R(Matrix::Identity(1, 1));
  const Model joined = join(cycle, later, 6, 2).model;
  joined.check();
  EXPECT_EQ(joined.k_end(), 14);
  EXPECT_EQ(joined.period, 0);
  EXPECT_EQ(joined.x0_mean, cycle.x0_mean);
  EXPECT_EQ(joined.method, "known");
  EXPECT_FALSE(joined.has(&Step::has_lags));
  EXPECT_TRUE(joined.has(&Step::has_R));
  EXPECT_TRUE(kinematically_similar(joined, cycle).similar);
}

TEST(Join, RefusesModelsThatDoNotFitTogether) {
  const Model model = observed_system({2, 1, 1}, 12, 95);
  EXPECT_NE(message([&] {
              join(cut(model, 0, 6), cut(model, 6, 12), 6, 2);
            }).find("join: step 6 with 2 block rows found; the models have steps 0 to 5 and 6 to 11"),
            std::string::npos);
  EXPECT_THROW(join(model, model, 0, 2), std::invalid_argument);
  EXPECT_THROW(join(model, observed_system({3, 1, 1}, 12, 95), 5, 3), std::invalid_argument);
  EXPECT_THROW(join(model, observed_system({2, 1, 2}, 12, 95), 5, 2), std::invalid_argument);
  Model slow = model;
  slow.dt = 2 * model.dt;
  EXPECT_NE(message([&] { join(model, slow, 5, 2); }).find("sample times"), std::string::npos);
}

TEST(Model, PulseResponsesAreThoseOfEachStep) {
  const Model model = from_step(observed_system({3, 2, 2}, 12, 88), 2);
  const std::vector<Matrix> all = pulse_responses(model, 4);
  ASSERT_EQ(all.size(), size_t(model.steps()));
  for (Index k = model.k_begin; k < model.k_end(); ++k)
    for (Index gamma = 1; gamma <= 4; ++gamma) {
      const auto block = all[model.index(k)].middleCols((gamma - 1) * model.inputs, model.inputs);
      if (k - gamma < model.k_begin)
        EXPECT_TRUE(block.array().isNaN().all()) << k << " " << gamma;
      else  // products in another order
        EXPECT_LE((block - pulse_response(model, k, k - gamma)).norm(), 1e-13 * block.norm()) << k << " " << gamma;
    }
}

TEST(Model, WrongChannelsAndStatesAreRefused) {
  const Model model = observed_system({2, 2, 1}, 10, 87);
  EXPECT_THROW(simulate(model, Ensemble(1, 10, 2, 0)), std::invalid_argument);
  EXPECT_THROW(simulate(model, Ensemble(3, 10, 1, 0), Matrix::Zero(2, 2)), std::invalid_argument);
  EXPECT_THROW(predict(model, Ensemble(1, 10, 1, 1)), std::invalid_argument);
  EXPECT_THROW(predict(model, Ensemble(1, 10, 1, 2), {0, {}}), std::invalid_argument);
  EXPECT_THROW(pulse_response(model, 3, 3), std::invalid_argument);
  EXPECT_THROW(pulse_response(model, 10, 3), std::invalid_argument);
  EXPECT_THROW(pulse_responses(model, 0), std::invalid_argument);
  EXPECT_EQ(observability(model, 8, 3).rows(), 4);
  EXPECT_EQ(observability(model, 10, 3).rows(), 0);
  EXPECT_THROW(observability(model, 11, 1), std::invalid_argument);
  EXPECT_THROW(observability(model, -1, 1), std::invalid_argument);
  EXPECT_THROW(observability(from_step(model, 3), 2, 1), std::invalid_argument);
  EXPECT_THROW(observability(model, 3, -1), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
