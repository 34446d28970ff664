// SPDX-License-Identifier: BSD-3-Clause
#include "model/options.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace tokid {

namespace {

constexpr Index largest_count = 1'000'000, last_step = 1'000'000'000;

// The values of an option, and their JSON.
template <class T>
struct Values {
  std::string placeholder = {};  // empty: one of the words
  std::string range = {};        // empty: no numbers
  std::vector<std::string> words = {};
  std::function<Json(const T&)> write = {};
  std::function<std::optional<T>(const Json&)> read = {};  // empty: not one of the values
};

template <class T>
Values<T> one_of(const std::vector<std::pair<std::string, T>>& all) {
  Values<T> v;
  for (const auto& [word, meaning] : all) v.words.push_back(word);
  v.write = [all](const T& value) {
    const auto found = std::find_if(all.begin(), all.end(), [&](const auto& entry) { return entry.second == value; });
    return found == all.end() ? Json() : Json(found->first);
  };
  v.read = [all](const Json& json) {
    const auto found = std::find_if(all.begin(), all.end(), [&](const auto& entry) { return json == entry.first; });
    return found == all.end() ? std::nullopt : std::optional(found->second);
  };
  return v;
}

Values<bool> yes_or_no() {
  Values<bool> v = one_of<bool>({{"yes", true}, {"no", false}});
  v.read = [word = v.read](const Json& json) { return json.is_boolean() ? json.get<bool>() : word(json); };
  return v;
}

Values<Index> whole(const char* placeholder, Index least, Index largest) {
  return {.placeholder = placeholder,
          .range = fmt::format("a whole number from {} to {}", least, largest),
          .write = [](Index value) { return Json(value); },
          .read = [=](const Json& json) -> std::optional<Index> {
            if (!json.is_number_integer() || json < least || json > largest) return std::nullopt;
            return json.get<Index>();
          }};
}

Values<Index> period_of_steps() {
  Values<Index> v = whole("P", 0, largest_count);
  v.words = {"invariant"};
  v.read = [number = v.read](const Json& json) { return json == "invariant" ? 1 : number(json); };
  return v;
}

Values<double> penalties() {
  return {.placeholder = "L",
          .range = "a number from 0 on",
          .words = {"infinity"},
          .write = [](double value) { return penalty(value); },
          .read = [](const Json& json) { return penalty(json == "inf" ? Json("infinity") : json); }};
}

// A list, a single value, or a text of values with commas. Not a list if the text has other values than JSON.
Json list_of(const Json& json) {
  if (json.is_string()) return Json::parse(fmt::format("[{}]", json.get<std::string>()), nullptr, false);
  return json.is_array() ? json : Json::array({json});
}

// Whole numbers from `least` to `last_step`.
std::optional<std::vector<Index>> numbers_of(const Json& json, Index least, bool ascending) {
  const Json list = list_of(json);
  if (!list.is_array() || list.empty()) return std::nullopt;
  std::vector<Index> numbers;
  for (const Json& entry : list) {
    if (!entry.is_number_integer() || entry < least || entry > last_step) return std::nullopt;
    if (ascending && !numbers.empty() && entry <= numbers.back()) return std::nullopt;
    numbers.push_back(entry.get<Index>());
  }
  return numbers;
}

// The same, or none.
Values<std::vector<Index>> numbers_or_none(const char* placeholder, const std::string& range, Index least,
                                           bool ascending) {
  return {.placeholder = placeholder,
          .range = range,
          .words = {"none"},
          .write = [](const std::vector<Index>& all) { return all.empty() ? Json("none") : Json(all); },
          .read = [=](const Json& json) -> std::optional<std::vector<Index>> {
            if (json == "none") return std::vector<Index>{};
            return numbers_of(json, least, ascending);
          }};
}

Values<std::vector<Index>> ascending_steps() {
  return numbers_or_none("K[,K...]|none", fmt::format("ascending steps from 1 to {}", last_step), 1, true);
}

Values<std::vector<Index>> delays_of_inputs() {
  return numbers_or_none("D[,D...]|none", fmt::format("a number of steps from 0 to {} for each input", last_step), 0,
                         false);
}

Values<std::vector<Index>> horizons_from_one() {
  return {.placeholder = "1[,H...]",
          .range = "1 and further numbers of steps, ascending",
          .write = [](const std::vector<Index>& horizons) { return Json(horizons); },
          .read =
              [](const Json& json) {
                std::optional<std::vector<Index>> horizons = numbers_of(json, 1, true);
                return horizons && horizons->front() == 1 ? horizons : std::nullopt;
              }};
}

std::optional<std::vector<double>> output_weights_of(const Json& json) {
  if (json == "equal") return std::vector<double>{};
  const Json list = list_of(json);
  if (!list.is_array()) return std::nullopt;
  std::vector<double> weights;
  for (const Json& entry : list) {
    if (!entry.is_number() || !(entry >= 0) || !std::isfinite(entry.get<double>())) return std::nullopt;
    weights.push_back(entry.get<double>());
  }
  const bool any = std::any_of(weights.begin(), weights.end(), [](double weight) { return weight > 0; });
  return any ? std::optional(weights) : std::nullopt;
}

Values<std::vector<double>> output_weights() {
  const auto write = [](const std::vector<double>& weights) {
    Json list = Json::array();
    for (const double weight : weights) list.push_back(penalty(weight));  // a word if it is not a number
    return weights.empty() ? Json("equal") : list;
  };
  return {.placeholder = "W,W[,W...]|equal",
          .range = "a number from 0 on for each output (not all 0)",
          .words = {"equal"},
          .write = write,
          .read = output_weights_of};
}

Values<double> fraction() {
  return {.placeholder = "FRACTION",
          .range = "a number from 0 to below 1",
          .write = [](double value) { return Json(value); },
          .read = [](const Json& json) -> std::optional<double> {
            if (!json.is_number() || !(json >= 0 && json < 1)) return std::nullopt;
            return json.get<double>();
          }};
}

// The values of an option that also accepts "auto": the identification then chooses the value.
template <class T>
Values<std::optional<T>> or_auto(const Values<T>& given) {
  Values<std::optional<T>> v{given.placeholder, given.range, given.words};
  if (!v.placeholder.empty()) v.placeholder += "|auto";
  v.words.insert(v.range.empty() ? v.words.begin() : v.words.end(), "auto");
  v.write = [write = given.write](const std::optional<T>& value) { return value ? write(*value) : Json("auto"); };
  v.read = [read = given.read](const Json& json) -> std::optional<std::optional<T>> {
    if (json == "auto") return std::optional<T>();
    if (const std::optional<T> value = read(json)) return value;
    return std::nullopt;
  };
  return v;
}

template <class T>
Option option(const char* key, T IdentifyOptions::*field, const Values<T>& values, const char* help,
              const char* opposite = "") {
  return {.key = key,
          .value = values.placeholder.empty() ? fmt::format("{}", fmt::join(values.words, "|")) : values.placeholder,
          .range = values.range,
          .words = values.words,
          .help = help,
          .opposite = opposite,
          .write = [=](const IdentifyOptions& options) { return values.write(options.*field); },
          .read =
              [=](IdentifyOptions& options, const Json& json) {
                const std::optional<T> value = values.read(json);
                if (value) options.*field = *value;
                return value.has_value();
              }};
}

// The options are in the order of the text in models.
std::vector<Option> table() {
  using O = IdentifyOptions;
  const Values<std::optional<Index>> count = or_auto(whole("N", 1, largest_count));
  return {
      option("states", &O::states, count,
             "State dimension n (auto: the rank of the Hankel matrices, or by cross-validation if the data are noisy)"),
      option("lags", &O::lags, count, "Lag order p (auto: the smallest leave-one-out error)"),
      option("method", &O::method,
             or_auto(one_of<Method>(
                 {{"tvera", Method::tvera}, {"subspace", Method::subspace}, {"regression", Method::regression}})),
             "Method of the realisation (auto: tvera without noise from zero initial states, else subspace, or the "
             "regression itself with all its states if that predicts better)"),
      option("smoothing", &O::smoothing, or_auto(penalties()),
             "Penalty lambda on variation over time: 0: no penalty, infinity: one model (auto: by cross-validation)"),
      option("feedthrough", &O::feedthrough, or_auto(yes_or_no()),
             "Outputs respond to the inputs of the same step (auto: by a test, yes for data without noise)",
             "D = 0 at all steps"),
      option("period", &O::period, period_of_steps(), "Steps k, k+P, k+2P, ... share one model"),
      option("jumps", &O::jumps, or_auto(ascending_steps()),
             "Steps at which the matrices jump (auto: found by cross-validation)"),
      option("delays", &O::delays, or_auto(delays_of_inputs()),
             "Dead times of the inputs in steps (auto: found by cross-validation, unless states or lags are given)"),
      option("weighting", &O::weighting,
             or_auto(one_of<Weighting>({{"one-step", Weighting::one_step},
                                        {"many-steps", Weighting::many_steps},
                                        {"projection", Weighting::projection}})),
             "Outputs that the states explain best (auto: by cross-validation); projection: PO-MOESP"),
      option("output_weights", &O::output_weights, output_weights(),
             "Weights of the outputs in the choices and in the selection of the states (default equal)"),
      option("horizons", &O::horizons, horizons_from_one(),
             "Steps ahead of the predictions whose errors choose states, EM and regressions (default 1,5,20)"),
      option("refine", &O::refine, or_auto(yes_or_no()),
             "Refine by EM (maximum likelihood) if that lowers the cross-validation error (default for noisy data, "
             "except for one model of a long record)",
             "Do not refine by EM"),
      option("initial_state", &O::initial_state,
             or_auto(one_of<InitialState>({{"zero", InitialState::zero}, {"unknown", InitialState::unknown}})),
             "States at step 0 (auto: as the data state, else by a test)"),
      option("nominal", &O::nominal,
             or_auto(one_of<NominalChoice>({{"none", NominalChoice::none}, {"mean", NominalChoice::mean}})),
             "Mean motion to remove (auto: the mean if it is significant)"),
      option("frame", &O::frame,
             one_of<Frame>({{"raw", Frame::raw}, {"reference", Frame::reference}, {"smooth", Frame::smooth}}),
             "Coordinates of the states (default raw)"),
      option("reference_step", &O::reference_step, or_auto(whole("S", 0, last_step)),
             "Step of the reference frame (auto: the first step of full state dimension)"),
      option("hold_out", &O::hold_out, fraction(), "Share of the experiments kept for validation (default 0)"),
      option("outliers", &O::outliers,
             one_of<OutlierChoice>({{"keep", OutlierChoice::keep},
                                    {"drop", OutlierChoice::drop},
                                    {"downweight", OutlierChoice::downweight}}),
             "Experiments and samples that do not fit: use them (default), leave them out, or let them count less"),
      option("rows", &O::rows, count,
             "Block rows of the Hankel matrices of tvera (auto: as many as lags and states need)"),
      option("cols", &O::cols, count,
             "Block columns of the Hankel matrices of tvera (auto: the same, and more with noise)"),
  };
}

}  // namespace

Json penalty(double smoothing) {
  if (std::isnan(smoothing)) return "nan";
  return smoothing == std::numeric_limits<double>::infinity() ? Json("infinity") : Json(smoothing);
}

std::optional<double> penalty(const Json& value) {
  if (value == "infinity") return std::numeric_limits<double>::infinity();
  if (!value.is_number() || !(value.get<double>() >= 0)) return std::nullopt;
  return value.get<double>();
}

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
    const Json found = option.write(options);
    IdentifyOptions read;
    if (option.read(read, found)) continue;
    throw std::invalid_argument(fmt::format("{}: {} found, {} needed", option.key,
                                            found.is_string() ? found.get<std::string>() : text_of(found),
                                            option.needed()));
  }
}

}  // namespace tokid
