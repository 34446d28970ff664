// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/control.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/observer.hpp"
#include "tokid/online_observer.hpp"

namespace tokid::testing {
namespace {

constexpr SystemSize control_sizes[] = {{1, 1, 1}, {2, 1, 2}, {3, 4, 1}, {4, 2, 2}, {6, 2, 3}};

Matrix random_weight(Random& random, Index size, Index rank) {
  const Matrix a = random.matrix(size, rank);
  return a * a.transpose() / double(rank);
}

struct Parts {
  bool rate = false, terminal = false, each_step = false, reference = false, nominal = false;
};

struct Case {
  Model model;
  CostWeights weights;
  ControlOptions options;
};

// The state dimension varies: the first steps have fewer states.
Model growing(Model model) {
  const Index n = model.states();
  const auto dimension = [n](Index k) { return std::min(n, k); };
  for (Index k = 0; k < model.steps(); ++k) {
    const Step s = model.step[size_t(k)];
    model.step[size_t(k)] =
        Step(Matrix(s.A().topLeftCorner(dimension(k + 1), dimension(k))), Matrix(s.B().topRows(dimension(k + 1))),
             Matrix(s.C().leftCols(dimension(k))), s.D(), Matrix::Zero(dimension(k + 1), model.outputs));
  }
  return model;
}

Case random_case(const SystemSize& size, Index steps, const Parts& parts, std::uint64_t seed) {
  Random random(seed);
  Case result{random_system(size, steps, 1.05, seed), {}, {}};
  const Index count = parts.each_step ? steps : 1;
  for (Index s = 0; s < count; ++s) {
    result.weights.output.push_back(random_weight(random, size.m, 2));
    result.weights.input.push_back(random_weight(random, size.r, size.r + 1) + 0.1 * Matrix::Identity(size.r, size.r));
    if (parts.rate) result.weights.input_rate.push_back(random_weight(random, size.r, 1));
  }
  if (parts.terminal) result.weights.terminal = random_weight(random, size.m, size.m);
  if (parts.reference) {
    result.options.y_reference = random.matrix(steps, size.m);
    result.options.u_reference = random.matrix(steps, size.r);
  }
  if (parts.nominal) {
    result.model.u_nominal = random.matrix(steps, size.r);
    result.model.y_nominal = random.matrix(steps, size.m);
  }
  return result;
}

Matrix at_step(const std::vector<Matrix>& list, Index s, Index size) {
  if (list.empty()) return Matrix::Zero(size, size);
  return list.size() == 1 ? list.front() : list[size_t(s)];
}

// All inputs as one vector, and the outputs they make: Y = O x_0 + H U. J is a quadratic form whose minimum follows
// from one linear equation, without any recursion.
struct Dense {
  Matrix H, O;
  Matrix hessian;  // J = Uᵀ hessian U - 2 gradientᵀ U + constant
  Vector gradient;
  double constant;
  Vector best() const { return linalg::solve(hessian, gradient); }
  double cost(const Vector& u) const { return u.dot(hessian * u) - 2 * gradient.dot(u) + constant; }
};

Dense dense(const Case& c, const Vector& x0) {
  const Index S = c.model.steps(), m = c.model.outputs, r = c.model.inputs;
  Dense d{Matrix::Zero(S * m, S * r), Matrix(S * m, x0.size()), {}, {}, 0.0};
  Matrix of_inputs = Matrix::Zero(x0.size(), S * r), of_x0 = Matrix::Identity(x0.size(), x0.size());
  for (Index k = 0; k < S; ++k) {
    const Step& step = c.model.at(k);
    d.H.middleRows(k * m, m) = step.C() * of_inputs;
    d.H.block(k * m, k * r, m, r) += step.D();
    d.O.middleRows(k * m, m) = step.C() * of_x0;
    Matrix next = step.A() * of_inputs;
    next.middleCols(k * r, r) += step.B();
    of_inputs = next;
    of_x0 = (step.A() * of_x0).eval();
  }
  Matrix Q = Matrix::Zero(S * m, S * m), R = Matrix::Zero(S * r, S * r);
  Vector y = Vector::Zero(S * m), u = Vector::Zero(S * r);
  for (Index k = 0; k < S; ++k) {
    Q.block(k * m, k * m, m, m) = at_step(c.weights.output, k, m);
    if (k == S - 1 && c.weights.terminal.size() > 0) Q.block(k * m, k * m, m, m) += c.weights.terminal;
    R.block(k * r, k * r, r, r) = at_step(c.weights.input, k, r);
    if (c.options.y_reference.size() > 0) y.segment(k * m, m) = c.options.y_reference.row(k);
    if (c.options.u_reference.size() > 0) u.segment(k * r, r) = c.options.u_reference.row(k);
  }
  const Vector free = d.O * x0 - y;
  d.hessian = d.H.transpose() * Q * d.H + R;
  d.gradient = -d.H.transpose() * Q * free + R * u;
  d.constant = free.dot(Q * free) + u.dot(R * u);
  for (Index k = 0; k < S; ++k) {
    const Matrix rate = at_step(c.weights.input_rate, k, r);
    d.hessian.block(k * r, k * r, r, r) += rate;
    if (k == 0) continue;
    d.hessian.block((k - 1) * r, (k - 1) * r, r, r) += rate;
    d.hessian.block(k * r, (k - 1) * r, r, r) -= rate;
    d.hessian.block((k - 1) * r, k * r, r, r) -= rate;
  }
  return d;
}

// The inputs (S·r) of a controller with the true state.
Vector inputs_of(const Model& model, const Controller& controller, Vector x) {
  const Index r = model.inputs;
  Vector u(controller.steps() * r), held = Vector::Zero(r);
  for (Index s = 0; s < controller.steps(); ++s) {
    const Step& step = model.at(controller.begin + s);
    Vector now = -controller.K[size_t(s)] * x;
    if (!controller.L.empty()) now -= controller.L[size_t(s)] * held;
    if (controller.feedforward.size() > 0) now += controller.feedforward.row(s).transpose();
    u.segment(s * r, r) = held = now;
    x = (step.A() * x + step.B() * now).eval();
  }
  return u;
}

const Parts all_parts[] = {{},
                           {.rate = true},
                           {.terminal = true},
                           {.each_step = true},
                           {.reference = true},
                           {.nominal = true},
                           {.rate = true, .terminal = true, .each_step = true, .reference = true, .nominal = true}};

TEST(Lqr, FindsTheInputsOfTheDenseProblem) {
  for (const SystemSize& size : control_sizes)
    for (const Parts& parts : all_parts) {
      const Case c = random_case(size, 12, parts, 1);
      const Lqr found = lqr(c.model, c.weights, c.options);
      Random random(2);
      for (int trial = 0; trial < 3; ++trial) {
        const Vector x0 = random.matrix(size.n, 1);
        const Dense d = dense(c, x0);
        const Vector best = d.best(), u = inputs_of(c.model, found.controller, x0);
        // The Hessian has a condition of at most 1e5 or so.
        EXPECT_LE((u - best).norm(), 1e-9 * (1 + best.norm())) << name(size);
        Vector z = Vector::Zero(size.n + (parts.rate ? size.r : 0));
        z.head(size.n) = x0;
        const CostToGo& cost = found.cost_to_go;
        double least = z.dot(cost.P[0] * z) + cost.c(0);
        if (!cost.p.empty()) least -= 2 * cost.p[0].dot(z);
        EXPECT_NEAR(least, d.cost(best), 1e-9 * (1 + d.constant)) << name(size);
        EXPECT_GE(d.cost(best + 1e-3 * random.matrix(best.size(), 1)), least) << name(size);
      }
    }
}

TEST(Lqr, FollowsVaryingStateDimensions) {
  for (const SystemSize& size : control_sizes)
    for (const bool rate : {false, true}) {
      Case c = random_case(size, 12, {.rate = rate, .reference = true}, 11);
      c.model = growing(c.model);
      const Lqr found = lqr(c.model, c.weights, c.options);
      const Vector best = dense(c, Vector(0)).best();
      EXPECT_LE((inputs_of(c.model, found.controller, Vector(0)) - best).norm(), 1e-9 * (1 + best.norm()))
          << name(size);
    }
}

// The recursion of textbooks, by matrices.
TEST(Lqr, IsTheRiccatiRecursion) {
  for (const SystemSize& size : control_sizes) {
    const Case c = random_case(size, 30, {}, 21);
    const Lqr found = lqr(c.model, c.weights);
    Matrix P = Matrix::Zero(size.n, size.n);
    const Matrix &Q = c.weights.output[0], &R = c.weights.input[0];
    for (Index k = 30; k-- > 0;) {
      const Step& s = c.model.at(k);
      const Matrix weight = R + s.D().transpose() * Q * s.D() + s.B().transpose() * P * s.B();
      const Matrix cross = s.D().transpose() * Q * s.C() + s.B().transpose() * P * s.A();
      const Matrix K = linalg::solve(weight, cross);
      P = (s.C().transpose() * Q * s.C() + s.A().transpose() * P * s.A() - cross.transpose() * K).eval();
      EXPECT_LE((found.controller.K[size_t(k)] - K).norm(), 1e-10 * (1 + K.norm())) << name(size) << " " << k;
      EXPECT_LE((found.cost_to_go.P[size_t(k)] - P).norm(), 1e-10 * P.norm()) << name(size) << " " << k;
    }
    EXPECT_EQ(found.cost_to_go.P[30].norm(), 0);
  }
}

TEST(Lqr, KeepsTheCostSymmetricAndPositiveWhereTheTextbookFormFails) {
  // Nearly free inputs: P falls by many orders of magnitude, and the difference of the textbook is all rounding errors.
  Case c = random_case({6, 2, 1}, 60, {}, 31);
  c.weights.output = {1e12 * Matrix::Identity(2, 2)};
  c.weights.input = {1e-12 * Matrix::Identity(1, 1)};
  const Lqr found = lqr(c.model, c.weights);
  for (const Matrix& P : found.cost_to_go.P) {
    EXPECT_EQ(P, P.transpose());
    // Eigenvalues of a product of a root with itself are wrong by a few rounding errors of the largest.
    EXPECT_GE(linalg::symmetric_eigenvalues(P)(0), -50 * epsilon * P.norm());
  }
  for (const Matrix& K : found.controller.K) EXPECT_TRUE(K.allFinite());
}

TEST(Lqr, GoesBeyondTheEndOfAPeriodicModel) {
  Case c = random_case({3, 2, 1}, 5, {.nominal = true}, 41);
  c.model.period = 5;
  const Lqr found = lqr(c.model, c.weights, {.begin = 2, .end = 23});
  Case whole = c;
  whole.model = from_step(continued(c.model, 23), 2);
  whole.model.period = 0;
  const Lqr exact = lqr(whole.model, whole.weights);
  EXPECT_EQ(found.controller.begin, 2);
  EXPECT_EQ(found.controller.end(), 23);
  EXPECT_EQ(found.controller.u_nominal, exact.controller.u_nominal);
  EXPECT_EQ(found.controller.y_nominal.row(20), c.model.y_nominal.row(22 % 5));
  for (size_t s = 0; s < 21; ++s) EXPECT_EQ(found.controller.K[s], exact.controller.K[s]);
}

TEST(Lqr, RefusesWhatDoesNotFit) {
  Case c = random_case({3, 2, 1}, 5, {}, 51);
  const auto refusal = [&](const CostWeights& weights, const ControlOptions& options = {}) {
    return message([&] { lqr(c.model, weights, options); });
  };
  const Matrix one = Matrix::Identity(1, 1), two = Matrix::Identity(2, 2);
  EXPECT_EQ(refusal({.output = {two}}), "input: no weight on inputs found, a positive definite one needed");
  EXPECT_EQ(refusal({.output = {one}, .input = {one}}), "output: 1 x 1 found, 2 x 2 needed");
  EXPECT_EQ(refusal({.output = {two, two}, .input = {one}}),
            "output: 2 matrices found, one needed, or one for each of 5 steps");
  EXPECT_EQ(refusal({.output = {-two}, .input = {one}}),
            "output: a matrix that is no weight found; a symmetric matrix without negative eigenvalues needed");
  EXPECT_EQ(refusal({.output = {two}, .input = {0 * one}}),
            "input: the sum of all weights on inputs is singular at step 0; a positive definite sum needed");
  EXPECT_EQ(refusal({.output = {two}, .input = {one}, .terminal = one}), "terminal: 1 x 1 found, 2 x 2 needed");
  EXPECT_EQ(refusal({.output = {two}, .input = {one}}, {.end = 6}),
            "steps: 0 to 5 found, steps within 0 to 4 needed, which the model has");
  EXPECT_EQ(refusal({.output = {two}, .input = {one}}, {.y_reference = Matrix::Zero(4, 2)}),
            "y_reference: 4 x 2 found, 5 steps x 2 channels needed");
  c.model.step.clear();
  EXPECT_EQ(refusal({.output = {two}, .input = {one}}), "model: no step found, at least one needed");
}

// A model with noise, its Kalman filter as observer, and initial states of either kind.
Model noisy_model(const Case& c, bool innovations, InitialState initial, std::uint64_t seed) {
  Random random(seed);
  Model model = c.model;
  for (Step& step : model.step) {
    step.set_Q(0.1 * random_weight(random, step.next_states(), step.next_states() + 1));
    step.set_R(0.2 * random_weight(random, model.outputs, model.outputs + 1));
  }
  model.initial_state = initial;
  if (initial == InitialState::unknown) {
    model.x0_mean = random.matrix(model.n(0), 1);
    model.x0_cov = random_weight(random, model.n(0), model.n(0));
  }
  model = kalman_observer(model);
  if (innovations)
    for (Step& step : model.step) step.forget_noise();
  return model;
}

// The formula of textbooks: what the noise costs the controller with the true state, and what the error of the observer
// costs in addition.
TEST(ExpectedCost, IsPredictedIfTheModelHasNoise) {
  Model model = random_system({3, 2, 2}, 6, 1.0, 4);
  const Controller controller =
      lqr(model, {.output = {Matrix::Identity(2, 2)}, .input = {Matrix::Identity(2, 2)}}).controller;
  EXPECT_FALSE(predicted_cost(controller, model).has_value());
  for (Step& step : model.step) {
    step.G().setConstant(0.1);
    step.set_innovation_cov(Matrix::Identity(2, 2));
  }
  const std::optional<ExpectedCost> predicted = predicted_cost(controller, model);
  ASSERT_TRUE(predicted.has_value());
  EXPECT_EQ(predicted->total(), expected_cost(controller, model, model).total());
  EXPECT_GT(predicted->total(), 0.0);
  EXPECT_THROW(predicted_cost(controller, random_system({3, 2, 2}, 6, 1.0, 5)), std::invalid_argument);
  Controller few = controller;  // neither one weight nor one for each step
  few.weights.input.assign(2, few.weights.input.front());
  EXPECT_THROW(expected_cost(few, model, model), std::invalid_argument);
  EXPECT_THROW(simulate_control(few, model, model), std::invalid_argument);
}

TEST(ExpectedCost, IsTheFormulaOfTextbooks) {
  for (const SystemSize& size : control_sizes)
    for (const InitialState initial : {InitialState::zero, InitialState::unknown})
      for (const bool rate : {false, true}) {
        const Case c = random_case(size, 25, {.rate = rate, .terminal = true, .nominal = true}, 61);
        const Model model = noisy_model(c, false, initial, 62);
        const Lqr found = lqr(model, c.weights);
        const KalmanFilter filter = kalman_filter(model);
        const CostToGo& go = found.cost_to_go;
        const Index n = size.n;
        double exact = 0.0, measured = 0.0;
        if (initial == InitialState::unknown) {
          const Matrix P0 = go.P[0].topLeftCorner(n, n);
          exact = model.x0_mean.dot(P0 * model.x0_mean) + (P0 * model.x0_cov).trace();
        }
        for (Index k = 0; k < 25; ++k) {
          const Step& step = model.at(k);
          const Matrix& K = found.controller.K[size_t(k)];
          Matrix Q = c.weights.output[0], B = Matrix::Zero(go.P[0].rows(), size.r);
          if (k == 24) Q += c.weights.terminal;
          B.topRows(n) = step.B();
          if (rate) B.bottomRows(size.r).setIdentity();
          Matrix weight =
              c.weights.input[0] + step.D().transpose() * Q * step.D() + B.transpose() * go.P[size_t(k) + 1] * B;
          if (rate) weight += c.weights.input_rate[0];
          exact += (go.P[size_t(k) + 1].topLeftCorner(n, n) * step.Q()).trace();
          exact += (K.transpose() * weight * K * filter.P[size_t(k)]).trace();
          measured += (Q * step.R()).trace();
        }
        const ExpectedCost cost = expected_cost(found.controller, model, model);
        // Some hundred products of numbers of this size.
        EXPECT_NEAR(cost.total(), exact, 1e-10 * exact) << name(size);
        EXPECT_NEAR(cost.measurement_noise, measured, 1e-12 * measured) << name(size);
        EXPECT_EQ(cost.input_rates > 0, rate);
      }
}

// Innovations form: the same outputs, so the same cost of measured outputs.
TEST(ExpectedCost, IsThatOfTheInnovationsForm) {
  for (const SystemSize& size : control_sizes) {
    const Case c = random_case(size, 25, {.rate = true}, 71);
    const Model model = noisy_model(c, false, InitialState::zero, 72);
    const Model form = noisy_model(c, true, InitialState::zero, 72);
    const Lqr found = lqr(model, c.weights);
    const ExpectedCost a = expected_cost(found.controller, model, model);
    const ExpectedCost b = expected_cost(found.controller, model, form);
    EXPECT_NEAR(a.total() + a.measurement_noise, b.total() + b.measurement_noise, 1e-10 * a.total()) << name(size);
    EXPECT_NEAR(a.inputs, b.inputs, 1e-10 * a.total()) << name(size);
  }
}

TEST(ExpectedCost, IsTheMeanOfSimulations) {
  for (const bool innovations : {false, true})
    for (const Index begin : {0, 4}) {
      const SystemSize size{3, 2, 2};
      const Case c = random_case(size, 20, {.rate = true, .nominal = true}, 81);
      Model truth = noisy_model(c, innovations, InitialState::unknown, 82);
      // The model is wrong in all its parts, and begins later than the truth.
      Random random(83);
      Model model = truth;
      for (Step& step : model.step) {
        step.A() += 0.05 * random.matrix(3, 3);
        step.B() += 0.1 * random.matrix(3, 2);
      }
      model.u_nominal += 0.1 * random.matrix(20, 2);
      model.y_nominal += 0.1 * random.matrix(20, 2);
      Case wrong{from_step(model, begin / 2), c.weights, {.begin = begin}};
      wrong.options.y_reference = random.matrix(20 - begin, 2);
      wrong.options.u_reference = random.matrix(20 - begin, 2);
      if (begin > 0) {  // a known first state, so that simulation and expectation start alike
        wrong.model.x0_mean = Vector::Ones(3);
        wrong.model.x0_cov = Matrix::Identity(3, 3);
      }
      const Lqr found = lqr(wrong.model, wrong.weights, wrong.options);
      const double expected = expected_cost(found.controller, wrong.model, truth).total();
      const ClosedLoopSimulation runs =
          simulate_control(found.controller, wrong.model, truth, {.experiments = 4000, .seed = 84});
      const double mean = runs.cost.mean();
      const double deviation = std::sqrt((runs.cost.array() - mean).square().mean() / 4000);
      EXPECT_NEAR(mean, expected, 4 * deviation) << innovations << begin;
      EXPECT_LT(deviation, 0.05 * expected);
    }
}

TEST(ExpectedCost, SaysWhatItPresumesOfTheInitialState) {
  Model model = oscillator(12);
  for (Step& step : model.step) step.set_innovation_cov(Matrix::Identity(2, 2));
  const Controller controller =
      lqr(model, {.output = {Matrix::Identity(2, 2)}, .input = {Matrix::Identity(2, 2)}}).controller;
  EXPECT_FALSE(expected_cost(controller, model, model).presumes_zero_state);
  model.initial_state = InitialState::unknown;
  EXPECT_TRUE(expected_cost(controller, model, model).presumes_zero_state);
  model.x0_mean = Vector::Zero(4);
  model.x0_cov = Matrix::Identity(4, 4);
  EXPECT_FALSE(expected_cost(controller, model, model).presumes_zero_state);
}

// Without noise and feedback, and with a reference that is the motion from the known first state, the exact cost is
// zero. Rounding gave about half of these costs a negative sign.
TEST(ExpectedCost, IsNotNegative) {
  double largest = 0.0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    Case c = random_case({3, 2, 2}, 8, {}, seed);
    Random random(seed);
    c.model.initial_state = InitialState::unknown;
    c.model.x0_mean = random.matrix(3, 1);
    c.model.x0_cov = Matrix::Zero(3, 3);
    Controller idle = lqr(c.model, c.weights).controller;
    for (Matrix& gain : idle.K) gain.setZero();
    idle.y_reference.resize(8, 2);
    Vector x = c.model.x0_mean;
    for (Index k = 0; k < 8; ++k) {
      idle.y_reference.row(k) = (c.model.at(k).C() * x).transpose();
      x = c.model.at(k).A() * x;
    }
    const ExpectedCost cost = expected_cost(idle, c.model, c.model);
    EXPECT_GE(cost.outputs, 0.0) << seed;
    EXPECT_EQ(cost.inputs, 0.0) << seed;
    largest = std::max(largest, cost.outputs);
  }
  EXPECT_GT(largest, 0.0);    // rounding has both signs
  EXPECT_LT(largest, 1e-10);  // some hundred products of numbers of the size 1 to 100
}

TEST(ExpectedCost, HasItsMinimumAtTheGainsOfLqg) {
  const Case c = random_case({4, 2, 2}, 15, {.rate = true}, 91);
  const Model model = noisy_model(c, false, InitialState::unknown, 92);
  const Lqr found = lqr(model, c.weights);
  const double least = expected_cost(found.controller, model, model).total();
  Random random(93);
  for (int trial = 0; trial < 30; ++trial) {
    Controller other = found.controller;
    Model observer = model;
    if (trial % 2 == 0)  // the last gain of the observer has no effect
      other.K[size_t(trial % 15)] += 0.1 * random.matrix(2, 4);
    else
      observer.at(trial % 14).G() += 0.1 * random.matrix(4, 2);
    EXPECT_GT(expected_cost(other, observer, model).total(), least) << trial;
  }
}

TEST(ExpectedCost, DoesNotDependOnTheStateCoordinates) {
  const Case c = random_case({4, 2, 2}, 15, {.rate = true, .reference = true}, 101);
  const Model model = noisy_model(c, false, InitialState::unknown, 102);
  Random random(103);
  std::vector<Matrix> S;
  for (int k = 0; k <= 15; ++k) S.push_back(random.orthogonal(4) * 2.0);
  const Model other = transform(model, S);
  const double a = expected_cost(lqr(model, c.weights, c.options).controller, model, model).total();
  const double b = expected_cost(lqr(other, c.weights, c.options).controller, other, model).total();
  EXPECT_NEAR(a, b, 1e-10 * a);
}

TEST(SimulateControl, RunsTheObserverThatRunsOnline) {
  for (const InitialState initial : {InitialState::zero, InitialState::unknown})
    for (const bool estimate : {false, true}) {
      const Case c = random_case({4, 2, 2}, 30, {.rate = true, .reference = true, .nominal = true}, 111);
      Model truth = noisy_model(c, false, initial, 112), model = truth;
      if (!estimate) model.x0_mean.resize(0), model.x0_cov.resize(0, 0);
      const Lqr found = lqr(model, c.weights, c.options);
      const Controller& controller = found.controller;
      const ClosedLoopSimulation runs = simulate_control(controller, model, truth, {.experiments = 3, .seed = 113});
      OnlineObserver observer(model);
      for (Index n = 0; n < 3; ++n) {
        observer.reset();
        Vector last = Vector::Constant(2, nan);  // does not matter at the first step
        for (Index k = 0; k < 30; ++k) {
          const Vector u = observer.knows_state() ? controller.input(k, observer.state(), last)
                                                  : Vector(controller.u_nominal.row(k).transpose());
          // Both compute the same sums of a few products, in another order.
          EXPECT_LE((runs.data.input(k).row(n).transpose() - u).norm(), 1e-12 * (1 + u.norm())) << n << " " << k;
          last = runs.data.input(k).row(n).transpose();
          observer.step(runs.data.input(k).row(n).transpose(), runs.data.output(k).row(n).transpose());
        }
        EXPECT_TRUE(observer.knows_state());
      }
    }
}

TEST(SimulateControl, RepeatsItselfAndKeepsLimits) {
  const Case c = random_case({3, 2, 1}, 20, {.nominal = true}, 121);
  const Model model = noisy_model(c, false, InitialState::unknown, 122);
  const Controller controller = lqr(model, c.weights).controller;
  const auto run = [&](const SimulateControlOptions& options) {
    return simulate_control(controller, model, model, options);
  };
  const ClosedLoopSimulation a = run({.experiments = 4, .seed = 5}), b = run({.experiments = 4, .seed = 5});
  EXPECT_EQ(a.data.samples(), b.data.samples());
  EXPECT_EQ(a.cost, b.cost);
  EXPECT_NE(a.data.samples(), run({.experiments = 4, .seed = 6}).data.samples());
  // Without noise the states follow the nominal trajectory or their mean.
  const ClosedLoopSimulation quiet =
      run({.experiments = 2, .noise = false, .x0 = Matrix(model.x0_mean.replicate(1, 2))});
  EXPECT_EQ(quiet.cost(0), quiet.cost(1));
  EXPECT_NEAR(quiet.cost(0), model.x0_mean.dot(lqr(model, c.weights).cost_to_go.P[0] * model.x0_mean),
              1e-10 * quiet.cost(0));
  const Vector low = Vector::Constant(1, -0.1), high = Vector::Constant(1, 0.2);
  const ClosedLoopSimulation limited = run({.experiments = 4, .u_min = low, .u_max = high});
  double least = 1.0, most = -1.0;
  for (Index k = 0; k < 20; ++k) {
    least = std::min(least, limited.data.input(k).minCoeff());
    most = std::max(most, limited.data.input(k).maxCoeff());
  }
  EXPECT_EQ(least, -0.1);
  EXPECT_EQ(most, 0.2);
}

// The loop begins with the truth. The model may begin with it or later, but not before it.
TEST(SimulateControl, TruthDoesNotBeginAfterTheModel) {
  const Model system = random_system({3, 2, 1}, 12, 1.0, 135);
  const CostWeights weights{.output = {Matrix::Identity(2, 2)}, .input = {Matrix::Identity(1, 1)}};
  for (const Index of_model : {0, 2, 4})
    for (const Index of_truth : {0, 2, 4}) {
      const Model model = from_step(system, of_model), truth = from_step(system, of_truth);
      const Controller controller = lqr(model, weights, {.begin = 4}).controller;
      const std::string found = message([&] { simulate_control(controller, model, truth); });
      EXPECT_EQ(found, message([&] { expected_cost(controller, model, truth); }));
      EXPECT_EQ(found, of_truth <= of_model
                           ? "no exception"
                           : "truth: first step " + std::to_string(of_truth) + " found, " + std::to_string(of_model) +
                                 " or earlier needed, the first of the model");
    }
}

TEST(Lqr, LawRefusesWhatDoesNotFit) {
  const Case c = random_case({3, 2, 2}, 8, {.rate = true}, 136);
  const Controller controller = lqr(c.model, c.weights, {.begin = 2}).controller;
  const Vector x = Vector::Ones(3), u = Vector::Ones(2);
  EXPECT_EQ(message([&] { controller.input(1, x, u); }), "k: 1 found, steps 2 to 7 needed");
  EXPECT_EQ(message([&] { controller.input(2, u, u); }),
            "x, u_last: 2 and 2 numbers found, 3 states and 2 inputs needed");
  EXPECT_EQ(message([&] { controller.input(3, x, x); }),
            "x, u_last: 3 and 3 numbers found, 3 states and 2 inputs needed");
  Controller bad = controller;
  bad.feedforward = Matrix::Zero(2, 2);
  EXPECT_EQ(message([&] { expected_cost(bad, c.model, c.model); }),
            "controller: parts of different sizes found, those that lqr() gives needed");
  bad = controller;
  bad.K[1] = Matrix::Zero(2, 2);
  EXPECT_EQ(message([&] { expected_cost(bad, c.model, c.model); }),
            "controller: a gain of 2 x 2 found at step 3, 2 x 3 of the model needed");
  bad = controller;
  bad.L[2](0, 1) = nan;
  EXPECT_EQ(message([&] { simulate_control(bad, c.model, c.model); }),
            "controller: a gain that is not finite found at step 4");
}

// Weights are in units of their own.
TEST(Lqr, WeightsOfVeryDifferentUnits) {
  const Case c = random_case({3, 2, 2}, 8, {}, 137);
  const Matrix input = Vector{{1e-10, 1e6}}.asDiagonal();
  const auto refusal = [&](const CostWeights& weights) { return message([&] { lqr(c.model, weights); }); };
  EXPECT_EQ(refusal({.output = c.weights.output, .input = {input}}), "no exception");
  EXPECT_NE(refusal({.output = c.weights.output, .input = {Matrix::Ones(2, 2)}}), "no exception");
  EXPECT_EQ(refusal({.output = {Matrix::Identity(2, 2)}, .input = {input}, .terminal = -0.5 * Matrix::Identity(2, 2)}),
            "terminal: a matrix that is no weight found; a symmetric matrix without negative eigenvalues needed");
}

TEST(SimulateControl, RefusesWhatDoesNotFit) {
  const Case c = random_case({3, 2, 1}, 8, {}, 131), other = random_case({4, 2, 1}, 8, {}, 132);
  const Controller controller = lqr(c.model, c.weights).controller;
  const auto refusal = [&](const Model& model, const Model& truth, const SimulateControlOptions& options = {}) {
    return message([&] { simulate_control(controller, model, truth, options); });
  };
  const char* const another =
      "model: other matrices or coordinates found, those of the model needed from which the controller was designed";
  EXPECT_EQ(refusal(other.model, c.model), another);
  Random random(133);
  std::vector<Matrix> coordinates(9, Matrix::Identity(3, 3) + 0.1 * random.matrix(3, 3));
  EXPECT_EQ(refusal(transform(c.model, coordinates), c.model), another);
  EXPECT_EQ(message([&] { expected_cost(controller, transform(c.model, coordinates), c.model); }), another);
  Model filter = noisy_model(c, false, InitialState::zero, 134);  // other gains and noise, the same system
  EXPECT_EQ(refusal(filter, c.model), "no exception");
  EXPECT_EQ(refusal(c.model, random_case({3, 2, 2}, 8, {}, 1).model),
            "truth: 2 inputs and 2 outputs found, 1 and 2 of the controller needed");
  EXPECT_EQ(refusal(c.model, from_step(c.model, 1)), "truth: steps 1 to 7 found, 0 to 7 of the controller needed");
  EXPECT_EQ(refusal(c.model, c.model, {.experiments = 0}), "experiments: 0 found, at least 1 needed");
  EXPECT_EQ(refusal(c.model, c.model, {.u_min = Vector::Zero(2)}),
            "u_min: 2 numbers found, one for each of 1 inputs needed");
  EXPECT_EQ(refusal(c.model, c.model, {.u_max = Vector::Constant(1, nan)}), "u_max: NaN found, numbers needed");
  EXPECT_EQ(refusal(c.model, c.model, {.u_min = Vector::Ones(1), .u_max = -Vector::Ones(1)}),
            "u_min: a limit above u_max found, limits up to u_max needed");
  EXPECT_EQ(refusal(c.model, c.model, {.x0 = Matrix::Zero(2, 1)}), "x0: 2 x 1 found, 3 states x 1 experiments needed");
  EXPECT_EQ(refusal(c.model, c.model, {.x0 = Matrix::Constant(3, 1, nan)}),
            "x0: a value that is not finite found, finite ones needed");
  EXPECT_EQ(refusal(c.model, other.model), "no exception");  // the truth may have other states
}

}  // namespace
}  // namespace tokid::testing
