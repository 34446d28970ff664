// The checks of a verdict in words, from their figures.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>
#include <utility>

#include "base/nan.hpp"
#include "diagnose/conclusions.hpp"
#include "model/comparison.hpp"
#include "report/bounds.hpp"
#include "report/evidence.hpp"
#include "tokid/report.hpp"

namespace tokid {

bool CheckFigure::kept() const {
  bool known = false;
  for (const double value : values) {
    if (std::isnan(value)) continue;
    known = true;
    const bool keeps = rule == Rule::at_least ? value >= bound : rule == Rule::at_most ? value <= bound : value < bound;
    if (!keeps) return false;
  }
  return known;
}

const char* to_string(CheckFigure::Rule rule) {
  return rule == CheckFigure::Rule::at_least ? "at least" : rule == CheckFigure::Rule::at_most ? "at most" : "below";
}

bool VerdictCheck::kept() const {
  const auto keeps = [](const CheckFigure& figure) { return figure.kept(); };
  return one_suffices ? std::any_of(figures.begin(), figures.end(), keeps)
                      : std::all_of(figures.begin(), figures.end(), keeps);
}

namespace report {

namespace {

using CheckKind = VerdictCheck::Kind;
using Untested = VerdictCheck::Untested;
using Reason = Conclusion::Reason;

struct UntestedWords {
  Untested reason;
  const char *name, *text;  // innovations and few_errors have texts of their own
};
constexpr UntestedWords untested_words[] = {
    {Untested::no_predictions, "no_predictions", "no predictions"},
    {Untested::no_varying_output, "no_varying_output", "no output varies over the predicted steps"},
    {Untested::no_cross_validation, "no_cross_validation", "no cross-validation"},
    {Untested::few_errors, "few_errors", ""},
    {Untested::no_covariance, "no_covariance", "the model states no covariance"},
    {Untested::uncertain_covariance, "uncertain_covariance", "no covariance that is certain enough"},
    {Untested::unknown_experiments, "unknown_experiments", "not known"},
    {Untested::no_lag_order, "no_lag_order", "the model has no lag order"},
    {Untested::without_noise, "without_noise", "data without noise"},
    {Untested::no_regressions, "no_regressions", "the model has no condition numbers"},
    {Untested::no_inputs, "no_inputs", "the model has no inputs"},
    {Untested::few_input_samples, "few_input_samples", "too few samples of the inputs"},
    {Untested::no_ranks, "no_ranks", "the model has no ranks"},
    {Untested::no_probability, "no_probability", "too few samples for a probability"},
    {Untested::dependent_inputs, "dependent_inputs", "the inputs follow from other samples"},
    {Untested::innovations, "innovations", ""}};

const UntestedWords& words_of(Untested reason) {
  return *std::find_if(std::begin(untested_words), std::end(untested_words),
                       [&](const UntestedWords& one) { return one.reason == reason; });
}

// Makes the words of one check.
class Words {
 public:
  explicit Words(const VerdictCheck& check) : check_(check) {}

  CheckWords words() const {
    CheckWords result = tested();
    if (check_.untested) result.found = untested(*check_.untested);
    return result;
  }

 private:
  const CheckFigure& figure_of(size_t i) const { return check_.figures.at(i); }
  double bound() const { return figure_of(0).bound; }
  // The single value of a figure; NaN if it is not known.
  double value(size_t i = 0) const { return figure_of(i).values.empty() ? nan : figure_of(i).values.front(); }
  double number(const char* key) const { return check_.numbers.at(key); }
  Index count(const char* key) const { return Index(number(key)); }
  std::string known(const std::string& text) const { return std::isnan(value()) ? "not known" : text; }

  std::string untested(Untested reason) const {
    if (reason == Untested::few_errors) {
      const char* noun = check_.kind == CheckKind::outliers ? "experiment" : "step";
      if (count("count") == 0) return "no errors known";
      return fmt::format("errors of {} only, at least {} needed", plural(count("count"), noun), count("fewest"));
    }
    if (reason == Untested::few_input_samples && number("over_time") == 0)
      return "samples of fewer than 3 experiments at every step";
    if (reason == Untested::without_noise && check_.kind == CheckKind::rank)
      return plural(Index(value()), "step") + ", which is usual without noise";
    if (reason == Untested::innovations) {
      Conclusion conclusion;
      conclusion.test = test();
      conclusion.reason = reason_of_test();
      return in_words(conclusion);
    }
    return words_of(reason).text;
  }

  Conclusion::Test test() const {
    using Test = Conclusion::Test;
    return check_.kind == CheckKind::whiteness      ? Test::whiteness
           : check_.kind == CheckKind::independence ? Test::independence
           : check_.kind == CheckKind::gains        ? Test::gains
                                                    : Test::nis;
  }
  Reason reason_of_test() const {
    if (!check_.reason)
      throw std::invalid_argument(
          fmt::format("check: {} without a reason found, needed is that of its conclusion", to_string(check_.kind)));
    return *check_.reason;
  }

  static std::string count_of(Index some, Index all, std::string_view noun) {
    return fmt::format("{} of {}", some, plural(all, noun));
  }
  std::string at_step() const {
    return std::isnan(value()) ? "not known" : fmt::format("{} at step {}", figure(value(), 3), count("step"));
  }
  std::string fits() const {
    const std::vector<double>& values = figure_of(0).values;
    std::string text = percent_range(Eigen::Map<const Vector>(values.data(), Index(values.size())));
    if (check_.one_suffices) {
      const std::vector<double>& ratios = figure_of(1).values;
      text += fmt::format("; errors {} times those of an exact model",
                          figure(*std::max_element(ratios.begin(), ratios.end()), 3));
    }
    return text;
  }
  std::string fits_needed() const {
    std::string text = fmt::format("{:.0f} % or more for every output", bound());
    if (check_.one_suffices)
      text += fmt::format(", or errors at most {:.2f} times those of an exact model", figure_of(1).bound);
    return text;
  }

  CheckWords tested() const {
    switch (check_.kind) {
      case CheckKind::outputs:
        return {"Outputs that vary and have samples to compare",
                figure_of(0).values.empty() ? "no samples" : count_of(Index(value()), Index(bound()), "output"), "all"};
      case CheckKind::one_step_fit:
        return {"One-step prediction fit", fits(), fits_needed()};
      case CheckKind::simulation_fit:
        return {"Simulation fit, which decides the verdict", fits(), fits_needed()};
      case CheckKind::prediction_fit:
        return {fmt::format("Prediction fit {} ahead, which decides the verdict", plural(count("horizon"), "step")),
                fits(), fits_needed()};
      case CheckKind::input_effect:
        return {"Effect of the inputs on the predictions, relative to the prediction error", figure(value(), 3),
                fmt::format("{:.1f} or more", bound())};
      case CheckKind::regression: {
        const std::vector<double>& ratios = figure_of(0).values;
        const auto most = std::max_element(ratios.begin(), ratios.end());
        return {"Largest error in cross-validation, relative to that of a regression",
                most == ratios.end() ? "not known" : figure(*most, 3),
                fmt::format("{:.2f} or less at every horizon", bound())};
      }
      case CheckKind::error_peaks:
        return {"Largest one-step error of a step, relative to its limit", at_step(),
                fmt::format(
                    "{:.0f} or less; the limit is the largest of {:.0f} times the median, the largest value by chance, "
                    "{:.0f} % of the spread of the outputs and {:.0f} times what the model states",
                    bound(), bounds::error_peak, 100 * bounds::error_floor, bounds::error_stated)};
      case CheckKind::beyond_noise:
        return {"Largest one-step error of a step, relative to that of the identification", at_step(),
                fmt::format("{:.0f} or less", bound())};
      case CheckKind::outliers:
        return {"Largest error of an experiment, relative to its limit",
                check_.experiment ? fmt::format("{} at experiment {}", figure(value(), 3),
                                                words::experiment(check_.experiment->row, check_.experiment->name))
                                  : "not known",
                fmt::format("{:.0f} or less; the limit is the larger of {:.0f} times the median and {:.0f} % of the "
                            "spread of the outputs",
                            bound(), outlying_experiment, 100 * least_outlying_error)};
      case CheckKind::coverage:
        return {"Steps of the model that the data test", count_of(count("tested"), count("steps"), "step"),
                fmt::format("{:.0f} % or more", 100 * bound())};
      case CheckKind::samples:
        return {
            "Experiments of the identification for each unknown", known(figure(value(), 3)),
            fmt::format(
                "{:.0f} or more{}", bound(),
                number("training") > 0 ? ", because the model is tested on the data that it was identified from" : "")};
      case CheckKind::missing:
        return {"Missing samples", value() == 0 ? "none" : fmt::format("{} %", figure(100 * value(), 2)),
                fmt::format("{:.0f} % or less", 100 * bound())};
      case CheckKind::experiments:
        return {"Experiments tested", fmt::format("{:.0f}", value()), fmt::format("{:.0f} or more", bound())};
      case CheckKind::condition:
        return {"Largest condition number of a regression", figure(value(), 3),
                fmt::format("{} or less", figure(bound(), 3))};
      case CheckKind::inputs:
        return inputs();
      case CheckKind::rank:
        return {"Regressions without full rank", plural(Index(known_count()), "step"),
                fmt::format("{:.0f} or fewer, the lag order", bound())};
      case CheckKind::channels:
        return {"Sample time and names of the channels",
                value() == 0 ? "those of the model" : plural(Index(value()), "difference"), "those of the model"};
      case CheckKind::whiteness:
      case CheckKind::independence:
      case CheckKind::gains:
      case CheckKind::nis:
        break;
    }
    return innovations();
  }

  double known_count() const { return std::isnan(value()) ? 0.0 : value(); }

  CheckWords inputs() const {
    const Index assessed = Index(bound()), others = count("inputs") - assessed;
    std::string found = check_.untested ? "" : count_of(Index(value()), assessed, "input");
    if (others > 0) found += fmt::format(", too few samples of {}", plural(others, "other input"));
    for (const CheckFigure& figure : check_.figures)
      if (figure.name == "dependent" && !figure.kept())
        found +=
            fmt::format(", of which {} from other samples", figure.values.front() > 1 ? "some follow" : "one follows");
    if (number("over_time") > 0) return {"Inputs that vary over time or between the experiments", found, "all"};
    return {"Inputs that vary between the experiments at every step", found,
            fmt::format(
                "all, with a spread of {:.0f} % or more of the median of all steps. A smaller spread does not count "
                "if chance explains it (expected at {} steps or more)",
                100 * bounds::weak_input, bounds::chance)};
  }

  CheckWords innovations() const {
    const auto [subject, rule] = [&]() -> std::pair<const char*, const char*> {
      switch (test()) {
        case Conclusion::Test::whiteness:
          return {"Whiteness of the innovations", "no correlation in time"};
        case Conclusion::Test::independence:
          return {"Inputs and innovations", "no correlation with past and present inputs"};
        case Conclusion::Test::gains:
          return {"Effects of the inputs", "those of the model"};
        default:
          return {"Squared innovations", "those that the model states"};
      }
    }();
    if (check_.untested) return {subject, "", rule};
    const auto [found, needed] = decided();
    return {subject, found, needed};
  }

  static std::string share(double value) {
    return std::isfinite(value) ? fmt::format("{} %", figure(100 * value, 3)) : std::string("all");
  }

  // The figures that decided a test of the innovations, and their bounds. The reason of the conclusion selects the
  // words, so that they state the rule that decided.
  std::pair<std::string, std::string> decided() const {
    const auto by_chance = [&] { return fmt::format("p of {} or more", figure_of(0).bound); };
    const auto small = [&](size_t i) { return fmt::format("a correlation below {:.1f}", figure_of(i).bound); };
    switch (reason_of_test()) {
      case Reason::white:
      case Reason::inputs_explain_nothing:
        return {probability(value()), by_chance()};
      case Reason::correlated:
      case Reason::inputs_explain_part:
        return {fmt::format("{}, correlation {}", probability(value()), figure(value(1), 3)),
                fmt::format("{}, or {}", by_chance(), small(1))};
      case Reason::correlated_on_average:
        return {fmt::format("correlation {} on average over the steps, beyond its bound", figure(value(), 3)),
                fmt::format("no correlation beyond 1.5 times its bound, or {}", small(0))};
      case Reason::gains_unknown:
        return {fmt::format("99 % interval of ± {} of the simulated outputs", share(value())),
                fmt::format("± {:.0f} % or less", 100 * bound())};
      case Reason::gains_wrong:
        return {fmt::format("significant error of {} of the simulated outputs", share(value())),
                fmt::format("no significant error, or one below {:.0f} %", 100 * bound())};
      case Reason::gains_lost_in_noise:
        return {fmt::format("99 % interval of ± {} of the simulated outputs, no significant error", share(value())),
                fmt::format("± {:.0f} % or less, and no significant error of {:.0f} % or more", 100 * bound(),
                            100 * figure_of(1).bound)};
      case Reason::gains_confirmed:
        return {fmt::format("99 % interval of ± {} of the effect, no significant error", share(number("interval"))),
                fmt::format("no significant error of {:.0f} % of the simulated outputs or more", 100 * bound())};
      default:
        return {
            fmt::format("{} times the stated covariance, {}", figure(value(), 3), probability(number("p"))),
            fmt::format("{:.0f} times the stated covariance or less, for p {} {}{}", bound(),
                        number("p") >= unlikely ? "of" : "below", unlikely, number("p") >= unlikely ? " or more" : "")};
    }
  }

  const VerdictCheck& check_;
};

// The gains have their figures as shares of the simulated output. `gains`: of all inputs of the model.
void add_gains(VerdictCheck& check, const Conclusion& c, const InputGains& gains) {
  using Rule = CheckFigure::Rule;
  double error = 0.0, interval = 0.0;  // the largest ones, as shares of the simulated output
  for (size_t i = 0; i < c.channels.size(); ++i) {
    const double share = std::min(1.0, gains.share(c.channels[i].index));
    error = std::max(error, std::abs(c.errors[i]) * share);
    interval = std::max(interval, share > 0 ? c.intervals[i] * share : 0.0);
  }
  if (c.reason == Reason::gains_unknown || c.reason == Reason::gains_lost_in_noise)
    check.figures.push_back({"interval", {interval}, Rule::at_most, counts::gain_unknown});
  if (c.reason != Reason::gains_unknown)
    check.figures.push_back(
        {"significant_error", {c.reason == Reason::gains_wrong ? error : 0.0}, Rule::below, counts::gain});
  if (c.reason == Reason::gains_confirmed) check.numbers["interval"] = c.numbers.at("interval");
}

// Does the effect of an input differ by so much from that of the model, also at the end of its interval?
bool has_false_effect(const Conclusion& c) {
  for (size_t i = 0; c.reason == Reason::gains_wrong && i < c.channels.size(); ++i)
    if (std::abs(c.errors[i]) - c.intervals[i] > bounds::false_effect) return true;
  return false;
}

CheckKind kind_of(Conclusion::Test test) {
  using Test = Conclusion::Test;
  return test == Test::whiteness      ? CheckKind::whiteness
         : test == Test::independence ? CheckKind::independence
         : test == Test::gains        ? CheckKind::gains
                                      : CheckKind::nis;
}

VerdictCheck check_of(const Conclusion& c, const Validation& v) {
  using Rule = CheckFigure::Rule;
  VerdictCheck check;
  check.kind = kind_of(c.test);
  check.reason = c.reason;
  if (c.result == TestResult::untested) {
    check.untested = Untested::innovations;
    return check;
  }
  if (const auto p = c.numbers.find("p"); p != c.numbers.end() && std::isnan(p->second)) {
    check.untested = Untested::no_probability;
    return check;
  }
  const auto number = [&](const char* key) { return c.numbers.at(key); };
  const auto by_chance = [&] { return CheckFigure{"p", {number("p")}, Rule::at_least, unlikely}; };
  const auto small = [&] { return CheckFigure{"correlation", {number("correlation")}, Rule::below, number("limit")}; };
  if (c.test == Conclusion::Test::gains) {
    add_gains(check, c, v.gains);
  } else if (c.test == Conclusion::Test::nis) {
    const bool chance = number("p") >= unlikely;
    check.figures = {
        {"ratio", {number("ratio")}, Rule::at_most, chance ? NormalisedSquares::wild : counts::overconfident}};
    check.numbers = {{"p", number("p")}};
  } else if (c.reason == Reason::white || c.reason == Reason::inputs_explain_nothing) {
    check.figures = {by_chance()};
  } else if (c.reason == Reason::correlated_on_average) {
    check.figures = {small()};
    check.numbers = {{"p", number("p")}};
  } else {
    check.figures = {by_chance(), small()};
    check.one_suffices = true;
  }
  check.result = c.result != TestResult::against ? Trust::good
                 : has_false_effect(c)           ? Trust::distrust
                                                 : Trust::look_closer;
  if (check.result != Trust::good)
    check.reasons.push_back({*check.result, fmt::format("{}: {}.", in_words(check).subject, in_words(c))});
  return check;
}

}  // namespace

}  // namespace report

const char* to_string(VerdictCheck::Kind kind) {
  using Kind = VerdictCheck::Kind;
  switch (kind) {
    case Kind::outputs:
      return "outputs";
    case Kind::one_step_fit:
      return "one_step_fit";
    case Kind::simulation_fit:
      return "simulation_fit";
    case Kind::prediction_fit:
      return "prediction_fit";
    case Kind::input_effect:
      return "input_effect";
    case Kind::regression:
      return "regression";
    case Kind::error_peaks:
      return "error_peaks";
    case Kind::beyond_noise:
      return "beyond_noise";
    case Kind::outliers:
      return "outliers";
    case Kind::coverage:
      return "coverage";
    case Kind::samples:
      return "samples";
    case Kind::missing:
      return "missing";
    case Kind::experiments:
      return "experiments";
    case Kind::condition:
      return "condition";
    case Kind::inputs:
      return "inputs";
    case Kind::rank:
      return "rank";
    case Kind::channels:
      return "channels";
    case Kind::whiteness:
      return "whiteness";
    case Kind::independence:
      return "independence";
    case Kind::gains:
      return "gains";
    case Kind::nis:
      break;
  }
  return "nis";
}

const char* to_string(VerdictCheck::Untested reason) { return report::words_of(reason).name; }

CheckWords in_words(const VerdictCheck& check) { return report::Words(check).words(); }

std::vector<VerdictCheck> innovation_checks(const Conclusions& c, const Validation& v) {
  return {report::check_of(c.whiteness, v), report::check_of(c.independence, v), report::check_of(c.gains, v),
          report::check_of(c.nis, v)};
}

}  // namespace tokid
