// SPDX-License-Identifier: BSD-3-Clause
#include "choose/options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "model/provenance.hpp"

namespace tokid {

namespace {

constexpr Index largest_count = 1'000'000, last_step = 1'000'000'000;

// A whole number, or a word that stands for a value of its own.
Option whole(const char* key, const char* value, Index IdentifyOptions::*field, Index least, Index largest,
             std::vector<std::pair<std::string, Index>> words, const char* help) {
  Option o{.key = key,
           .value = value,
           .range = fmt::format("a whole number from {} to {}", least, largest),
           .words = {},
           .help = help,
           .opposite = {}};
  for (const auto& [word, meaning] : words) o.words.push_back(word);
  const auto in_range = [=](Index n) { return n >= least && n <= largest; };
  o.write = [=](const IdentifyOptions& options) {
    if (!in_range(options.*field))
      for (const auto& [word, meaning] : words)
        if (options.*field == meaning) return Json(word);
    return Json(options.*field);
  };
  o.read = [=](IdentifyOptions& options, const Json& json) {
    for (const auto& [word, meaning] : words)
      if (json == word) return options.*field = meaning, true;
    if (!json.is_number_integer() || !in_range(json.get<Index>())) return false;
    options.*field = json.get<Index>();
    return true;
  };
  o.is_valid = [=](const IdentifyOptions& options) {
    return in_range(options.*field) ||
           std::any_of(words.begin(), words.end(), [&](const auto& word) { return word.second == options.*field; });
  };
  return o;
}

// One of several words.
template <class T>
Option word(const char* key, T IdentifyOptions::*field, std::vector<std::pair<std::string, T>> words,
            const char* help) {
  Option o{.key = key, .value = {}, .range = {}, .words = {}, .help = help, .opposite = {}};
  for (const auto& [word, meaning] : words) o.words.push_back(word);
  o.value = fmt::format("{}", fmt::join(o.words, "|"));
  o.write = [=](const IdentifyOptions& options) {
    const auto found =
        std::find_if(words.begin(), words.end(), [&](const auto& w) { return w.second == options.*field; });
    return found == words.end() ? Json() : Json(found->first);
  };
  o.read = [=](IdentifyOptions& options, const Json& json) {
    for (const auto& [word, meaning] : words)
      if (json == word) return options.*field = meaning, true;
    return false;
  };
  o.is_valid = [](const IdentifyOptions&) { return true; };
  return o;
}

// On, off, or as the data ask for.
Option on_or_off(const char* key, std::optional<bool> IdentifyOptions::*field, const char* help, const char* opposite) {
  Option o = word<std::optional<bool>>(key, field, {{"auto", std::nullopt}, {"yes", true}, {"no", false}}, help);
  o.opposite = opposite;
  o.read = [read = o.read, field](IdentifyOptions& options, const Json& json) {
    if (json.is_boolean()) return options.*field = json.get<bool>(), true;
    return read(options, json);
  };
  return o;
}

// λ, where a negative one stands for "auto".
Option smoothing() {
  Option o{.key = "smoothing",
           .value = "L|auto",
           .range = "a number from 0 on",
           .words = {"infinity", "auto"},
           .help = "Penalty lambda on variation in time: 0 none, infinity one model (auto: by cross-validation)",
           .opposite = {}};
  o.write = [](const IdentifyOptions& options) {
    if (std::isnan(options.smoothing)) return Json("nan");
    return options.smoothing < 0 ? Json("auto") : provenance::penalty(options.smoothing);
  };
  o.read = [](IdentifyOptions& options, const Json& json) {
    const std::optional<double> given = provenance::penalty(json == "inf" ? Json("infinity") : json);
    if (!given && json != "auto") return false;
    options.smoothing = given.value_or(-1.0);
    return true;
  };
  o.is_valid = [](const IdentifyOptions& options) { return !std::isnan(options.smoothing); };
  return o;
}

Option hold_out() {
  Option o{.key = "hold_out",
           .value = "FRACTION",
           .range = "a number from 0 to below 1",
           .words = {},
           .help = "Share of the experiments kept for validation (default 0)",
           .opposite = {}};
  o.write = [](const IdentifyOptions& options) { return Json(options.hold_out); };
  o.is_valid = [](const IdentifyOptions& options) { return options.hold_out >= 0 && options.hold_out < 1; };
  o.read = [is_valid = o.is_valid](IdentifyOptions& options, const Json& json) {
    IdentifyOptions given;
    if (!json.is_number()) return false;
    given.hold_out = json.get<double>();
    if (!is_valid(given)) return false;
    options.hold_out = given.hold_out;
    return true;
  };
  return o;
}

// In the order of the text in models.
std::vector<Option> table() {
  using O = IdentifyOptions;
  return {
      whole("states", "N|auto", &O::states, 1, largest_count, {{"auto", 0}},
            "State dimension n (auto: the rank of the Hankel matrices, or by cross-validation where the data are "
            "noisy)"),
      whole("lags", "N|auto", &O::lags, 1, largest_count, {{"auto", 0}},
            "Lag order p (auto: the smallest leave-one-out error)"),
      word<Method>("method", &O::method,
                   {{"auto", Method::automatic}, {"tvera", Method::tvera}, {"subspace", Method::subspace}},
                   "Realisation (auto: tvera without noise from zero initial states, else subspace)"),
      smoothing(),
      whole("period", "P", &O::period, 0, largest_count, {{"invariant", 1}}, "Steps k, k+P, ... share one model"),
      word<std::optional<Weighting>>("weighting", &O::weighting,
                                     {{"auto", std::nullopt},
                                      {"one-step", Weighting::one_step},
                                      {"many-steps", Weighting::many_steps},
                                      {"projection", Weighting::projection}},
                                     "What the states must explain (auto: by cross-validation); projection: PO-MOESP"),
      on_or_off("refine", &O::refine,
                "Maximum likelihood by EM, as far as it lowers the cross-validation error (default for noisy data)",
                "No EM"),
      word<std::optional<InitialState>>(
          "initial_state", &O::initial_state,
          {{"auto", std::nullopt}, {"zero", InitialState::zero}, {"unknown", InitialState::unknown}},
          "States at step 0 (auto: as the data say, else by test)"),
      word<NominalChoice>(
          "nominal", &O::nominal,
          {{"auto", NominalChoice::automatic}, {"none", NominalChoice::none}, {"mean", NominalChoice::mean}},
          "Mean motion to remove (auto: where it is significant)"),
      word<Frame>("frame", &O::frame, {{"raw", Frame::raw}, {"reference", Frame::reference}, {"smooth", Frame::smooth}},
                  "Coordinates of the states (default raw)"),
      whole("reference_step", "S|auto", &O::reference_step, 0, last_step, {{"auto", -1}},
            "Step of the reference frame (auto: first of full dimension)"),
      hold_out(),
      whole("rows", "N|auto", &O::rows, 1, largest_count, {{"auto", 0}},
            "Block rows of the Hankel matrices of tvera (auto: as many as lags and states need)"),
      whole("cols", "N|auto", &O::cols, 1, largest_count, {{"auto", 0}},
            "Block columns of the Hankel matrices of tvera (auto: the same, and more with noise)"),
  };
}

}  // namespace

std::string Option::needed(std::string_view quote) const {
  std::vector<std::string> marked;
  for (const std::string& word : words) marked.push_back(fmt::format("{}{}{}", quote, word, quote));
  if (range.empty()) return fmt::format("one of {}", fmt::join(marked, ", "));
  if (marked.empty()) return range;
  const std::string last = marked.back();
  marked.pop_back();
  std::string text = range;
  for (const std::string& word : marked) text += ", " + word;
  return text + " or " + last;
}

const std::vector<Option>& option_table() {
  static const std::vector<Option> all = table();
  return all;
}

const Option* find_option(std::string_view key) {
  for (const Option& option : option_table())
    if (option.key == key) return &option;
  return nullptr;
}

void check_options(const IdentifyOptions& options) {
  for (const Option& option : option_table()) {
    if (option.is_valid(options)) continue;
    const Json found = option.write(options);
    throw std::invalid_argument(fmt::format("{}: {} found, {} needed", option.key,
                                            found.is_string() ? found.get<std::string>() : text_of(found),
                                            option.needed()));
  }
}

namespace {

// A weighting by its word in the table.
Json written(Weighting weighting) {
  IdentifyOptions options;
  options.weighting = weighting;
  return find_option("weighting")->write(options);
}

std::optional<Weighting> read_weighting(const Json& json) {
  IdentifyOptions options;
  find_option("weighting")->read(options, json);
  return options.weighting;
}

}  // namespace

std::string to_json(const IdentifyOptions& options, Index experiments) {
  Json json;
  for (const Option& option : option_table()) json[option.key] = option.write(options);
  json[provenance::experiments_key] = experiments;
  return text_of(json);
}

IdentifyOptions identify_options(const Model& model) {
  const Json json = options_json(model.options);
  if (!json.is_object())
    throw std::invalid_argument(model.options.empty()
                                    ? "options of the model: none found, those of an identified model needed"
                                    : "options of the model: not the text of a JSON object, as identify() writes it");
  IdentifyOptions options;
  for (const auto& [key, value] : json.items()) {
    if (provenance::is_key(key)) continue;
    const Option* option = find_option(key);
    if (!option)
      throw std::invalid_argument(
          fmt::format("options of the model: \"{}\" is not known; the model was made by version {}, this is {}", key,
                      model.version.empty() ? "(unknown)" : model.version, version));
    if (!option->read(options, value))
      throw std::invalid_argument(
          fmt::format("options of the model, \"{}\": {} found, {} needed", key, text_of(value), option->needed("\"")));
  }
  return options;
}

void note_choices(Model& model, const NoisyChoices& choices) {
  Json json = provenance::of(model);
  json[provenance::choices_key] = {{"smoothing", provenance::penalty(choices.variation.smoothing)},
                                   {"period", choices.variation.period},
                                   {"state_smoothing", provenance::penalty(choices.state_smoothing)},
                                   {"weighting", written(choices.weighting)},
                                   {"refinement_smoothing", provenance::penalty(choices.refinement_smoothing)},
                                   {"refinement_iterations", choices.refinement_iterations}};
  model.options = text_of(json);
}

std::optional<NoisyChoices> noted_choices(const Model& model) {
  const Json json = provenance::of(model);
  const auto noted = json.find(provenance::choices_key);
  if (noted == json.end() || !noted->is_object()) return std::nullopt;
  const auto number = [&](const char* key) { return provenance::penalty(noted->value(key, Json())); };
  const auto count = [&](const char* key) -> std::optional<Index> {
    const Json value = noted->value(key, Json());
    return value.is_number_integer() && value >= 0 ? std::optional(value.get<Index>()) : std::nullopt;
  };
  const auto smoothing = number("smoothing"), states = number("state_smoothing"), em = number("refinement_smoothing");
  const auto period = count("period"), iterations = count("refinement_iterations");
  const std::optional<Weighting> weighting = read_weighting(noted->value("weighting", Json()));
  if (!smoothing || !states || !em || !period || !iterations || !weighting) return std::nullopt;
  return NoisyChoices{{*smoothing, *period}, *states, *weighting, *em, *iterations};
}

}  // namespace tokid
