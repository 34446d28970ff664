// SPDX-License-Identifier: BSD-3-Clause
// The order of the experiments and powers of two in the units of the channels change no bit of a model.
#include <gtest/gtest.h>

#include <algorithm>

#include "base/random.hpp"
#include "data/content_order.hpp"
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

Ensemble permuted(const Ensemble& e, std::uint64_t seed) {
  return e.subset(RandomNumbers(seed).permutation(e.experiments()));
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

TEST_P(Invariance, OrderAndPowersOfTwoChangeNoBit) {
  const auto& [name, data, options] = GetParam();
  const Matrix predicted = predictions(identify(data, options).model, data);
  const Ensemble scaled = in_other_units(data);
  Ensemble other = data;
  other.samples() = predictions(identify(permuted(scaled, 3), options).model, scaled);
  for (Index k = 0; k < other.steps(); ++k) {
    other.input(k).col(0) *= 0x1p-20;
    other.output(k).col(0) *= 0x1p13;
  }
  EXPECT_TRUE(same_bits(predicted, other.samples()));
}

INSTANTIATE_TEST_SUITE_P(Plants, Invariance, ::testing::ValuesIn(cases()),
                         [](const auto& test) { return std::string(test.param.name); });

// Outliers name the rows of the caller.
TEST(InvarianceOfRows, ResultsNameTheRowsOfTheCaller) {
  Ensemble e = experiments(oscillator(25), {.experiments = 40, .measurement_noise = 0.05});
  for (Index k = 0; k < e.steps(); ++k) e.output(k).row(17) *= -1.0;
  const IdentifyOptions options{.refine = false};
  const Identification found = identify(e, options);
  ASSERT_EQ(found.outliers.size(), 1u);
  EXPECT_EQ(found.outliers.front().experiment, 17);
  const std::vector<Index> order = RandomNumbers(5).permutation(40);
  const Identification other = identify(e.subset(order), options);
  ASSERT_EQ(other.outliers.size(), 1u);
  EXPECT_EQ(order[size_t(other.outliers.front().experiment)], 17);
}

TEST(ContentOrder, SortsByTheSamplesAlone) {
  const Ensemble e = with_gaps(experiments(oscillator(20), {.experiments = 30, .measurement_noise = 0.05}));
  const Ensemble sorted = e.subset(content_order(e));
  for (const std::uint64_t seed : {1, 2, 3}) {
    const Ensemble other = permuted(e, seed);
    EXPECT_TRUE(same_bits(sorted.samples(), other.subset(content_order(other)).samples()));
  }
  EXPECT_EQ(content_order(e), content_order(in_other_units(e)));
  // Rounding errors and offsets: the sums of different experiments differ by far more.
  Ensemble near = e;
  near.samples() *= 1 + 4 * epsilon;
  for (Index k = 0; k < near.steps(); ++k) near.output(k).array() += 1000.0;
  EXPECT_EQ(content_order(e), content_order(near));
}

// The sums of these experiments are equal: a missing sample and a sample of zero count alike.
TEST(ContentOrder, ComparesSamplesWhereSumsAreEqual) {
  Ensemble e(3, 2, 1, 1);
  e.samples() << 1, 0, 2, 3,  //
      1, nan, 2, 3,           //
      1, 0, 2, 3;
  EXPECT_EQ(content_order(e), (std::vector<Index>{0, 2, 1}));
  EXPECT_EQ(content_order(e.subset({1, 2, 0})), (std::vector<Index>{1, 2, 0}));
}

}  // namespace
}  // namespace tokid::testing::invariance
