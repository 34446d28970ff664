// SPDX-License-Identifier: BSD-3-Clause
// Powers of two in the units of the channels change no bit of a model.
#include <gtest/gtest.h>

#include <algorithm>

#include "base/random.hpp"
#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing::invariance {
namespace {

struct Case {
  const char* name;
  Ensemble data;
  IdentifyOptions options = {};
};

Ensemble with_mean_motion(Ensemble e) {
  for (Index k = 0; k < e.steps(); ++k) {
    e.input(k).array() += 2.0;
    e.output(k).array() += 3.0 * std::sin(0.2 * double(k));
  }
  return e;
}

Ensemble with_gaps(Ensemble e) {
  RandomNumbers random(7);
  for (Index k = 0; k < e.steps(); ++k)
    for (Index n = 0; n < e.experiments(); ++n)
      if (random.uniform() < 0.02) e.y(n, k, 0) = nan;
  return e;
}

std::vector<Case> cases() {
  const ExperimentOptions noisy{.experiments = 24, .process_noise = 0.02, .measurement_noise = 0.05};
  const Ensemble oscillating = experiments(oscillator(25), noisy), rotating = experiments(rotating_tube(25), noisy);
  ExperimentOptions moving = noisy;
  moving.initial_state = InitialState::unknown;
  return {{"oscillator", oscillating},
          {"rotating_tube", rotating},
          {"mean_motion", with_mean_motion(experiments(oscillator(25), moving))},
          {"gaps", with_gaps(rotating)},
          {"weights", oscillating, {.output_weights = {1.0, 4.0}, .refine = false}},
          {"period", rotating, {.period = 10}},
          {"exact", experiments(oscillator(25), {.experiments = 20, .free_responses = 3})}};
}

// Multiplies input 0 by 2^20 and output 0 by 2^-13, also in the free responses.
Ensemble in_other_units(Ensemble e) {
  for (Index k = 0; k < e.steps(); ++k) {
    e.input(k).col(0) *= 0x1p20;
    e.output(k).col(0) *= 0x1p-13;
  }
  for (Index k = 0; k < e.free.steps; ++k) e.free.y.col(k * e.outputs()) *= 0x1p-13;
  return e;
}

Matrix predictions(const Model& model, const Ensemble& data) { return predict(model, data, {5}).y.samples(); }

bool same_bits(const Matrix& a, const Matrix& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() &&
         std::equal(a.data(), a.data() + a.size(), b.data(),
                    [](double x, double y) { return x == y || (std::isnan(x) && std::isnan(y)); });
}

class Invariance : public ::testing::TestWithParam<Case> {};

TEST_P(Invariance, PowersOfTwoInTheUnitsChangeNoBit) {
  const auto& [name, data, options] = GetParam();
  const Matrix predicted = predictions(identify(data, options).model, data);
  const Ensemble scaled = in_other_units(data);
  Ensemble other = data;
  other.samples() = predictions(identify(scaled, options).model, scaled);
  for (Index k = 0; k < other.steps(); ++k) {
    other.input(k).col(0) *= 0x1p-20;
    other.output(k).col(0) *= 0x1p13;
  }
  EXPECT_TRUE(same_bits(predicted, other.samples()));
}

INSTANTIATE_TEST_SUITE_P(Plants, Invariance, ::testing::ValuesIn(cases()),
                         [](const auto& test) { return std::string(test.param.name); });

}  // namespace
}  // namespace tokid::testing::invariance
