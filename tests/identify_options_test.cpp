// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <nlohmann/json.hpp>

#include "io/formats/provenance_text.hpp"
#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing {
namespace {

std::string refusal(const std::string& options) {
  try {
    identify_options(io::provenance_of(options));
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
                              .jumps = std::vector<Index>{3, 20},
                              .delays = std::vector<Index>{0, 7},
                              .weighting = Weighting::projection,
                              .output_weights = {0, 2.5, 1},
                              .horizons = {1, 40},
                              .refine = false,
                              .initial_state = InitialState::unknown,
                              .nominal = NominalChoice::mean,
                              .frame = Frame::reference,
                              .reference_step = 0,
                              .hold_out = 0.1,
                              .outliers = OutlierChoice::downweight,
                              .rows = 7,
                              .cols = 9};
  IdentifyOptions one_model = other;
  one_model.method = Method::tvera;
  one_model.smoothing = std::numeric_limits<double>::infinity();
  one_model.refine = true;
  one_model.outliers = OutlierChoice::drop;
  one_model.jumps = std::vector<Index>{};
  for (const IdentifyOptions& written : {other, one_model, IdentifyOptions{}}) {
    const IdentifyOptions read = identify_options(io::provenance_of(io::provenance_text({.options = written})));
    // A field more does not compile here until it stands in the list, and belongs into the table of the text too.
    const auto& [states, lags, method, smoothing, feedthrough, period, jumps, delays, weighting, output_weights,
                 horizons, refine, initial_state, nominal, frame, reference_step, hold_out, outliers, rows, cols,
                 choices, execution] = read;
    EXPECT_EQ(states, written.states);
    EXPECT_EQ(lags, written.lags);
    EXPECT_EQ(method, written.method);
    EXPECT_EQ(smoothing, written.smoothing);
    EXPECT_EQ(feedthrough, written.feedthrough);
    EXPECT_EQ(period, written.period);
    EXPECT_EQ(jumps, written.jumps);
    EXPECT_EQ(delays, written.delays);
    EXPECT_EQ(weighting, written.weighting);
    EXPECT_EQ(output_weights, written.output_weights);
    EXPECT_EQ(horizons, written.horizons);
    EXPECT_EQ(refine, written.refine);
    EXPECT_EQ(initial_state, written.initial_state);
    EXPECT_EQ(nominal, written.nominal);
    EXPECT_EQ(frame, written.frame);
    EXPECT_EQ(reference_step, written.reference_step);
    EXPECT_EQ(hold_out, written.hold_out);
    EXPECT_EQ(outliers, written.outliers);
    EXPECT_EQ(rows, written.rows);
    EXPECT_EQ(cols, written.cols);
    EXPECT_FALSE(choices);            // stands beside the options
    EXPECT_EQ(execution.threads, 1);  // not a property of the model
  }
}

TEST(IdentifyOptions, TextSaysWhatWasLeftToTheIdentification) {
  const auto json =
      nlohmann::json::parse(io::provenance_text({.options = IdentifyOptions{.lags = 4}, .experiments = 25}));
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
  EXPECT_FALSE(has_seen(model.provenance, data));
  EXPECT_TRUE(has_seen(model.provenance, split(data, 0.25).training));
  EXPECT_FALSE(has_seen(model.provenance, split(data, 0.25).held_out));
  note_data(model.provenance, fingerprint(other));
  note_data(model.provenance, fingerprint(other));
  EXPECT_TRUE(has_seen(model.provenance, other));
  EXPECT_TRUE(has_seen(model.provenance, split(data, 0.25).training));
  EXPECT_EQ(model.provenance.data.size(), 2u);
  EXPECT_EQ(identify_options(model.provenance).hold_out, 0.25);
  EXPECT_FALSE(has_seen(oscillator(10).provenance, data));
}

TEST(Provenance, ReturnsFromItsText) {
  for (const double smoothing : {0.5, std::numeric_limits<double>::infinity()}) {
    const Provenance written{
        .options = IdentifyOptions{.states = 3, .hold_out = 0.25},
        .experiments = 30,
        .data = {"97d64adfcd832056", "a"},
        .dt_stated = false,
        .choices = NoisyChoices{{smoothing, 4, {2, 9}}, 0.1, Weighting::projection, smoothing, 7, {0, 7}},
        .refinement = EmRun{smoothing, 12},
        .corrections = {{{"7", 0.5}}, {}},
        .feedthrough = FeedthroughChoice{false, FeedthroughChoice::Reason::no_response}};
    const Provenance read = io::provenance_of(io::provenance_text(written), "1.2.3");
    // A field more does not compile here until it stands in the list, and belongs into the text, too.
    const auto& [options, experiments, data, dt_stated, choices, refinement, corrections, feedthrough, program, text,
                 unread] = read;
    ASSERT_TRUE(options && choices && refinement && feedthrough);
    EXPECT_EQ(options->states, 3);
    EXPECT_EQ(options->hold_out, 0.25);
    EXPECT_EQ(experiments, 30);
    EXPECT_EQ(data, written.data);
    EXPECT_FALSE(dt_stated);
    EXPECT_EQ(choices->variation.smoothing, smoothing);
    EXPECT_EQ(choices->variation.period, 4);
    EXPECT_EQ(choices->state_smoothing, 0.1);
    EXPECT_EQ(choices->weighting, Weighting::projection);
    EXPECT_EQ(choices->refinement_smoothing, smoothing);
    EXPECT_EQ(choices->refinement_iterations, 7);
    EXPECT_EQ(choices->variation.jumps, written.choices->variation.jumps);
    EXPECT_EQ(choices->delays, written.choices->delays);
    EXPECT_EQ(refinement->smoothing, smoothing);
    EXPECT_EQ(refinement->iterations, 12);
    EXPECT_EQ(corrections.experiments, written.corrections.experiments);
    EXPECT_FALSE(feedthrough->present);
    EXPECT_EQ(feedthrough->reason, FeedthroughChoice::Reason::no_response);
    EXPECT_EQ(program, "1.2.3");
    EXPECT_EQ(text, "");  // the members say all of it
    EXPECT_EQ(unread, "");
    EXPECT_EQ(io::provenance_text(read), io::provenance_text(written));
  }
  EXPECT_EQ(io::provenance_text({}), "");
}

// Texts of other versions and of other programs.
TEST(Provenance, KeepsTheTextThatItReads) {
  for (const std::string text :
       {"not JSON", "[1]", "{}", R"({"lags": 3})", R"({"lags":0,"experiments":5})", R"({"wisdom": 3, "data": ["a"]})",
        R"({"experiments": 1.5, "data": [1], "dt_stated": 0, "choices": {"smoothing": 1}, "refined": []})"})
    EXPECT_EQ(io::provenance_text(io::provenance_of(text)), text);
}

TEST(Provenance, ChangesOnlyWhatHasChangedInATextThatItReads) {
  Provenance newer = io::provenance_of(R"({"experiments": 4, "wisdom": 3, "refined": {"smoothing": 1, "more": 2}})");
  EXPECT_EQ(newer.experiments, 4);
  EXPECT_EQ(newer.refinement->smoothing, 1);
  newer.experiments = 6;
  note_data(newer, "b");
  EXPECT_EQ(io::provenance_text(newer),
            R"({"experiments":6,"wisdom":3,"refined":{"smoothing":1,"more":2},"data":["b"]})");
  newer.refinement.reset();
  EXPECT_EQ(io::provenance_text(newer), R"({"experiments":6,"wisdom":3,"data":["b"]})");
  Provenance other = io::provenance_of("not JSON");
  EXPECT_TRUE(other.dt_stated && other.data.empty() && !other.refinement);
  other.refinement = {0.5, 3};
  EXPECT_EQ(io::provenance_text(other), R"({"refined":{"smoothing":0.5,"iterations":3}})");
}

// Also directly after a refinement, as from its text.
TEST(Provenance, KnownModelsAfterARefinementHaveTheDefaultOptions) {
  EXPECT_THROW(identify_options({}), std::invalid_argument);
  const Provenance refined{.data = {"a"}, .refinement = EmRun{1.0, 2}};
  for (const Provenance& provenance : {refined, io::provenance_of(io::provenance_text(refined))})
    EXPECT_EQ(identify_options(provenance).states, std::nullopt);
}

// What the bootstrap repeats with every replicate.
TEST(IdentifyOptions, NotedChoicesLeadToTheSameModel) {
  const Ensemble varying =
      experiments(oscillator(30), {.experiments = 25, .process_noise = 0.05, .measurement_noise = 0.1});
  const Model constant = constant_system({2, 1, 1}, 200, 0.9, 3);
  const Ensemble record = experiments(constant, {.experiments = 1, .process_noise = 0.05, .measurement_noise = 0.1});
  const std::vector<IdentifyOptions> ways{{.refine = false}, {.refine = true}, {.method = Method::regression}};
  for (IdentifyOptions way : ways)
    for (const Ensemble* data : {&varying, &record}) {
      way.period = data == &record ? 1 : 0;
      const Identification first = identify(*data, way);
      ASSERT_TRUE(first.plan.coupled);
      const std::optional<NoisyChoices>& noted = first.model.provenance.choices;
      ASSERT_TRUE(noted);
      EXPECT_EQ(noted->variation.smoothing, first.plan.choices.variation.smoothing);
      EXPECT_EQ(noted->refinement_iterations, first.refinement.iterations);
      IdentifyOptions again = identify_options(first.model.provenance);
      again.lags = first.plan.lags;
      if (first.plan.method == Method::subspace) again.states = first.model.states();
      again.choices = noted;
      const Identification second = identify(*data, again);
      EXPECT_EQ(all(second.model, &Step::A), all(first.model, &Step::A));
      EXPECT_EQ(all(second.model, &Step::D), all(first.model, &Step::D));
      EXPECT_EQ(all(second.model, &Step::G), all(first.model, &Step::G));
      EXPECT_TRUE(second.refinement.trials.empty());
    }
  EXPECT_FALSE(io::provenance_of("{\"choices\": {\"smoothing\": 1}}").choices);
}

TEST(IdentifyOptions, ModelsHoldThem) {
  const Ensemble data = experiments(oscillator(30), {.experiments = 12});
  const Model model = identify(data, {.states = 4, .lags = 2, .nominal = NominalChoice::none}).model;
  const IdentifyOptions read = identify_options(model.provenance);
  EXPECT_EQ(read.states, 4);
  EXPECT_EQ(read.lags, 2);
  EXPECT_EQ(read.nominal, NominalChoice::none);
}

TEST(IdentifyOptions, WhatIsNotNamedHasItsDefault) {
  const IdentifyOptions read = identify_options(io::provenance_of(R"({"lags": 3})"));
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
  const std::string weights = " found, a number from 0 on for each output (not all 0) or equal needed";
  EXPECT_EQ(refused({.output_weights = {1, -1}}), "output_weights: [1.0,-1.0]" + weights);
  EXPECT_EQ(refused({.output_weights = {1, std::nan("")}}), "output_weights: [1.0,\"nan\"]" + weights);
  EXPECT_EQ(refused({.output_weights = {std::numeric_limits<double>::infinity(), 1}}),
            "output_weights: [\"infinity\",1.0]" + weights);
  EXPECT_EQ(refused({.output_weights = {0, 0}}), "output_weights: [0.0,0.0]" + weights);
  EXPECT_EQ(refused({.output_weights = {1, 2, 3}}), "output_weights: 3 found, 2 needed, one for each output");
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
  EXPECT_NE(refusal(R"({"outliers": "hide"})").find("one of \"keep\", \"drop\", \"downweight\""), std::string::npos);
  EXPECT_NE(refusal(R"({"frame": "golden"})").find("one of \"raw\", \"reference\", \"smooth\""), std::string::npos);
  EXPECT_NE(refusal(R"({"method": "era"})").find("one of \"auto\", \"tvera\", \"subspace\""), std::string::npos);
  EXPECT_NE(refusal(R"({"smoothing": -1})").find("a number from 0 on, \"infinity\" or \"auto\" needed"),
            std::string::npos);
  EXPECT_NE(refusal(R"({"refine": 3})").find("one of \"auto\", \"yes\", \"no\""), std::string::npos);
  EXPECT_NE(refusal(R"({"nominal": null})").find("one of \"auto\", \"none\", \"mean\""), std::string::npos);
}

}  // namespace
}  // namespace tokid::testing
