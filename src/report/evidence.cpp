// SPDX-License-Identifier: BSD-3-Clause
#include "evidence.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "tokid/gtv_arx.hpp"

namespace tokid::report {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();
constexpr double arithmetic = 1e-9;  // innovations below this share of the outputs are rounding errors

// Spread of each output about the nominal trajectory, or about its mean: what errors are compared with.
Vector output_spread(const Model& model, const Ensemble& data) {
  Vector spread(data.outputs());
  for (Index j = 0; j < data.outputs(); ++j) {
    double sum = 0.0, squares = 0.0;
    Index count = 0;
    for (Index k = 0; k < data.steps(); ++k)
      for (const double value : data.output(k).col(j)) {
        if (std::isnan(value)) continue;
        const double y = k < model.y_nominal.rows() ? value - model.y_nominal(k, j) : value;
        sum += y;
        squares += y * y;
        ++count;
      }
    const double mean = model.y_nominal.rows() > 0 || count == 0 ? 0.0 : sum / double(count);
    const double variance = count > 0 ? squares / double(count) - mean * mean : 0.0;
    spread(j) = variance > 0 ? std::sqrt(variance) : 1.0;
  }
  return spread;
}

// Root mean square errors, relative to the spread of the outputs, by step or by experiment.
struct Errors {
  std::vector<double> step, experiment;
};

Errors relative_errors(const Ensemble& data, const Ensemble& computed, const Vector& spread) {
  const auto count = [](Index size) { return std::vector<double>(size_t(size), 0.0); };
  std::vector<double> step = count(data.steps()), experiment = count(data.experiments());
  std::vector<double> in_step = step, in_experiment = experiment;
  for (Index k = 0; k < data.steps(); ++k)
    for (Index j = 0; j < data.outputs(); ++j)
      for (Index n = 0; n < data.experiments(); ++n) {
        const double error = (data.y(n, k, j) - computed.y(n, k, j)) / spread(j);
        if (std::isnan(error)) continue;
        step[size_t(k)] += error * error, ++in_step[size_t(k)];
        experiment[size_t(n)] += error * error, ++in_experiment[size_t(n)];
      }
  const auto root = [](std::vector<double>& sum, const std::vector<double>& number) {
    for (size_t i = 0; i < sum.size(); ++i) sum[i] = number[i] > 0 ? std::sqrt(sum[i] / number[i]) : nan;
  };
  root(step, in_step);
  root(experiment, in_experiment);
  return {step, experiment};
}

std::vector<WeakInput> weak_inputs(const Ensemble& data) {
  std::vector<WeakInput> result;
  if (data.experiments() < 3) return result;  // no spread to speak of
  for (Index i = 0; i < data.inputs(); ++i) {
    std::vector<double> spread(size_t(data.steps()), nan);
    for (Index k = 0; k < data.steps(); ++k) {
      double sum = 0.0, squares = 0.0;
      Index count = 0;
      for (const double u : data.input(k).col(i))
        if (!std::isnan(u)) sum += u, ++count;
      if (count < 3) continue;
      const double mean = sum / double(count);
      for (const double u : data.input(k).col(i))
        if (!std::isnan(u)) squares += (u - mean) * (u - mean);
      spread[size_t(k)] = std::sqrt(squares / double(count - 1));
    }
    const double usual = median(spread);
    if (!(usual > 0)) continue;  // at rest most of the time: no usual spread
    WeakInput weak{i, {}, 1.0};
    for (Index k = 0; k < data.steps(); ++k)
      if (spread[size_t(k)] < bounds::weak_input * usual) {
        weak.steps.push_back(k);
        weak.spread = std::min(weak.spread, spread[size_t(k)] / usual);
      }
    if (!weak.steps.empty()) result.push_back(weak);
  }
  return result;
}

bool is_noisy(const Prediction& prediction, const Model& model, const Ensemble& data) {
  double innovation = 0.0, output = 0.0;
  for (Index k = 0; k < data.steps(); ++k)
    for (Index j = 0; j < data.outputs(); ++j)
      for (Index n = 0; n < data.experiments(); ++n) {
        const double e = prediction.innovations[size_t(k)](n, j);
        if (std::isnan(e)) continue;
        const double y = data.y(n, k, j) - (k < model.y_nominal.rows() ? model.y_nominal(k, j) : 0.0);
        innovation += e * e;
        output += y * y;
      }
  return innovation > arithmetic * arithmetic * output;
}

std::vector<std::string> differences(const Model& model, const Ensemble& data) {
  std::vector<std::string> result;
  if (std::abs(model.dt - data.dt) > 1e-6 * model.dt)
    result.push_back(fmt::format("The sample time of the data is {} s, that of the model {} s.", data.dt, model.dt));
  const auto compare = [&result](const char* what, const std::vector<std::string>& found,
                                 const std::vector<std::string>& known) {
    if (!found.empty() && !known.empty() && found != known)
      result.push_back(fmt::format("The {} are named {} in the data, {} in the model.", what, fmt::join(found, ", "),
                                   fmt::join(known, ", ")));
  };
  compare("inputs", data.names.input_names, model.names.input_names);
  compare("outputs", data.names.output_names, model.names.output_names);
  return result;
}

void judge_regressions(const Model& model, Evidence& found) {
  found.condition_median = median(model.condition);
  for (const double c : model.condition) found.condition_max = std::max(found.condition_max, c);
  for (size_t s = 0; s < model.condition.size(); ++s) {
    const double c = model.condition[s];
    const bool stands_out =
        found.noisy && c > bounds::worth_a_word && c > bounds::worse_than_usual * found.condition_median;
    if (c > bounds::ill_conditioned || stands_out) found.ill.push_back(model.k_begin + Index(s));
  }
  for (size_t s = 0; s < std::min(model.rank.size(), model.lags.size()); ++s)
    if (model.rank[s] < minimum_experiments(model.inputs, model.outputs, model.lags[s]))
      found.deficient.push_back(model.k_begin + Index(s));
}

void judge_whiteness(Evidence& found) {
  const Whiteness& white = found.validation.whiteness;
  found.correlated = found.validation.whiteness_p < bounds::whiteness;
  for (Index j = 0; j < white.correlation.rows(); ++j)
    for (const double c : white.correlation.row(j)) {
      found.correlated = found.correlated || std::abs(c) > 1.5 * white.bound(j);
      if (std::abs(c) > found.correlation) found.correlation = std::abs(c), found.correlation_lag = j + 1;
    }
}

// Experiments of the identification, where the model has kept their number.
Index identified_from(const Model& model, const ReportOptions& options) {
  if (options.identified_from > 0) return options.identified_from;
  const auto json = nlohmann::json::parse(model.options, nullptr, false);
  if (!json.is_object() || !json.contains("experiments") || !json["experiments"].is_number_integer()) return 0;
  return json["experiments"].get<Index>();
}

}  // namespace

Evidence evidence(const Model& model, const Ensemble& data, const ReportOptions& options) {
  Evidence found;
  found.horizon = std::max<Index>(1, options.horizon);
  ValidateOptions validate_options;
  validate_options.horizon = found.horizon;
  validate_options.initial_state = options.initial_state;
  validate_options.whiteness_lags = 10;
  found.validation = validate(model, data, validate_options);
  found.prediction = predict(model, data, {1, options.initial_state});
  found.simulated = simulate_data(model, data, options.initial_state);
  found.names = model.names;
  const auto complete = [](std::vector<std::string>& names, const std::vector<std::string>& others) {
    if (names.empty()) names = others;
  };
  complete(found.names.input_names, data.names.input_names);
  complete(found.names.output_names, data.names.output_names);
  complete(found.names.input_units, data.names.input_units);
  complete(found.names.output_units, data.names.output_units);
  found.experiments = data.experiments();
  found.missing = data.missing();
  for (const Index length : data.length) found.missing -= (data.steps() - length) * data.channels();
  Index expected = data.samples().size();
  for (const Index length : data.length) expected -= (data.steps() - length) * data.channels();
  found.missing_share = expected > 0 ? double(found.missing) / double(expected) : 0.0;
  found.noisy = is_noisy(found.prediction, model, data);
  if (!model.lags.empty()) {
    found.lags = model.max_lags();
    found.unknowns = minimum_experiments(model.inputs, model.outputs, found.lags);
  }
  found.identified_from = identified_from(model, options);
  judge_regressions(model, found);
  judge_whiteness(found);
  found.weak_inputs = weak_inputs(data);
  found.differences = differences(model, data);

  const Vector spread = output_spread(model, data);
  found.step_error = relative_errors(data, found.prediction.y, spread).step;
  const double usual = median(found.step_error);
  for (size_t k = 0; k < found.step_error.size(); ++k)
    if (found.step_error[k] > bounds::error_floor && found.step_error[k] > bounds::error_peak * usual)
      found.error_peaks.push_back(Index(k));
  found.experiment_error = relative_errors(data, found.simulated, spread).experiment;
  if (!std::isfinite(median(found.experiment_error)))
    found.experiment_error = relative_errors(data, found.prediction.y, spread).experiment;
  return found;
}

double median(std::vector<double> values) {
  values.erase(std::remove_if(values.begin(), values.end(), [](double v) { return !std::isfinite(v); }), values.end());
  if (values.empty()) return nan;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

std::string step_list(const std::vector<Index>& steps) {
  constexpr size_t most_ranges = 6;
  std::vector<std::string> ranges;
  for (size_t i = 0; i < steps.size();) {
    size_t j = i;
    while (j + 1 < steps.size() && steps[j + 1] == steps[j] + 1) ++j;
    ranges.push_back(i == j ? fmt::format("{}", steps[i]) : fmt::format("{}–{}", steps[i], steps[j]));
    i = j + 1;
  }
  std::string text = steps.size() == 1 ? "step " : "steps ";
  if (ranges.size() > most_ranges) {
    ranges.resize(most_ranges);
    return text + fmt::format("{} and more ({} in all)", fmt::join(ranges, ", "), steps.size());
  }
  if (ranges.size() == 1) return text + ranges.front();
  const std::string last = ranges.empty() ? "" : ranges.back();
  if (!ranges.empty()) ranges.pop_back();
  return text + fmt::format("{} and {}", fmt::join(ranges, ", "), last);
}

namespace {

// The figure alone, cut rather than rounded up: 99.97 is not 100.
std::string percent_figure(double fit, int least_digits) {
  if (!std::isfinite(fit)) return "–";
  if (fit < -999) return "below −999";
  const double gap = 100 - fit;
  if (gap < 1e-6) return "100";
  const int digits = std::max(least_digits, gap >= 2 ? 0 : std::clamp(int(std::ceil(-std::log10(gap))), 1, 6));
  const double scale = std::pow(10.0, digits);
  const double cut = std::floor(fit * scale) / scale;
  return cut < 0 ? fmt::format("−{:.{}f}", -cut, digits) : fmt::format("{:.{}f}", cut, digits);
}

}  // namespace

std::string percent(double fit, int digits) { return percent_figure(fit, digits) + (std::isfinite(fit) ? " %" : ""); }

std::string figure(double value, int digits) {
  if (std::isnan(value)) return "–";
  if (std::isinf(value)) return value > 0 ? "∞" : "−∞";
  const double size = std::abs(value);
  if (size == 0 || (size >= 1e-4 && size < 1e5)) {
    // No exponent in this range: a few digits of something large are as many as it has.
    const int integers = size >= 1 ? static_cast<int>(std::log10(size)) + 1 : 1;
    const std::string text = fmt::format("{:.{}g}", size, std::max(digits, integers));
    return value < 0 ? "−" + text : text;
  }
  const std::string text = fmt::format("{:.{}e}", size, digits - 1);
  const size_t e = text.find('e');
  std::string mantissa = text.substr(0, e);
  while (mantissa.find('.') != std::string::npos && (mantissa.back() == '0' || mantissa.back() == '.')) {
    const bool point = mantissa.back() == '.';
    mantissa.pop_back();
    if (point) break;
  }
  static constexpr const char* raised[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  const int exponent = std::stoi(text.substr(e + 1));
  std::string power = exponent < 0 ? "⁻" : "";
  for (const char digit : std::to_string(std::abs(exponent))) power += raised[digit - '0'];
  return fmt::format("{}{}·10{}", value < 0 ? "−" : "", mantissa, power);
}

std::string probability(double p) { return p < 1e-4 ? "p < 0.0001" : fmt::format("p = {:.2g}", p); }

std::string percent_range(const Vector& fits) {
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (const double fit : fits)
    if (std::isfinite(fit)) least = std::min(least, fit), most = std::max(most, fit);
  if (least > most) return "–";
  const std::string a = percent_figure(least, 0), b = percent_figure(most, 0);
  if (a == b) return a + " %";
  // A dash after a minus sign is hard to read.
  return fmt::format("{}{}{} %", a, least < 0 ? " to " : "–", b);
}

std::string plural(Index count, std::string_view noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

}  // namespace tokid::report
