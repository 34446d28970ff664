// Weights of the outputs: in choices, and for the states that are kept.
// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <array>

#include "choose/held_out_error.hpp"
#include "data/output_weights.hpp"
#include "testing.hpp"
#include "tokid/identify.hpp"
#include "tokid/lag_orders.hpp"
#include "tokid/smooth_arx.hpp"
#include "tokid/update.hpp"

namespace tokid::testing {
namespace {

// Two systems with the same inputs. Each output sees one of them.
Model side_by_side(const Model& first, const Model& second) {
  Model both = first;
  both.outputs = first.outputs + second.outputs;
  for (size_t k = 0; k < both.step.size(); ++k) {
    const Step &a = first.step[k], &b = second.step[k];
    const auto blocks = [](const Matrix& x, const Matrix& y) {
      Matrix all = Matrix::Zero(x.rows() + y.rows(), x.cols() + y.cols());
      all.topLeftCorner(x.rows(), x.cols()) = x;
      all.bottomRightCorner(y.rows(), y.cols()) = y;
      return all;
    };
    Step& step = both.step[k] =
        Step(a.states() + b.states(), a.next_states() + b.next_states(), first.inputs, both.outputs);
    step.A() = blocks(a.A(), b.A());
    step.B() = linalg::stacked(a.B(), b.B());
    step.C() = blocks(a.C(), b.C());
    step.D() = linalg::stacked(a.D(), b.D());
  }
  return both;
}

Model two_systems(Index steps, std::uint64_t seed, bool constant) {
  const SystemSize size{2, 1, 2};
  const auto make = [&](std::uint64_t own) {
    Model one = constant ? constant_system(size, steps, 0.9, own) : random_system(size, steps, 0.9, own);
    for (Step& step : one.step) step.D().setZero();  // all that an output shows is its states
    return one;
  };
  return side_by_side(make(seed), make(seed + 100));
}

// RMS simulation error over RMS of each output.
Vector simulation_errors(const Model& model, const Ensemble& data) {
  const Matrix zero = Matrix::Zero(data.steps(), data.outputs());
  return 1 - fit(data, simulate_data(model, data, InitialState::zero), zero).fit.array() / 100;
}

// Of n = 2 states for two systems with two states each, a model keeps those of the output with the large weight.
void expect_dynamics_of_the_weighted_output(const Ensemble& data, const Ensemble& fresh, IdentifyOptions options,
                                            double good) {
  options.states = 2;
  options.initial_state = InitialState::zero;
  options.nominal = NominalChoice::none;
  const Vector alike = simulation_errors(identify(data, options).model, fresh);
  for (const Index heavy : {0, 1}) {
    options.output_weights = {1, 1};
    options.output_weights[size_t(heavy)] = 1e4;
    const Identification found = identify(data, options);
    EXPECT_EQ(found.model.states(), 2);
    const Vector errors = simulation_errors(found.model, fresh);
    EXPECT_LE(errors(heavy), good);
    EXPECT_GE(errors(1 - heavy), 2 * good);
    EXPECT_EQ(identify_options(found.model.provenance).output_weights, options.output_weights);
  }
  EXPECT_GE(alike.maxCoeff(), 2 * good);
}

TEST(OutputWeights, TveraKeepsTheDynamicsOfTheWeightedOutput) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
    const Model system = two_systems(24, seed, false);
    const Ensemble data = random_experiments(system, 30, seed), fresh = random_experiments(system, 20, seed + 50);
    expect_dynamics_of_the_weighted_output(data, fresh, {.method = Method::tvera}, 0.05);
  }
}

TEST(OutputWeights, SubspaceKeepsTheDynamicsOfTheWeightedOutput) {
  for (const std::uint64_t seed : {1, 2, 3, 4, 5}) {
    const Model system = two_systems(40, seed, true);
    const Ensemble data = with_noise(random_experiments(system, 40, seed), 0.1, seed + 1000),
                   fresh = random_experiments(system, 20, seed + 50);
    expect_dynamics_of_the_weighted_output(data, fresh, {.lags = 8, .smoothing = 1.0, .refine = false}, 0.1);
  }
}

TEST(OutputWeights, PooledStepsKeepTheDynamicsOfTheWeightedOutput) {
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Model system = two_systems(200, seed, true);
    const Ensemble data = with_noise(random_experiments(system, 8, seed), 0.1, seed + 1000),
                   fresh = random_experiments(system, 20, seed + 50);
    for (const std::optional<Weighting> weighting : {std::optional<Weighting>(), std::optional(Weighting::projection)})
      expect_dynamics_of_the_weighted_output(data, fresh,
                                             {.lags = 4, .period = 1, .weighting = weighting, .refine = false}, 0.05);
  }
}

// The factors that an update state has lead to the same states.
TEST(OutputWeights, UpdatesKeepThem) {
  const Model system = two_systems(40, 1, true);
  const Ensemble data = with_noise(random_experiments(system, 40, 1), 0.1, 1000),
                 fresh = random_experiments(system, 20, 51);
  const IdentifyOptions options{.states = 2,
                                .weighting = Weighting::many_steps,
                                .output_weights = {1, 1e4},
                                .refine = false,
                                .initial_state = InitialState::zero,
                                .nominal = NominalChoice::none};
  const Identification found = identify(data, options);
  const Vector errors = simulation_errors(identify(update_state(data, found, options)).model, fresh);
  EXPECT_LE((errors - simulation_errors(found.model, fresh)).norm(), 1e-9);
  EXPECT_LE(errors(1), 0.05);
}

void expect_equal_models(const Ensemble& data, IdentifyOptions options, const std::vector<double>& weights,
                         const std::vector<double>& others) {
  options.output_weights = weights;
  const Identification one = identify(data, options);
  options.output_weights = others;
  const Identification other = identify(data, options);
  EXPECT_EQ(one.plan.lags, other.plan.lags);
  EXPECT_EQ(one.order_scores.errors, other.order_scores.errors);
  ASSERT_EQ(state_dims(one.model), state_dims(other.model));
  constexpr std::array<Step::View (Step::*)() const, 5> parts{&Step::A, &Step::B, &Step::C, &Step::D, &Step::G};
  for (const auto part : parts) EXPECT_EQ(all(one.model, part), all(other.model, part));
}

TEST(OutputWeights, OnlyTheirRatiosMatter) {
  const Model system = two_systems(24, 7, true);
  const Ensemble exact = random_experiments(system, 30, 7), noisy = with_noise(exact, 0.1, 1000);
  const std::vector<IdentifyOptions> ways{
      {.states = 2, .method = Method::tvera}, {.method = Method::tvera}, {.refine = false}};
  for (const Ensemble* data : {&exact, &noisy})
    for (const IdentifyOptions& options : ways) {
      expect_equal_models(*data, options, {}, {0.3, 0.3});
      expect_equal_models(*data, options, {1, 7}, {10, 70});
      expect_equal_models(*data, options, {0, 1}, {0, 1e-300});
    }
  expect_equal_models(noisy, {.states = 2, .smoothing = 1.0, .refine = true}, {1, 7}, {10, 70});  // also with EM
}

// Without noise, the rank decides. All states are kept, whatever the weights are.
TEST(OutputWeights, ExactDataKeepAllStates) {
  const Model system = two_systems(24, 3, false);
  const Ensemble data = random_experiments(system, 30, 3), fresh = random_experiments(system, 20, 53);
  for (const Method method : {Method::tvera, Method::subspace}) {
    const Identification found = identify(data, {.method = method, .output_weights = {0, 1}});
    EXPECT_EQ(found.model.states(), 4);
    EXPECT_LE(simulation_errors(found.model, fresh).maxCoeff(), 1e-8);
  }
}

Vector two(double first, double second) { return Eigen::Vector2d(first, second); }

// The weighted mean of the logarithms, of which each alone has the weight 1 of one output.
TEST(OutputWeights, WeightErrorsOfChoices) {
  const Ensemble data = with_noise(random_experiments(two_systems(24, 5, true), 30, 5), 0.2, 1000);
  const auto expect_mean = [](auto&& error) {
    const double both = error(Vector()), first = error(two(1, 0)), second = error(two(0, 1));
    EXPECT_NE(first, second);
    EXPECT_NEAR(both, (first + second) / 2, 1e-12);
    EXPECT_NEAR(error(two(3, 1)), (3 * first + second) / 4, 1e-12);
    EXPECT_NEAR(error(two(0.25, 1)), (first + 4 * second) / 5, 1e-12);
  };
  expect_mean([&](const Vector& w) {
    return std::log(choose_smoothing(data, {.lags = {2}, .smoothing = 1.0, .output_weights = w}).error);
  });
  expect_mean([&](const Vector& w) { return lag_order_errors(data, {.p_max = 2, .output_weights = w}).mean(1); });
  const Model model = identify(data, {.states = 2, .lags = 2, .refine = false, .nominal = NominalChoice::none}).model;
  const Ahead ahead{0, {1, 5}};
  const Squares squares = squares_of(predicted_by(model, data, InitialState::zero, ahead), data, ahead);
  expect_mean([&](const Vector& w) { return held_out_error(squares, weights_of(w, 2)).value; });
}

TEST(OutputWeights, AnotherNumberIsRefused) {
  const Ensemble data = with_noise(random_experiments(two_systems(24, 5, true), 30, 5), 0.2, 1000);
  const std::string words = "output_weights: 3 found, 2 needed, one for each output";
  EXPECT_EQ(message([&] { choose_smoothing(data, {.lags = {2}, .output_weights = Vector::Ones(3)}); }), words);
  EXPECT_EQ(message([&] { lag_order_errors(data, {.output_weights = Vector::Ones(3)}); }), words);
  EXPECT_EQ(message([&] { identify(data, {.output_weights = {1, 2, 3}}); }), words);
}

}  // namespace
}  // namespace tokid::testing
