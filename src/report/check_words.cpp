// The checks of a verdict in words, from their figures.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "base/nan.hpp"
#include "base/sentence.hpp"
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
  const char *name, *text;
};
// In the order of Untested
constexpr UntestedWords untested_words[] = {
    {"no_predictions", "no predictions"},
    {"no_varying_output", "no output varies over the predicted steps"},
    {"no_cross_validation", "no cross-validation"},
    {"few_errors", "{#zero errors|no errors known|errors of {@counted} only, at least {fewest} needed}"},
    {"no_covariance", "the model states no covariance"},
    {"uncertain_covariance", "no covariance that is certain enough"},
    {"unknown_experiments", "not known"},
    {"no_lag_order", "the model has no lag order"},
    {"without_noise", "{#rank|{known step}, which is usual without noise|data without noise}"},
    {"no_regressions", "the model has no condition numbers"},
    {"no_inputs", "the model has no inputs"},
    {"few_input_samples",
     "{over_time|too few samples of the inputs|samples of fewer than 3 experiments at every step}"},
    {"no_ranks", "the model has no ranks"},
    {"no_probability", "too few samples for a probability"},
    {"dependent_inputs", "the inputs follow from other samples"},
    {"innovations", "{@conclusion}"}};

// The words of a check: templates, see sentence().
struct CheckRow {
  const char *name, *subject, *found, *needed;
};
// In the order of Kind
constexpr CheckRow check_rows[] = {
    {"outputs", "Outputs that vary and have samples to compare", "{#known|{value} of {bound output}|no samples}",
     "all"},
    {"one_step_fit", "One-step prediction fit", "{@fits}", "{@fits needed}"},
    {"simulation_fit", "Simulation fit, which decides the verdict", "{@fits}", "{@fits needed}"},
    {"prediction_fit", "Prediction fit {horizon step} ahead, which decides the verdict", "{@fits}", "{@fits needed}"},
    {"input_effect", "Effect of the inputs on the predictions, relative to the prediction error", "{value~}",
     "{bound:.1f} or more"},
    {"regression", "Largest error in cross-validation, relative to that of a regression", "{#known|{most~}|not known}",
     "{bound:.2f} or less at every horizon"},
    {"error_peaks", "Largest one-step error of a step, relative to its limit",
     "{#known|{value~} at step {step}|not known}",
     "{bound:.0f} or less; the limit is the largest of {peak:.0f} times the median, the largest value by chance, "
     "{floor%} % of the spread of the outputs and {stated:.0f} times what the model states"},
    {"beyond_noise", "Largest one-step error of a step, relative to that of the identification",
     "{#known|{value~} at step {step}|not known}", "{bound:.0f} or less"},
    {"outliers", "Largest error of an experiment, relative to its limit",
     "{#experiment|{value~} at experiment {@experiment}|not known}",
     "{bound:.0f} or less; the limit is the larger of {outlying:.0f} times the median and {least_outlying%} % of the "
     "spread of the outputs"},
    {"coverage", "Steps of the model that the data test", "{tested} of {steps step}", "{bound%} % or more"},
    {"samples", "Experiments of the identification for each unknown", "{#known|{value~}|not known}",
     "{bound:.0f} or more{training|, because the model is tested on the data that it was identified from|}"},
    {"missing", "Missing samples", "{#zero|none|{@percent} %}", "{bound%} % or less"},
    {"experiments", "Experiments tested", "{value:.0f}", "{bound:.0f} or more"},
    {"condition", "Largest condition number of a regression", "{value~}", "{bound~} or less"},
    {"inputs",
     "Inputs that vary {over_time|over time or between the experiments|between the experiments at every step}",
     "{@inputs}",
     "all{over_time||, with a spread of {weak_input%} % or more of the median of all steps. A smaller spread does not "
     "count if chance explains it (expected at {chance:} steps or more)}"},
    {"rank", "Regressions without full rank", "{known step}", "{bound:.0f} or fewer, the lag order"},
    {"channels", "Sample time and names of the channels", "{#zero|those of the model|{value difference}}",
     "those of the model"},
    {"whiteness", "Whiteness of the innovations", "", "no correlation in time"},
    {"independence", "Inputs and innovations", "", "no correlation with past and present inputs"},
    {"gains", "Effects of the inputs", "", "those of the model"},
    {"nis", "Squared innovations", "", "those that the model states"}};

// The figures that decided a test of the innovations, and their bounds. The reason of the conclusion selects the words,
// so that they state the rule that decided.
std::pair<const char*, const char*> decided(Reason reason) {
  switch (reason) {
    case Reason::white:
    case Reason::inputs_explain_nothing:
      return {"{@p}", "p of {bound:} or more"};
    case Reason::correlated:
    case Reason::inputs_explain_part:
      return {"{@p}, correlation {value1~}", "p of {bound:} or more, or a correlation below {bound1:.1f}"};
    case Reason::correlated_on_average:
      return {"correlation {value~} on average over the steps, beyond its bound",
              "no correlation beyond 1.5 times its bound, or a correlation below {bound:.1f}"};
    case Reason::gains_unknown:
      return {"99 % interval of ± {@share} of the simulated outputs", "± {bound%} % or less"};
    case Reason::gains_wrong:
      return {"significant error of {@share} of the simulated outputs",
              "no significant error, or one below {bound%} %"};
    case Reason::gains_lost_in_noise:
      return {"99 % interval of ± {@share} of the simulated outputs, no significant error",
              "± {bound%} % or less, and no significant error of {bound1%} % or more"};
    case Reason::gains_confirmed:
      return {"99 % interval of ± {@interval} of the effect, no significant error",
              "no significant error of {bound%} % of the simulated outputs or more"};
    default:
      return {
          "{value~} times the stated covariance, {@p}",
          "{bound:.0f} times the stated covariance or less, for p {#chance|of|below} {unlikely:}{#chance| or more|}"};
  }
}

// Makes the words of one check.
class Words {
 public:
  explicit Words(const VerdictCheck& check) : check_(check), numbers_(check.numbers) {
    for (size_t i = 0; i < check.figures.size(); ++i) {
      const std::string suffix = i == 0 ? "" : fmt::to_string(i);
      numbers_["bound" + suffix] = check.figures[i].bound;
      numbers_["value" + suffix] = check.figures[i].values.empty() ? nan : check.figures[i].values.front();
    }
    if (!known())
      numbers_["known"] = 0.0;
    else
      numbers_["known"] = number("value"),
      numbers_["most"] = *std::max_element(check.figures[0].values.begin(), check.figures[0].values.end());
    numbers_.insert({{"peak", bounds::error_peak},
                     {"floor", bounds::error_floor},
                     {"stated", bounds::error_stated},
                     {"outlying", outlying_experiment},
                     {"least_outlying", least_outlying_error},
                     {"weak_input", bounds::weak_input},
                     {"chance", bounds::chance},
                     {"unlikely", unlikely}});
  }

  CheckWords words() const {
    const CheckRow& row = check_rows[size_t(check_.kind)];
    CheckWords result{filled(row.subject), "", filled(row.needed)};
    if (check_.untested) {
      result.found = filled(untested_words[size_t(*check_.untested)].text);
    } else if (check_.kind >= CheckKind::whiteness) {
      const auto [found, needed] = decided(reason_of_test());
      result.found = filled(found), result.needed = filled(needed);
    } else {
      result.found = filled(row.found);
    }
    return result;
  }

 private:
  double number(const char* name) const { return numbers_.at(name); }
  bool known() const { return !check_.figures.empty() && !std::isnan(numbers_.at("value")); }

  std::string filled(std::string_view text) const {
    return sentence(text, {numbers_, [&](std::string_view name) { return Index(holds(name)); },
                           [&](std::string_view name) { return part(name); }});
  }

  bool holds(std::string_view name) const {
    return name == "known"         ? known()
           : name == "zero"        ? number("value") == 0
           : name == "zero errors" ? number("count") == 0
           : name == "experiment"  ? check_.experiment.has_value()
           : name == "rank"        ? check_.kind == CheckKind::rank
                                   : number("p") >= unlikely;  // "chance"
  }

  std::string part(std::string_view name) const {
    const auto share = [](double value) {
      return std::isfinite(value) ? fmt::format("{} %", figure(100 * value, 3)) : std::string("all");
    };
    if (name == "p") return probability(check_.numbers.contains("p") ? number("p") : number("value"));
    if (name == "share") return share(number("value"));
    if (name == "interval") return share(number("interval"));
    if (name == "percent") return figure(100 * number("value"), 2);
    if (name == "experiment") return words::experiment(check_.experiment->row, check_.experiment->name);
    if (name == "fits") return fits();
    if (name == "fits needed")
      return filled(
          check_.one_suffices
              ? "{bound:.0f} % or more for every output, or errors at most {bound1:.2f} times those of an exact model"
              : "{bound:.0f} % or more for every output");
    if (name == "inputs") return inputs();
    if (name == "counted")
      return plural(Index(number("count")), check_.kind == CheckKind::outliers ? "experiment" : "step");
    Conclusion conclusion;  // "conclusion"
    conclusion.reason = reason_of_test();
    return in_words(conclusion);
  }

  Reason reason_of_test() const {
    if (!check_.reason)
      throw std::invalid_argument(
          fmt::format("check: {} without a reason found, needed is that of its conclusion", to_string(check_.kind)));
    return *check_.reason;
  }

  std::string fits() const {
    const std::vector<double>& values = check_.figures.at(0).values;
    std::string text = percent_range(Eigen::Map<const Vector>(values.data(), Index(values.size())));
    if (check_.one_suffices) {
      const std::vector<double>& ratios = check_.figures.at(1).values;
      text += fmt::format("; errors {} times those of an exact model",
                          figure(*std::max_element(ratios.begin(), ratios.end()), 3));
    }
    return text;
  }

  std::string inputs() const {
    std::string found = filled("{value} of {bound input}");
    if (const Index others = Index(number("inputs") - number("bound")); others > 0)
      found += fmt::format(", too few samples of {}", plural(others, "other input"));
    for (const CheckFigure& figure : check_.figures)
      if (figure.name == "dependent" && !figure.kept())
        found +=
            fmt::format(", of which {} from other samples", figure.values.front() > 1 ? "some follow" : "one follows");
    return found;
  }

  const VerdictCheck& check_;
  std::map<std::string, double> numbers_;
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

const char* to_string(VerdictCheck::Kind kind) { return report::check_rows[size_t(kind)].name; }

const char* to_string(VerdictCheck::Untested reason) { return report::untested_words[size_t(reason)].name; }

CheckWords in_words(const VerdictCheck& check) { return report::Words(check).words(); }

std::vector<VerdictCheck> innovation_checks(const Conclusions& c, const Validation& v) {
  return {report::check_of(c.whiteness, v), report::check_of(c.independence, v), report::check_of(c.gains, v),
          report::check_of(c.nis, v)};
}

}  // namespace tokid
