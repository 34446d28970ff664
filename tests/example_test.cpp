// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/example.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>

#include "testing.hpp"
#include "tokid/observer.hpp"

namespace tokid::testing {
namespace {

TEST(Example, OscillatorIsThePapersSystem) {
  const Model model = oscillator(40);
  model.check();
  EXPECT_EQ(model.dt, 0.05);
  // exp(A_c dt) by its Taylor series, at k = 35.
  const double t = 35 * 0.05;
  Matrix ac = Matrix::Zero(4, 4);
  ac(0, 2) = ac(1, 3) = 1;
  ac(2, 0) = -(4 + 3 * std::sin(10 * t));
  ac(3, 1) = -(7 + 3 * std::cos(10 * t));
  ac(2, 1) = ac(3, 0) = 1;
  Matrix sum = Matrix::Identity(4, 4), term = sum;
  for (int i = 1; i < 20; ++i) sum += term = term * ac * 0.05 / i;
  EXPECT_LE((model.step[35].A() - sum).norm(), 100 * epsilon);
  for (const double norm : deadbeat_products(model, 2)) EXPECT_LE(norm, 1e-11);  // (82), (83)
}

TEST(Example, RotatingTubeIsStableAtSomeTimesAndNotAtOthers) {
  const Model model = rotating_tube(100);
  model.check();
  int unstable = 0;
  for (Index k = 0; k < 100; ++k)
    unstable += linalg::eigenvalues(model.step[size_t(k)].A()).cwiseAbs().maxCoeff() > 1 + 1e-9;
  EXPECT_GT(unstable, 10);
  EXPECT_LT(unstable, 90);
}

TEST(Example, ExperimentsAreReproducibleAndShareTheirInputs) {
  const Model system = oscillator(12);
  const Ensemble a = experiments(system, {.experiments = 5, .seed = 3});
  EXPECT_EQ(a.samples(), experiments(system, {.experiments = 5, .seed = 3}).samples());
  EXPECT_NE(a.samples(), experiments(system, {.experiments = 5, .seed = 4}).samples());
  // More experiments, noise and free responses change no input of the first ones.
  const Ensemble b = experiments(
      system, {.experiments = 7, .seed = 3, .process_noise = 0.1, .measurement_noise = 0.2, .free_responses = 4});
  for (Index k = 0; k < 12; ++k) EXPECT_EQ(b.input(k).topRows(5), a.input(k));
  EXPECT_EQ(b.free.experiments, 4);
  EXPECT_EQ(b.free.steps, 12);
  // Zero initial states: the first output is D u.
  EXPECT_LE((a.output(0) - 0.1 * a.input(0)).norm(), 10 * epsilon);
  const Ensemble c = experiments(system, {.experiments = 5, .seed = 3, .initial_state = InitialState::unknown});
  EXPECT_GT((c.output(0) - 0.1 * c.input(0)).norm(), 0.1);
  EXPECT_EQ(c.initial_state, InitialState::unknown);
}

TEST(Example, GivenInputsReplaceTheRandomOnesAlone) {
  const Model system = oscillator(12);
  const ExperimentOptions options{.experiments = 5, .seed = 3, .process_noise = 0.1, .measurement_noise = 0.2};
  const Ensemble drawn = experiments(system, options);
  EXPECT_EQ(experiments(system, drawn, options).samples(), drawn.samples());

  Ensemble zero = drawn;
  for (Index k = 0; k < 12; ++k) zero.input(k).setZero();
  const Ensemble answer = experiments(system, zero, {.seed = 3});
  for (Index k = 0; k < 12; ++k) EXPECT_TRUE(answer.output(k).isZero(0));
  EXPECT_THROW(experiments(oscillator(11), drawn), std::invalid_argument);
  EXPECT_THROW(experiments(rotating_tube(12), drawn), std::invalid_argument);
}

// The generator's first numbers are the same on every machine: Boost fixes the algorithm.
TEST(Example, GeneratorIsPinned) {
  const Ensemble e = experiments(oscillator(1), {.experiments = 1, .seed = 1});
  EXPECT_EQ(e.u(0, 0, 0), -0.73778894722705568);
}

TEST(Example, RefusesNonsense) {
  EXPECT_THROW(oscillator(0), std::invalid_argument);
  EXPECT_THROW(oscillator(5, 0.0), std::invalid_argument);
  EXPECT_THROW(experiments(oscillator(5), {.experiments = 0}), std::invalid_argument);
  EXPECT_THROW(experiments(oscillator(5), {.measurement_noise = -1}), std::invalid_argument);
}

TEST(Example, NoiseReplacesNoiseThatWasThere) {
  const Model once = with_noise(oscillator(10), {.process_noise = 0.1, .measurement_noise = 0.2});
  const Model again = with_noise(once, {.process_noise = 0.3, .measurement_noise = 0.4});
  ASSERT_EQ(again.steps(), 10);
  EXPECT_DOUBLE_EQ(again.at(3).Q()(0, 0), 0.09);
  EXPECT_DOUBLE_EQ(again.at(3).R()(1, 1), 0.16);
  EXPECT_THROW(with_noise(oscillator(10), {.process_noise = -1}), std::invalid_argument);
  EXPECT_THROW(expected_moments(Model{}), std::invalid_argument);
  EXPECT_THROW(expected_moments(from_step(once, 2)), std::invalid_argument);
}

}  // namespace
}  // namespace tokid::testing
