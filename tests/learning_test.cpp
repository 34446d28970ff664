// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/learning.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "testing.hpp"

namespace tokid::testing {
namespace {

constexpr SystemSize learning_sizes[] = {{1, 1, 1}, {2, 1, 2}, {3, 4, 1}, {4, 2, 2}, {6, 2, 3}};

Vector flat(const Matrix& rows) { return Matrix(rows.transpose()).reshaped(); }
Matrix unflat(const Vector& v, Index columns) { return v.reshaped(columns, v.size() / columns).transpose(); }

Matrix positive(Random& random, Index size) {
  const Matrix a = random.matrix(size, size + 1);
  return a * a.transpose() / double(size);
}

Model fewer_states_at_first(Model model) {
  const Index n = model.states();
  for (Index k = 0; k < model.steps(); ++k) {
    const Step s = model.step[size_t(k)];
    const Index own = std::min(n, k), next = std::min(n, k + 1);
    model.step[size_t(k)] = Step(Matrix(s.A().topLeftCorner(next, own)), Matrix(s.B().topRows(next)),
                                 Matrix(s.C().leftCols(own)), s.D(), Matrix::Zero(next, model.outputs));
  }
  return model;
}

TEST(LiftedMap, IsMadeOfPulseResponses) {
  for (const SystemSize& size : learning_sizes)
    for (const bool varying : {false, true}) {
      Model model = random_system(size, 9, 1.0, 1);
      if (varying) model = fewer_states_at_first(model);
      const LiftedMap map(model);
      const Matrix h = map.dense();
      for (Index k = 0; k < 9; ++k)
        for (Index i = 0; i < 9; ++i) {
          const Matrix block = h.block(k * size.m, i * size.r, size.m, size.r);
          const Matrix exact = i > k    ? Matrix(Matrix::Zero(size.m, size.r))
                               : i == k ? Matrix(model.at(k).D())
                                        : pulse_response(model, k, i);
          EXPECT_LE((block - exact).norm(), 100 * epsilon * (1 + exact.norm())) << name(size) << k << i;
        }
      Random random(2);
      const Matrix u = random.matrix(9, size.r), y = random.matrix(9, size.m);
      // Sums of some 9·r products.
      EXPECT_LE((flat(map.product(u)) - h * flat(u)).norm(), 1e3 * epsilon * h.norm() * u.norm());
      EXPECT_LE((flat(map.transposed_product(y)) - h.transpose() * flat(y)).norm(),
                1e3 * epsilon * h.norm() * y.norm());
    }
}

TEST(LiftedMap, GoesOnWithAPeriodicModel) {
  Model model = random_system({3, 2, 1}, 4, 1.0, 11);
  model.period = 4;
  const LiftedMap map(model, 1, 15), whole(from_step(continued(model, 15), 1));
  Random random(12);
  const Matrix u = random.matrix(14, 1);
  EXPECT_EQ(map.product(u), whole.product(u));
  EXPECT_EQ(map.dense(), whole.dense());
  EXPECT_EQ(message([&] { map.product(Matrix::Zero(3, 1)); }), "u: 3 x 1 found, 14 x 1 needed");
  EXPECT_EQ(message([&] { map.transposed_product(Matrix::Zero(14, 1)); }), "y: 14 x 1 found, 14 x 2 needed");
  model.period = 0;
  EXPECT_EQ(message([&] { LiftedMap(model, 0, 5); }),
            "steps: 0 to 4 found, steps within 0 to 3 needed, which the model has");
}

struct Trial {
  Model model;
  Matrix reference, u, y;
  LearningWeights weights;
};

Trial random_run(const SystemSize& size, Index steps, bool rate, bool each_step, std::uint64_t seed) {
  Random random(seed);
  Trial run{random_system(size, steps, 1.0, seed),
            random.matrix(steps, size.m),
            random.matrix(steps, size.r),
            random.matrix(steps, size.m),
            {}};
  run.model.u_nominal = random.matrix(steps, size.r);
  run.model.y_nominal = random.matrix(steps, size.m);
  for (Index s = 0; s < (each_step ? steps : 1); ++s) {
    run.weights.error.push_back(positive(random, size.m));
    run.weights.input.push_back(0.1 * positive(random, size.r));
    run.weights.input_change.push_back(0.2 * positive(random, size.r));
    if (rate) run.weights.input_rate.push_back(positive(random, size.r));
  }
  return run;
}

// Block diagonal matrices of the weights, without those of missing samples.
Matrix diagonal(const std::vector<Matrix>& weights, Index steps, Index size, const Matrix& targets = {}) {
  Matrix all = Matrix::Zero(steps * size, steps * size);
  for (Index s = 0; s < steps && !weights.empty(); ++s) {
    Matrix weight = weights.size() == 1 ? weights[0] : weights[size_t(s)];
    for (Index j = 0; j < size && targets.size() > 0; ++j)
      if (std::isnan(targets(s, j))) weight.row(j).setZero(), weight.col(j).setZero();
    all.block(s * size, s * size, size, size) = weight;
  }
  return all;
}

// The dense formula of norm-optimal iterative learning.
Matrix next_inputs(const Trial& run) {
  const Index S = run.model.steps(), m = run.model.outputs, r = run.model.inputs;
  const Matrix h = LiftedMap(run.model).dense(), error = run.reference - run.y;
  const Matrix Q = diagonal(run.weights.error, S, m, error), R = diagonal(run.weights.input, S, r);
  const Matrix change = diagonal(run.weights.input_change, S, r), rate = diagonal(run.weights.input_rate, S, r);
  Matrix difference = Matrix::Identity(S * r, S * r);  // from step to step
  for (Index i = r; i < S * r; ++i) difference(i, i - r) = -1;
  const Matrix weight = R + difference.transpose() * rate * difference;
  const Vector last = flat(run.u), departures = flat(run.u - run.model.u_nominal);
  const Vector known = flat(error.array().isNaN().select(0.0, error));
  const Vector delta =
      linalg::solve(h.transpose() * Q * h + weight + change, h.transpose() * Q * known - weight * departures);
  return unflat(last + delta, r);
}

TEST(Learn, IsTheDenseFormula) {
  for (const SystemSize& size : learning_sizes)
    for (const bool rate : {false, true})
      for (const bool each_step : {false, true})
        for (const bool missing : {false, true}) {
          Trial run = random_run(size, 14, rate, each_step, 21);
          if (missing) {
            run.reference.row(3).setConstant(nan);
            run.reference(7, 0) = run.y(9, size.m - 1) = nan;
          }
          const LearnedRun found = learn(run.model, run.reference, run.u, run.y, run.weights);
          const Matrix exact = next_inputs(run);
          // The Hessian has a condition of at most 1e5 or so.
          EXPECT_LE((found.u - exact).norm(), 1e-9 * exact.norm()) << name(size) << rate << each_step << missing;
          const Matrix predicted = run.y + LiftedMap(run.model).product(found.u - run.u);
          for (Index s = 0; s < 14; ++s)
            for (Index j = 0; j < size.m; ++j)
              EXPECT_TRUE(std::isnan(run.y(s, j)) ? std::isnan(found.predicted(s, j))
                                                  : std::abs(found.predicted(s, j) - predicted(s, j)) < 1e-11);
          if (missing) continue;
          EXPECT_NEAR(found.error(0), (run.reference - run.y).col(0).norm() / std::sqrt(14.0), 1e-14);
          EXPECT_NEAR(found.predicted_error(0), (run.reference - predicted).col(0).norm() / std::sqrt(14.0), 1e-11);
        }
}

TEST(Learn, BeginsLaterAndEndsEarlierThanTheRun) {
  Trial run = random_run({3, 2, 2}, 14, true, false, 31);
  const LearnedRun whole = learn(run.model, run.reference, run.u, run.y, run.weights);
  Trial longer = run;
  const auto extended = [](const Matrix& a) {
    Matrix b = Matrix::Ones(a.rows() + 3, a.cols());
    b.topRows(a.rows()) = a;
    return b;
  };
  longer.reference = extended(run.reference), longer.u = extended(run.u), longer.y = extended(run.y);
  const LearnedRun found = learn(run.model, longer.reference, longer.u, longer.y, run.weights);
  EXPECT_EQ(found.u.topRows(14), whole.u);
  EXPECT_EQ(found.u.bottomRows(3), longer.u.bottomRows(3));
  const LearnedRun later = learn(from_step(run.model, 4), run.reference, run.u, run.y, run.weights);
  EXPECT_EQ(later.u.topRows(4), run.u.topRows(4));
  EXPECT_GT((later.u - whole.u).norm(), 0.01);
}

// Runs on a true system that the model only resembles, with a disturbance that every run repeats.
// The input before the first step of the model is known and stays, so the rate is taken to it.
TEST(Learn, AConstantInputHasNoRateWhereTheModelBegins) {
  const Model model = from_step(random_system({3, 2, 2}, 20, 1.0, 45), 4);
  Random random(46);
  const Matrix u = Matrix::Ones(20, 2), y = random.matrix(20, 2), one = Matrix::Identity(2, 2);
  const LearnedRun next =
      learn(model, y, u, y, {.error = {one}, .input_change = {1e-6 * one}, .input_rate = {100 * one}});
  EXPECT_LE((next.u - u).norm(), 1e-12 * u.norm());  // the right-hand sides are exactly zero
}

TEST(Learn, ConvergesFromRunToRun) {
  for (const SystemSize& size : {SystemSize{2, 1, 1}, {4, 2, 2}, {3, 1, 2}}) {
    Random random(41);
    Model truth = constant_system(size, 40, 0.9, 42);
    // Feedthrough outweighs the dynamics, so that the map has no small singular value, whose error would stay.
    for (Step& step : truth.step) {
      step.B() *= 0.1;
      step.D() = 3 * Matrix::Identity(size.m, size.r) + 0.2 * random.matrix(size.m, size.r);
    }
    Model model = truth;
    for (Step& step : model.step) {
      step.B() *= 1.1;
      step.D() *= 0.93;
    }
    const Matrix reference = random.matrix(40, size.m), disturbance = random.matrix(40, size.m);
    LearningWeights weights{.error = {Matrix::Identity(size.m, size.m)},
                            .input_change = {1e-3 * Matrix::Identity(size.r, size.r)}};
    Matrix u = Matrix::Zero(40, size.r);
    const LiftedMap map(truth);
    double first = 0.0, before = 0.0;
    for (int run = 0; run < 12; ++run) {
      const Matrix y = map.product(u) + disturbance;
      const double error = (reference - y).norm();
      if (run == 0) first = error;
      EXPECT_TRUE(run == 0 || error < before * 1.0001 + 1e-9 * first) << name(size) << " run " << run;
      before = error;
      u = learn(model, reference, u, y, weights).u;
    }
    EXPECT_LT(before, 1e-3 * first) << name(size);
  }
}

TEST(Learn, RefusesWhatDoesNotFit) {
  Trial run = random_run({3, 2, 1}, 6, false, false, 51);
  const auto refusal = [](const Trial& r) {
    return message([&] { learn(r.model, r.reference, r.u, r.y, r.weights); });
  };
  EXPECT_EQ(refusal(run), "no exception");
  Trial bad = run;
  bad.u = Matrix::Zero(6, 2);
  EXPECT_EQ(refusal(bad), "u: 6 x 2 found, 6 x 1 needed");
  bad = run;
  bad.y = Matrix::Zero(5, 2);
  EXPECT_EQ(refusal(bad), "y: 5 x 2 found, 6 x 2 needed");
  bad = run;
  bad.u(3, 0) = nan;
  EXPECT_EQ(refusal(bad), "u: a missing input found, all inputs of the last run needed");
  bad = run;
  bad.reference(2, 1) = std::numeric_limits<double>::infinity();
  EXPECT_EQ(refusal(bad), "reference: an infinite value found, finite ones needed");
  bad = run;
  bad.weights = {.error = run.weights.error};
  EXPECT_EQ(refusal(bad), "input: no weight on inputs found, a positive definite one needed");
  bad = run;
  bad.model = from_step(run.model, 6);
  EXPECT_EQ(refusal(bad), "reference: 6 steps found, more than 6 needed, the first step of the model");
}

}  // namespace
}  // namespace tokid::testing
