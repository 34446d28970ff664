// SPDX-License-Identifier: BSD-3-Clause
#include "report/verdict_json.hpp"

#include <cmath>

namespace tokid {

namespace {

Json json_of(const CheckFigure& figure) {
  Json j = {{"name", figure.name},
            {"values", figure.values},
            {"rule", to_string(figure.rule)},
            {"bound", figure.bound},
            {"kept", figure.kept()}};
  if (!std::isnan(figure.distrust)) j["distrust"] = figure.distrust;
  return j;
}

}  // namespace

Json json_of(const VerdictCheck& check) {
  const CheckWords words = in_words(check);
  Json j = {{"name", to_string(check.kind)},
            {"subject", words.subject},
            {"found", words.found},
            {"needed", words.needed},
            {"result", check.result ? Json(to_string(*check.result)) : Json()},
            {"untested", check.untested ? Json(to_string(*check.untested)) : Json()},
            {"figures", Json::array()},
            {"one_suffices", check.one_suffices},
            {"numbers", Json::object()},
            {"reasons", Json::array()}};
  for (const CheckFigure& figure : check.figures) j["figures"].push_back(json_of(figure));
  for (const auto& [name, value] : check.numbers) j["numbers"][name] = value;
  for (const VerdictReason& reason : check.reasons)
    j["reasons"].push_back({{"trust", to_string(reason.trust)}, {"text", reason.text}});
  if (check.reason) j["conclusion"] = to_string(*check.reason);
  if (check.experiment)
    j["experiment"] = {{"row", check.experiment->row},
                       {"name", check.experiment->name.empty() ? Json() : Json(check.experiment->name)}};
  return j;
}

Json json_of(const std::vector<VerdictCheck>& checks) {
  Json list = Json::array();
  for (const VerdictCheck& check : checks) list.push_back(json_of(check));
  return list;
}

Json json_of(const Verdict& verdict) {
  return {{"trust", to_string(verdict.trust)},
          {"summary", verdict.summary},
          {"reasons", verdict.reasons},
          {"horizon", verdict.horizon}};
}

Json with_checks(const Verdict& verdict) {
  Json j = json_of(verdict);
  j["checks"] = json_of(verdict.checks);
  return j;
}

}  // namespace tokid
