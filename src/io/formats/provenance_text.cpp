// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/provenance_text.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>
#include <string_view>

#include "base/json.hpp"
#include "base/nan.hpp"
#include "model/options.hpp"
#include "tokid/version.hpp"

namespace tokid::io {

namespace {

constexpr const char *experiments_key = "experiments", *data_key = "data", *dt_key = "dt_stated",
                     *choices_key = "choices", *refinement_key = "refined", *corrections_key = "corrections",
                     *feedthrough_key = "feedthrough_choice";

bool is_option(std::string_view key) {
  constexpr std::string_view others[] = {experiments_key, data_key,        dt_key,         choices_key,
                                         refinement_key,  corrections_key, feedthrough_key};
  return std::find(std::begin(others), std::end(others), key) == std::end(others);
}

const Option& weighting_option() { return *find_option("weighting"); }

Json json_of(const NoisyChoices& choices) {
  const IdentifyOptions with_weighting{.weighting = choices.weighting};
  return {{"smoothing", penalty(choices.variation.smoothing)},
          {"period", choices.variation.period},
          {"state_smoothing", penalty(choices.state_smoothing)},
          {"weighting", weighting_option().write(with_weighting)},
          {"refinement_smoothing", penalty(choices.refinement_smoothing)},
          {"refinement_iterations", choices.refinement_iterations},
          {"jumps", choices.variation.jumps},
          {"delays", choices.delays}};
}

Json json_of(const Corrections& corrections) {
  Json json = {{"experiments", Json::array()}, {"samples", Json::array()}};
  for (const Corrections::Experiment& e : corrections.experiments)
    json["experiments"].push_back({{"label", e.label}, {"weight", e.weight}});
  for (const Corrections::Sample& s : corrections.samples)
    json["samples"].push_back({{"label", s.label},
                               {"output", s.output},
                               {"step", s.step},
                               {"value", std::isnan(s.value) ? Json() : Json(s.value)}});
  return json;
}

Json json_of(const FeedthroughChoice& choice) {
  return {{"present", choice.present}, {"reason", to_string(choice.reason)}};
}

// The members as JSON; `text`, from which they were read, is left out.
Json json_of(const Provenance& provenance) {
  Json json = Json::object();
  if (provenance.options)
    for (const Option& option : option_table()) json[option.key] = option.write(*provenance.options);
  if (provenance.experiments != 0) json[experiments_key] = provenance.experiments;
  if (!provenance.data.empty()) json[data_key] = provenance.data;
  if (!provenance.dt_stated) json[dt_key] = false;
  if (provenance.choices) json[choices_key] = json_of(*provenance.choices);
  if (provenance.refinement)
    json[refinement_key] = {{"smoothing", penalty(provenance.refinement->smoothing)},
                            {"iterations", provenance.refinement->iterations}};
  if (!provenance.corrections.empty()) json[corrections_key] = json_of(provenance.corrections);
  if (provenance.feedthrough) json[feedthrough_key] = json_of(*provenance.feedthrough);
  return json;
}

std::optional<Index> count_of(const Json& value) {
  return value.is_number_integer() && value >= 0 ? std::optional(value.get<Index>()) : std::nullopt;
}

std::optional<NoisyChoices> choices_of(const Json& json) {
  if (!json.is_object()) return std::nullopt;
  const auto at = [&](const char* key) { return json.value(key, Json()); };
  const auto smoothing = penalty(at("smoothing")), states = penalty(at("state_smoothing")),
             em = penalty(at("refinement_smoothing"));
  const auto period = count_of(at("period")), iterations = count_of(at("refinement_iterations"));
  IdentifyOptions others;
  weighting_option().read(others, at("weighting"));
  // Models of older versions have no jumps and no dead times, and models without them empty lists.
  const Json jumps = at("jumps");
  if (jumps.is_array() && !jumps.empty()) find_option("jumps")->read(others, jumps);
  const Json delays = at("delays");
  if (delays.is_array() && !delays.empty()) find_option("delays")->read(others, delays);
  if (!smoothing || !states || !em || !period || !iterations || !others.weighting) return std::nullopt;
  return NoisyChoices{{*smoothing, *period, others.jumps.value_or(std::vector<Index>{})},
                      *states,
                      *others.weighting,
                      *em,
                      *iterations,
                      others.delays.value_or(std::vector<Index>{})};
}

std::optional<EmRun> refinement_of(const Json& json) {
  if (!json.is_object()) return std::nullopt;
  const std::optional<double> smoothing = penalty(json.value("smoothing", Json()));
  if (!smoothing) return std::nullopt;
  return EmRun{*smoothing, count_of(json.value("iterations", Json())).value_or(0)};
}

// The objects of the list with this name.
Json objects_in(const Json& json, const char* name) {
  Json result = Json::array();
  if (!json.is_object() || !json.contains(name) || !json.at(name).is_array()) return result;
  for (const Json& value : json.at(name))
    if (value.is_object()) result.push_back(value);
  return result;
}

Corrections corrections_of(const Json& json) {
  Corrections result;
  for (const Json& e : objects_in(json, "experiments")) {
    const Json label = e.value("label", Json()), weight = e.value("weight", Json());
    if (label.is_string() && weight.is_number() && weight >= 0 && weight <= 1)
      result.experiments.push_back({label.get<std::string>(), weight.get<double>()});
  }
  for (const Json& s : objects_in(json, "samples")) {
    const Json label = s.value("label", Json()), value = s.value("value", Json());
    const auto output = count_of(s.value("output", Json())), step = count_of(s.value("step", Json()));
    if (label.is_string() && output && step && (value.is_null() || value.is_number()))
      result.samples.push_back({label.get<std::string>(), *output, *step, value.is_null() ? nan : value.get<double>()});
  }
  return result;
}

std::optional<FeedthroughChoice> feedthrough_of(const Json& json) {
  if (!json.is_object() || !json.value("present", Json()).is_boolean()) return std::nullopt;
  for (int i = 0; i <= int(FeedthroughChoice::Reason::last); ++i)
    if (const auto reason = FeedthroughChoice::Reason(i); json.value("reason", Json()) == to_string(reason))
      return FeedthroughChoice{.present = json["present"].get<bool>(), .reason = reason};
  return std::nullopt;
}

std::vector<std::string> texts_of(const Json& list) {
  std::vector<std::string> texts;
  for (const Json& value : list.is_array() ? list : Json::array())
    if (value.is_string()) texts.push_back(value.get<std::string>());
  return texts;
}

// Reads the options. If an option cannot be read, sets `unread` to the reason instead.
void read_options(const Json& json, Provenance& provenance) {
  IdentifyOptions options;
  for (const auto& [key, value] : json.items()) {
    if (!is_option(key)) continue;
    const Option* option = find_option(key);
    if (!option)
      provenance.unread =
          fmt::format("options of the model: \"{}\" is not known; the model was made by version {}, this is {}", key,
                      provenance.version.empty() ? "(unknown)" : provenance.version, version);
    else if (!option->read(options, value))
      provenance.unread =
          fmt::format("options of the model, \"{}\": {} found, {} needed", key, text_of(value), option->needed("\""));
    if (!provenance.unread.empty()) return;
  }
  provenance.options = std::move(options);
}

}  // namespace

std::string provenance_text(const Provenance& provenance) {
  const Json now = json_of(provenance);
  if (provenance.text.empty()) return now.empty() ? std::string() : text_of(now);
  const Json before = json_of(provenance_of(provenance.text));
  if (now == before) return provenance.text;
  Json json = options_json(provenance.text);
  if (!json.is_object()) json = Json::object();
  for (const auto& [key, value] : before.items())
    if (!now.contains(key)) json.erase(key);
  for (const auto& [key, value] : now.items())
    if (!before.contains(key) || before[key] != value) json[key] = value;
  return text_of(json);
}

Provenance provenance_of(const std::string& text, const std::string& program_version) {
  Provenance result;
  result.version = program_version;
  if (text.empty()) return result;
  const Json json = options_json(text);
  if (json.is_object()) {
    read_options(json, result);
    const auto at = [&](const char* key) { return json.value(key, Json()); };
    result.experiments = count_of(at(experiments_key)).value_or(0);
    result.data = texts_of(at(data_key));
    result.dt_stated = at(dt_key) != Json(false);
    result.choices = choices_of(at(choices_key));
    result.refinement = refinement_of(at(refinement_key));
    result.corrections = corrections_of(at(corrections_key));
    result.feedthrough = feedthrough_of(at(feedthrough_key));
  } else {
    result.unread = "options of the model: other text found, the text of a JSON object needed, as identify() writes it";
  }
  if (text_of(json_of(result)) != text) result.text = text;
  return result;
}

}  // namespace tokid::io
