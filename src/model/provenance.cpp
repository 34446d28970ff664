// SPDX-License-Identifier: BSD-3-Clause
#include "model/provenance.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <utility>

namespace tokid {

namespace provenance {

bool is_key(std::string_view key) {
  constexpr std::string_view keys[] = {experiments_key, data_key, choices_key, refined_key, dt_key};
  return std::find(std::begin(keys), std::end(keys), key) != std::end(keys);
}

Json of(const Model& model) {
  Json json = options_json(model.options);
  return json.is_object() ? json : Json::object();
}

Json penalty(double smoothing) {
  if (std::isnan(smoothing)) return "nan";
  return smoothing == std::numeric_limits<double>::infinity() ? Json("infinity") : Json(smoothing);
}

std::optional<double> penalty(const Json& value) {
  if (value == "infinity") return std::numeric_limits<double>::infinity();
  if (!value.is_number() || !(value.get<double>() >= 0)) return std::nullopt;
  return value.get<double>();
}

}  // namespace provenance

void note_data(Model& model, const std::string& fingerprint) {
  Json json = provenance::of(model);
  Json& list = json[provenance::data_key];
  if (!list.is_array()) list = Json::array();
  if (std::find(list.begin(), list.end(), fingerprint) == list.end()) list.push_back(fingerprint);
  model.options = text_of(json);
}

bool has_seen(const Model& model, const Ensemble& data) {
  const Json json = provenance::of(model);
  const auto list = json.find(provenance::data_key);
  return list != json.end() && std::find(list->begin(), list->end(), fingerprint(data)) != list->end();
}

void note_update(Model& model, Index experiments) {
  Json json = provenance::of(model);
  json[provenance::experiments_key] = experiments;
  json.erase(provenance::refined_key);
  model.options = text_of(json);
}

void note_refinement(Model& model, double smoothing, Index iterations) {
  Json json = provenance::of(model);
  json[provenance::refined_key] = {{"smoothing", provenance::penalty(smoothing)}, {"iterations", iterations}};
  model.options = text_of(json);
}

void note_missing_dt(Model& model) {
  Json json = provenance::of(model);
  json[provenance::dt_key] = false;
  model.options = text_of(json);
}

bool states_dt(const Model& model) {
  return provenance::of(model).value(provenance::dt_key, Json(true)) != Json(false);
}

std::optional<double> refinement_smoothing(const Model& model) {
  const Json json = provenance::of(model);
  const auto refined = json.find(provenance::refined_key);
  return refined != json.end() && refined->is_object() ? provenance::penalty(refined->value("smoothing", Json()))
                                                       : std::nullopt;
}

}  // namespace tokid
