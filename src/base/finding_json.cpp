// SPDX-License-Identifier: BSD-3-Clause
#include "base/finding_json.hpp"

namespace tokid {

namespace {

Json json_of(const Finding::Channel& channel) {
  return {{"side", channel.output ? "output" : "input"}, {"index", channel.index}, {"name", channel.name}};
}

Json json_of(const Finding::Experiment& experiment) {
  return {{"row", experiment.row}, {"name", experiment.name.empty() ? Json() : Json(experiment.name)}};
}

Json json_of(const Finding::Term& term) {
  return {{"channel", json_of(term.channel)}, {"lag", term.lag}, {"factor", term.factor}};
}

template <class T>
Json list(const std::vector<T>& values) {
  Json result = Json::array();
  for (const T& value : values) result.push_back(json_of(value));
  return result;
}

Json object(const std::map<std::string, double>& numbers) {
  Json result = Json::object();
  for (const auto& [name, value] : numbers) result[name] = value;
  return result;
}

Json json_of(const Conclusion& conclusion) {
  Json j = {{"result", to_string(conclusion.result)},
            {"reason", to_string(conclusion.reason)},
            {"channels", list(conclusion.channels)},
            {"numbers", object(conclusion.numbers)},
            {"pooled", conclusion.pooled},
            {"text", in_words(conclusion)}};
  if (!conclusion.channels.empty()) {
    j["errors"] = conclusion.errors;
    j["intervals"] = conclusion.intervals;
  }
  return j;
}

}  // namespace

Json json_of(const Finding& finding) {
  Json j = {{"kind", to_string(finding.kind)},          {"severity", to_string(severity(finding.kind))},
            {"scope", to_string(finding.scope)},        {"channels", list(finding.channels)},
            {"experiments", list(finding.experiments)}, {"steps", finding.steps},
            {"numbers", object(finding.numbers)},       {"text", in_words(finding)}};
  if (!finding.terms.empty()) j["terms"] = list(finding.terms);
  if (!finding.names.empty()) j["names"] = finding.names;
  if (!finding.groups.empty()) {
    j["groups"] = Json::array();
    for (const auto& group : finding.groups) j["groups"].push_back(list(group));
  }
  if (!finding.detail.empty()) j["detail"] = finding.detail;
  if (!finding.file.empty()) j["file"] = finding.file;
  return j;
}

Json json_of(const Findings& findings) { return list(findings); }

Json json_of(const std::vector<FindingChannel>& channels) { return list(channels); }

Json json_of(const Conclusions& conclusions) {
  Json j = Json::object();
  for (const Conclusion& conclusion : conclusions.all()) j[to_string(conclusion.test)] = json_of(conclusion);
  return j;
}

}  // namespace tokid
