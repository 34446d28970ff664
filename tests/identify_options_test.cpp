// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"
#include "tokid/provenance.hpp"

namespace tokid::testing {
namespace {

Model model_with(const std::string& options) {
  Model model;
  model.options = options;
  return model;
}

std::string refusal(const std::string& options) {
  try {
    identify_options(model_with(options));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "no exception";
}

TEST(IdentifyOptions, EveryOneReturnsFromItsText) {
  const IdentifyOptions other{.states = 3,
                              .lags = 5,
                              .method = Method::subspace,
                              .smoothing = 0.25,
                              .period = 4,
                              .weighting = Weighting::projection,
                              .refine = false,
                              .initial_state = InitialState::unknown,
                              .nominal = NominalChoice::mean,
                              .frame = Frame::reference,
                              .reference_step = 0,
                              .hold_out = 0.1,
                              .rows = 7,
                              .cols = 9};
  IdentifyOptions one_model = other;
  one_model.method = Method::tvera;
  one_model.smoothing = std::numeric_limits<double>::infinity();
  one_model.refine = true;
  for (const IdentifyOptions& written : {other, one_model, IdentifyOptions{}}) {
    const IdentifyOptions read = identify_options(model_with(to_json(written, 40)));
    // A field more does not compile here until it stands in the list, and belongs into the table of the text too.
    const auto& [states, lags, method, smoothing, period, weighting, refine, initial_state, nominal, frame,
                 reference_step, hold_out, rows, cols, choices, execution] = read;
    EXPECT_EQ(states, written.states);
    EXPECT_EQ(lags, written.lags);
    EXPECT_EQ(method, written.method);
    EXPECT_EQ(smoothing, written.smoothing);
    EXPECT_EQ(period, written.period);
    EXPECT_EQ(weighting, written.weighting);
    EXPECT_EQ(refine, written.refine);
    EXPECT_EQ(initial_state, written.initial_state);
    EXPECT_EQ(nominal, written.nominal);
    EXPECT_EQ(frame, written.frame);
    EXPECT_EQ(reference_step, written.reference_step);
    EXPECT_EQ(hold_out, written.hold_out);
    EXPECT_EQ(rows, written.rows);
    EXPECT_EQ(cols, written.cols);
    EXPECT_FALSE(choices);            // told beside the options
    EXPECT_EQ(execution.threads, 1);  // not a property of the model
  }
}

TEST(IdentifyOptions, TextSaysWhatWasLeftToTheIdentification) {
  const auto json = nlohmann::json::parse(to_json({.lags = 4}, 25));
  EXPECT_EQ(json["states"], "auto");
  EXPECT_EQ(json["lags"], 4);
  EXPECT_EQ(json["method"], "auto");
  EXPECT_EQ(json["smoothing"], "auto");
  EXPECT_EQ(json["period"], 0);
  EXPECT_EQ(json["refine"], "auto");
  EXPECT_EQ(json["initial_state"], "auto");
  EXPECT_EQ(json["reference_step"], "auto");
  EXPECT_EQ(json["experiments"], 25);
}

TEST(IdentifyOptions, ModelsKnowTheDataThatTheyHaveSeen) {
  const Ensemble data = experiments(oscillator(30), {.experiments = 40, .measurement_noise = 0.1});
  const Ensemble other = experiments(oscillator(30), {.experiments = 40, .seed = 2, .measurement_noise = 0.1});
  Model model = identify(data, {.states = 4, .lags = 3, .refine = false, .hold_out = 0.25}).model;
  EXPECT_FALSE(has_seen(model, data));
  EXPECT_TRUE(has_seen(model, split(data, 0.25).training));
  EXPECT_FALSE(has_seen(model, split(data, 0.25).held_out));
  note_data(model, fingerprint(other));
  note_data(model, fingerprint(other));
  EXPECT_TRUE(has_seen(model, other));
  EXPECT_TRUE(has_seen(model, split(data, 0.25).training));
  EXPECT_EQ(refinement_smoothing(model), std::nullopt);
  for (const double smoothing : {0.5, std::numeric_limits<double>::infinity()}) {
    note_refinement(model, smoothing, 12);
    EXPECT_EQ(refinement_smoothing(model), smoothing);
  }
  EXPECT_EQ(nlohmann::json::parse(model.options)["data"].size(), 2u);
  EXPECT_EQ(identify_options(model).hold_out, 0.25);  // none of it is an option
  Model known = oscillator(10);
  EXPECT_FALSE(has_seen(known, data));
  known.options = "not JSON";
  EXPECT_FALSE(has_seen(known, data));
  EXPECT_EQ(refinement_smoothing(known), std::nullopt);
}

// What the bootstrap repeats with every replicate.
TEST(IdentifyOptions, NotedChoicesLeadToTheSameModel) {
  const Ensemble varying =
      experiments(oscillator(30), {.experiments = 25, .process_noise = 0.05, .measurement_noise = 0.1});
  const Model constant = constant_system({2, 1, 1}, 200, 0.9, 3);
  const Ensemble record = experiments(constant, {.experiments = 1, .process_noise = 0.05, .measurement_noise = 0.1});
  for (const bool refine : {false, true})
    for (const Ensemble* data : {&varying, &record}) {
      const Identification first = identify(*data, {.period = data == &record ? 1 : 0, .refine = refine});
      ASSERT_TRUE(first.plan.coupled);
      const std::optional<NoisyChoices> noted = noted_choices(first.model);
      ASSERT_TRUE(noted);
      EXPECT_EQ(noted->variation.smoothing, first.plan.choices.variation.smoothing);
      EXPECT_EQ(noted->refinement_iterations, first.refinement.iterations);
      IdentifyOptions again = identify_options(first.model);
      again.lags = first.plan.lags;
      again.states = first.model.states();
      again.choices = noted;
      const Identification second = identify(*data, again);
      EXPECT_EQ(all(second.model, &Step::A), all(first.model, &Step::A));
      EXPECT_EQ(all(second.model, &Step::D), all(first.model, &Step::D));
      EXPECT_EQ(all(second.model, &Step::G), all(first.model, &Step::G));
      EXPECT_TRUE(second.refinement.trials.empty());
    }
  EXPECT_FALSE(noted_choices(oscillator(10)));
  EXPECT_FALSE(noted_choices(model_with("{\"choices\": {\"smoothing\": 1}}")));
}

TEST(IdentifyOptions, ModelsHoldThem) {
  const Ensemble data = experiments(oscillator(30), {.experiments = 12});
  const Model model = identify(data, {.states = 4, .lags = 2, .nominal = NominalChoice::none}).model;
  const IdentifyOptions read = identify_options(model);
  EXPECT_EQ(read.states, 4);
  EXPECT_EQ(read.lags, 2);
  EXPECT_EQ(read.nominal, NominalChoice::none);
}

TEST(IdentifyOptions, WhatIsNotNamedHasItsDefault) {
  const IdentifyOptions read = identify_options(model_with(R"({"lags": 3})"));
  EXPECT_EQ(read.lags, 3);
  EXPECT_EQ(read.states, IdentifyOptions{}.states);
  EXPECT_EQ(read.initial_state, std::nullopt);
}

TEST(IdentifyOptions, ValuesOutOfTheirRangeAreRefused) {
  const Ensemble data = experiments(oscillator(10), {.experiments = 12});
  const auto refused = [&](const IdentifyOptions& options) {
    try {
      identify(data, options);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("no exception");
  };
  const std::string count = "0 found, a whole number from 1 to 1000000 or auto needed";
  EXPECT_EQ(refused({.states = 0}), "states: " + count);
  EXPECT_EQ(refused({.lags = 0}), "lags: " + count);
  EXPECT_EQ(refused({.rows = 0}), "rows: " + count);
  EXPECT_EQ(refused({.cols = 0}), "cols: " + count);
  EXPECT_EQ(refused({.smoothing = -1}), "smoothing: -1.0 found, a number from 0 on, infinity or auto needed");
  EXPECT_EQ(refused({.smoothing = std::nan("")}), "smoothing: nan found, a number from 0 on, infinity or auto needed");
  EXPECT_EQ(refused({.period = -1}), "period: -1 found, a whole number from 0 to 1000000 or invariant needed");
  EXPECT_EQ(refused({.reference_step = -1}),
            "reference_step: -1 found, a whole number from 0 to 1000000000 or auto needed");
  EXPECT_EQ(refused({.hold_out = 1}), "hold_out: 1.0 found, a number from 0 to below 1 needed");
}

TEST(IdentifyOptions, OthersThanTheKnownAreRefused) {
  EXPECT_NE(refusal("").find("none found"), std::string::npos);
  EXPECT_NE(refusal("{").find("JSON"), std::string::npos);
  EXPECT_NE(refusal("[1]").find("JSON"), std::string::npos);
  EXPECT_NE(refusal(R"({"wisdom": 3})").find("\"wisdom\" is not known"), std::string::npos);
  EXPECT_NE(refusal(R"({"states": 0})").find("a whole number from 1 to 1000000 or \"auto\" needed"), std::string::npos);
  EXPECT_NE(refusal(R"({"lags": 2.5})").find("2.5 found"), std::string::npos);
  EXPECT_NE(refusal(R"({"reference_step": -1})").find("a whole number from 0 to 1000000000 or"), std::string::npos);
  EXPECT_NE(refusal(R"({"hold_out": "much"})").find("a number from 0 to below 1 needed"), std::string::npos);
  EXPECT_NE(refusal(R"({"frame": "golden"})").find("one of \"raw\", \"reference\", \"smooth\""), std::string::npos);
  EXPECT_NE(refusal(R"({"method": "era"})").find("one of \"auto\", \"tvera\", \"subspace\""), std::string::npos);
  EXPECT_NE(refusal(R"({"smoothing": -1})").find("a number from 0 on, \"infinity\" or \"auto\" needed"),
            std::string::npos);
  EXPECT_NE(refusal(R"({"refine": 3})").find("one of \"auto\", \"yes\", \"no\""), std::string::npos);
  EXPECT_NE(refusal(R"({"nominal": null})").find("one of \"auto\", \"none\", \"mean\""), std::string::npos);
}

}  // namespace
}  // namespace tokid::testing
