// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <utility>

#include "base/json.hpp"
#include "model/provenance.hpp"
#include "tokid/options.hpp"

namespace tokid {

namespace {

[[noreturn]] void refuse(const char* key, const Json& found, const std::string& needed) {
  throw std::invalid_argument(
      fmt::format("options of the model, \"{}\": {} found, {} needed", key, text_of(found), needed));
}

// One option: its key, and the functions that write and read it.
struct Entry {
  const char* key;
  Json (*write)(const IdentifyOptions& options);
  void (*read)(IdentifyOptions& options, const char* key, const Json& value);
};

// A whole number above `automatic`. The value `automatic` leaves the choice to the identification.
template <auto field, Index automatic = 0>
constexpr Entry count(const char* key) {
  return {key, [](const IdentifyOptions& o) { return o.*field > automatic ? Json(o.*field) : Json("auto"); },
          [](IdentifyOptions& o, const char* k, const Json& value) {
            if (value == "auto")
              o.*field = automatic;
            else if (value.is_number_integer() && value > automatic)
              o.*field = value.get<Index>();
            else
              refuse(k, value, fmt::format("\"auto\" or a whole number from {} on", automatic + 1));
          }};
}

template <auto field>
constexpr Entry real(const char* key) {
  return {key, [](const IdentifyOptions& o) { return Json(o.*field); },
          [](IdentifyOptions& o, const char* k, const Json& value) {
            if (!value.is_number()) refuse(k, value, "a number");
            o.*field = value.get<double>();
          }};
}

template <class T, size_t size>
using Words = std::array<std::pair<const char*, T>, size>;

template <class T, size_t size>
Json word_of(const Words<T, size>& words, const T& value) {
  for (const auto& [word, meaning] : words)
    if (meaning == value) return word;
  return {};
}

template <class T, size_t size>
std::optional<T> value_of(const Words<T, size>& words, const Json& found) {
  for (const auto& [word, value] : words)
    if (found == word) return value;
  return std::nullopt;
}

// An option whose value is one of several words.
template <auto field, const auto& words>
constexpr Entry choice(const char* key) {
  return {key, [](const IdentifyOptions& o) { return word_of(words, o.*field); },
          [](IdentifyOptions& o, const char* k, const Json& found) {
            const auto value = value_of(words, found);
            std::vector<std::string> known;
            for (const auto& [word, meaning] : words) known.emplace_back(word);
            if (!value) refuse(k, found, fmt::format("one of {}", fmt::join(known, "|")));
            o.*field = *value;
          }};
}

constexpr Words<std::optional<InitialState>, 3> initial_states{
    {{"auto", std::nullopt}, {"zero", InitialState::zero}, {"unknown", InitialState::unknown}}};
constexpr Words<NominalChoice, 3> nominals{
    {{"auto", NominalChoice::automatic}, {"none", NominalChoice::none}, {"mean", NominalChoice::mean}}};
constexpr Words<Frame, 3> frames{{{"raw", Frame::raw}, {"reference", Frame::reference}, {"smooth", Frame::smooth}}};

constexpr Words<Method, 3> methods{
    {{"auto", Method::automatic}, {"tvera", Method::tvera}, {"subspace", Method::subspace}}};
constexpr Words<std::optional<bool>, 3> answers{{{"auto", std::nullopt}, {"yes", true}, {"no", false}}};

constexpr Words<std::optional<Weighting>, 4> weighting_words{{{"auto", std::nullopt},
                                                              {"one-step", Weighting::one_step},
                                                              {"many-steps", Weighting::many_steps},
                                                              {"projection", Weighting::projection}}};

// λ; a negative value is written as "auto".
constexpr Entry smoothing_entry = {
    "smoothing",
    [](const IdentifyOptions& o) { return o.smoothing < 0 ? Json("auto") : provenance::penalty(o.smoothing); },
    [](IdentifyOptions& o, const char* k, const Json& value) {
      const std::optional<double> given = provenance::penalty(value);
      if (!given && value != "auto") refuse(k, value, "\"auto\", \"infinity\" or a number from 0 on");
      o.smoothing = given.value_or(-1.0);
    }};

// P; 0: none
constexpr Entry period_entry = {"period", [](const IdentifyOptions& o) { return Json(o.period); },
                                [](IdentifyOptions& o, const char* k, const Json& value) {
                                  if (!value.is_number_integer() || value < 0)
                                    refuse(k, value, "a whole number from 0 on");
                                  o.period = value.get<Index>();
                                }};

// Every option that affects the model, in the order of the text. A new option needs one line here.
constexpr Entry table[] = {
    count<&IdentifyOptions::states>("states"),
    count<&IdentifyOptions::lags>("lags"),
    choice<&IdentifyOptions::method, methods>("method"),
    smoothing_entry,
    period_entry,
    choice<&IdentifyOptions::weighting, weighting_words>("weighting"),
    choice<&IdentifyOptions::refine, answers>("refine"),
    choice<&IdentifyOptions::initial_state, initial_states>("initial_state"),
    choice<&IdentifyOptions::nominal, nominals>("nominal"),
    choice<&IdentifyOptions::frame, frames>("frame"),
    count<&IdentifyOptions::reference_step, -1>("reference_step"),
    real<&IdentifyOptions::hold_out>("hold_out"),
    count<&IdentifyOptions::rows>("rows"),
    count<&IdentifyOptions::cols>("cols"),
};

const Entry* find(std::string_view key) {
  for (const Entry& entry : table)
    if (entry.key == key) return &entry;
  return nullptr;
}

}  // namespace

std::string to_json(const IdentifyOptions& options, Index experiments) {
  Json json;
  for (const Entry& entry : table) json[entry.key] = entry.write(options);
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
    const Entry* entry = find(key);
    if (!entry)
      throw std::invalid_argument(
          fmt::format("options of the model: \"{}\" is not known; the model was made by version {}, this is {}", key,
                      model.version.empty() ? "(unknown)" : model.version, version));
    entry->read(options, entry->key, value);
  }
  return options;
}

void note_choices(Model& model, const NoisyChoices& choices) {
  Json json = provenance::of(model);
  json[provenance::choices_key] = {{"smoothing", provenance::penalty(choices.variation.smoothing)},
                                   {"period", choices.variation.period},
                                   {"state_smoothing", provenance::penalty(choices.state_smoothing)},
                                   {"weighting", word_of(weighting_words, std::optional(choices.weighting))},
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
  const auto weighting = value_of(weighting_words, noted->value("weighting", Json()));
  if (!smoothing || !states || !em || !period || !iterations || !weighting || !*weighting) return std::nullopt;
  return NoisyChoices{{*smoothing, *period}, *states, **weighting, *em, *iterations};
}

}  // namespace tokid
