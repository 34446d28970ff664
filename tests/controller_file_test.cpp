// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/controller_file.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <limits>

#include "testing.hpp"

namespace tokid::testing {
namespace {

namespace fs = std::filesystem;

constexpr double infinite = std::numeric_limits<double>::infinity();

class ControllerFile : public ::testing::TestWithParam<const char*> {
 protected:
  void SetUp() override { fs::create_directories(folder_); }
  void TearDown() override { fs::remove_all(folder_); }
  fs::path file(const char* extension = nullptr) const {
    return folder_ / fmt::format("controller{}", extension ? extension : GetParam());
  }

 private:
  fs::path folder_ = fs::temp_directory_path() / fmt::format("tokid-controller-{}", getpid());
};

// Of a model whose first steps have fewer states, with all optional parts or without them.
Controller controller_of(Index steps, bool full) {
  Model model = random_system({3, 2, 2}, steps, 1.0, 1);
  if (steps > 1) {
    const Step first = model.step[0];
    model.step[0] = Step(first.A().leftCols(1), first.B(), first.C().leftCols(1), first.D(), first.G());
  }
  model.dt = 0.25;
  Random random(2);
  const Matrix one = Matrix::Identity(2, 2);
  CostWeights weights{.output = {2 * one}, .input = {one}};
  ControlOptions options;
  if (full) {
    model.names = {{"force", "torque"}, {"x", "angle"}, {"N", "N m"}, {"m", "rad"}};
    model.u_nominal = random.matrix(steps, 2);
    model.y_nominal = random.matrix(steps, 2);
    weights.output.assign(size_t(steps), 3 * one);
    weights.input_rate = {0.5 * one};
    weights.terminal = 4 * one;
    options.y_reference = random.matrix(steps, 2);
    options.u_reference = random.matrix(steps, 2);
  }
  Controller controller = lqr(model, weights, options).controller;
  if (full) {
    controller.model_name = "model.npz";
    controller.predicted = {1.5, 0.25, 0.0, 3.0, true};
  }
  return controller;
}

void expect_equal(const Controller& a, const Controller& b) {
  EXPECT_EQ(a.begin, b.begin);
  EXPECT_EQ(a.outputs, b.outputs);
  EXPECT_EQ(a.dt, b.dt);
  EXPECT_EQ(a.system, b.system);
  EXPECT_EQ(a.names.input_names, b.names.input_names);
  EXPECT_EQ(a.names.output_units, b.names.output_units);
  EXPECT_EQ(a.K, b.K);
  EXPECT_EQ(a.L, b.L);
  EXPECT_EQ(a.feedforward, b.feedforward);
  EXPECT_EQ(a.u_nominal, b.u_nominal);
  EXPECT_EQ(a.y_nominal, b.y_nominal);
  EXPECT_EQ(a.u_reference, b.u_reference);
  EXPECT_EQ(a.y_reference, b.y_reference);
  EXPECT_EQ(a.weights.output, b.weights.output);
  EXPECT_EQ(a.weights.input, b.weights.input);
  EXPECT_EQ(a.weights.input_rate, b.weights.input_rate);
  EXPECT_EQ(a.weights.terminal, b.weights.terminal);
  EXPECT_EQ(a.model_name, b.model_name);
  ASSERT_EQ(a.predicted.has_value(), b.predicted.has_value());
  if (!a.predicted) return;
  EXPECT_EQ(a.predicted->outputs, b.predicted->outputs);
  EXPECT_EQ(a.predicted->inputs, b.predicted->inputs);
  EXPECT_EQ(a.predicted->input_rates, b.predicted->input_rates);
  EXPECT_EQ(a.predicted->measurement_noise, b.predicted->measurement_noise);
  EXPECT_EQ(a.predicted->presumes_zero_state, b.predicted->presumes_zero_state);
}

TEST_P(ControllerFile, ReturnsWhatWasWritten) {
  for (const Index steps : {1, 2, 6})
    for (const bool full : {false, true}) {
      const Controller controller = controller_of(steps, full);
      save_controller(controller, file());
      expect_equal(load_controller(file()), controller);
      EXPECT_THROW(load_model(file()), IoError);
      EXPECT_THROW(load_ensemble(file()), IoError);
      EXPECT_EQ(file_kind(file()), FileKind::controller);
    }
}

TEST_P(ControllerFile, RefusesOtherFiles) {
  save_model(random_system({3, 2, 2}, 5, 1.0, 3), file());
  EXPECT_THROW(load_controller(file()), IoError);
}

TEST_P(ControllerFile, IsNotWrittenIfItCouldNotBeRead) {
  const auto said = [&](auto&& spoil) {
    Controller bad = controller_of(4, true);
    spoil(bad);
    return message([&] { save_controller(bad, file()); });
  };
  const auto not_finite = [](const char* name) {
    return fmt::format("controller: a number that is not finite found in its {}, finite ones needed", name);
  };
  EXPECT_EQ(said([](Controller& c) { c.K[2](1, 0) = nan; }), not_finite("gains"));
  EXPECT_EQ(said([](Controller& c) { c.L[0](1, 1) = infinite; }), not_finite("gains"));
  EXPECT_EQ(said([](Controller& c) { c.feedforward(0, 0) = nan; }), not_finite("feedforward"));
  EXPECT_EQ(said([](Controller& c) { c.y_nominal(3, 1) = infinite; }), not_finite("nominal trajectory"));
  EXPECT_EQ(said([](Controller& c) { c.u_reference(0, 0) = nan; }), not_finite("reference"));
  EXPECT_EQ(said([](Controller& c) { c.weights.output[3](0, 0) = nan; }), not_finite("output weights"));
  EXPECT_EQ(said([](Controller& c) { c.weights.input.push_back(c.weights.input[0]); }),
            "controller: 2 matrices found as input weights, none, one or 4 needed");
  EXPECT_EQ(said([](Controller& c) { c.weights.terminal = Matrix::Identity(3, 3); }),
            "controller: 3 x 3 found as terminal weight, 2 x 2 needed");
  EXPECT_EQ(said([](Controller& c) { c.begin = -1; }), "controller: begin -1 found, 0 or more needed");
  EXPECT_EQ(said([](Controller& c) { c.dt = 0.0; }), "controller: dt 0 found, a positive number needed");
  EXPECT_EQ(said([](Controller& c) { c.predicted->inputs = -1.0; }),
            "controller: an expected cost of -1 found, numbers from 0 on needed");
  EXPECT_EQ(said([](Controller& c) { c.y_nominal.conservativeResize(3, Eigen::NoChange); }),
            "controller: parts of different sizes found, those that lqr() gives needed");
  EXPECT_FALSE(fs::exists(file()));
}

TEST_P(ControllerFile, HasNoExpectedCostThatIsNotFinite) {
  for (const double part : {infinite, nan}) {
    Controller controller = controller_of(4, true);
    controller.predicted->input_rates = part;
    save_controller(controller, file());
    controller.predicted.reset();
    expect_equal(load_controller(file()), controller);
  }
}

INSTANTIATE_TEST_SUITE_P(Formats, ControllerFile, ::testing::Values(".npz", ".h5", ".mat"));

}  // namespace
}  // namespace tokid::testing
