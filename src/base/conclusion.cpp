// The sentences of all conclusions, in the order of their reasons.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/conclusion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "base/enum_table.hpp"
#include "base/words.hpp"

namespace tokid {

namespace {

using Reason = Conclusion::Reason;

std::string probability(const Conclusion& c) { return words::probability(c.numbers.at("p")); }

const char* pooled(const Conclusion& c) {
  return c.pooled ? "; tested over all steps together, because there are few experiments" : "";
}

std::string size(const Conclusion& c, const char* meaning) {
  return fmt::format("{} times the stated covariance ({}): {}", words::figure(c.numbers.at("ratio")), probability(c),
                     meaning);
}

// "p = 0.003: the innovations are correlated in time, up to 0.25 at lag 1"
std::string correlation(const Conclusion& c, const char* meaning) {
  const std::string small = c.result == TestResult::negligible ? fmt::format(", too small to matter (less than {})",
                                                                             words::figure(c.numbers.at("limit"), 2))
                                                               : "";
  return fmt::format("{}: {} up to {} at lag {}{}{}", probability(c), meaning,
                     words::figure(c.numbers.at("correlation")), c.numbers.at("lag"), small, pooled(c));
}

std::string no_correlation(const Conclusion& c, const char* meaning) {
  return fmt::format("{}: {}{}", probability(c), meaning, pooled(c));
}

// Lists the texts of the first few inputs, and the number of all inputs.
template <class Text>
std::string inputs(const Conclusion& c, Text&& text) {
  constexpr size_t most = 6;
  std::vector<std::string> shown;
  for (size_t i = 0; i < std::min(most, c.channels.size()); ++i)
    shown.push_back(text(words::quoted(c.channels[i].name), i));
  std::string result = fmt::format("{}", fmt::join(shown, ", "));
  if (c.channels.size() > most) result += fmt::format(" and more ({} inputs in all)", c.channels.size());
  return result;
}

std::string wrong_gains(const Conclusion& c) {
  const std::string list = inputs(c, [&](const std::string& name, size_t i) {
    const double error = c.errors[i];
    const std::string how =
        error < -1 ? "with the opposite sign of what"
                   : fmt::format("{} % {} than", words::figure(100 * std::abs(error)), error > 0 ? "more" : "less");
    return fmt::format("to {} {} the model says (± {} %)", name, how, words::figure(100 * c.intervals[i], 2));
  });
  return fmt::format("the outputs respond {}{}", list,
                     c.result == TestResult::negligible ? "; too small to matter" : "");
}

std::string unknown_gains(const Conclusion& c) {
  return "the data do not show how strongly the outputs respond to " +
         inputs(c, [&](const std::string& name, size_t i) {
           return std::isfinite(c.intervals[i]) ? fmt::format("{} (± {:.0f} %)", name, 100 * c.intervals[i]) : name;
         });
}

std::string lost_gains(const Conclusion& c) {
  return fmt::format("the response to {} is too small to be seen in the noise",
                     inputs(c, [](const std::string& name, size_t) { return name; }));
}

std::string confirmed_gains(const Conclusion& c) {
  return fmt::format("the outputs respond to {} as strongly as the model says (± {} %){}",
                     c.channels.empty() ? "the inputs" : "the other inputs",
                     words::figure(100 * c.numbers.at("interval"), 2), c.channels.empty() ? "" : "; " + lost_gains(c));
}

struct ReasonEntry {
  Reason reason;
  const char* name;
  std::string (*words)(const Conclusion& c);
};

constexpr ReasonEntry reasons[] = {
    {Reason::few_samples, "few_samples", [](const Conclusion&) { return std::string("not tested (too few samples)"); }},
    {Reason::rounding_level, "rounding_level",
     [](const Conclusion&) { return std::string("not tested (the innovations are at rounding level)"); }},
    {Reason::no_covariance, "no_covariance",
     [](const Conclusion&) { return std::string("not tested (the model states no covariance)"); }},
    {Reason::no_varying_inputs, "no_varying_inputs",
     [](const Conclusion&) {
       return std::string(
           "not tested (the inputs do not differ between the experiments, or have no effect in the model)");
     }},
    {Reason::size_as_stated, "size_as_stated",
     [](const Conclusion& c) { return size(c, "no sign of a difference from the model"); }},
    {Reason::size_slightly_smaller, "size_slightly_smaller",
     [](const Conclusion& c) { return size(c, "a little smaller than the model says"); }},
    {Reason::size_smaller, "size_smaller",
     [](const Conclusion& c) { return size(c, "smaller than the model says: its error bounds are too wide"); }},
    {Reason::size_slightly_larger, "size_slightly_larger",
     [](const Conclusion& c) { return size(c, "a little larger than the model says"); }},
    {Reason::size_larger, "size_larger",
     [](const Conclusion& c) { return size(c, "larger than the model says, but less than twice"); }},
    {Reason::size_overconfident, "size_overconfident",
     [](const Conclusion& c) {
       return size(c, "larger than the model says: the model is overconfident, so do not rely on its error bounds");
     }},
    {Reason::size_of_experiments, "size_of_experiments",
     [](const Conclusion& c) { return size(c, "much larger than the model says, at least in single experiments"); }},
    {Reason::white, "white",
     [](const Conclusion& c) { return no_correlation(c, "no sign of correlation between innovations"); }},
    {Reason::correlated, "correlated",
     [](const Conclusion& c) { return correlation(c, "the innovations are correlated in time,"); }},
    {Reason::correlated_on_average, "correlated_on_average",
     [](const Conclusion& c) {
       return correlation(c, "on average over the steps, the innovations are correlated in time,");
     }},
    {Reason::inputs_explain_nothing, "inputs_explain_nothing",
     [](const Conclusion& c) { return no_correlation(c, "no sign that the inputs explain part of the innovations"); }},
    {Reason::inputs_explain_part, "inputs_explain_part",
     [](const Conclusion& c) { return correlation(c, "the inputs explain part of the innovations, correlation"); }},
    {Reason::gains_wrong, "gains_wrong", wrong_gains},
    {Reason::gains_unknown, "gains_unknown", unknown_gains},
    {Reason::gains_confirmed, "gains_confirmed", confirmed_gains},
    {Reason::gains_lost_in_noise, "gains_lost_in_noise", lost_gains},
    {Reason::no_feedback, "no_feedback",
     [](const Conclusion& c) { return no_correlation(c, "no sign of feedback from outputs to inputs"); }},
    {Reason::feedback, "feedback",
     [](const Conclusion& c) {
       return no_correlation(c, "later inputs depend on the outputs (feedback), which is not a fault of the model");
     }},
};

static_assert(lists_each_in_order(reasons, &ReasonEntry::reason));

}  // namespace

const char* to_string(TestResult result) {
  switch (result) {
    case TestResult::nothing:
      return "nothing";
    case TestResult::negligible:
      return "negligible";
    case TestResult::against:
      return "against";
    case TestResult::untested:
      break;
  }
  return "untested";
}

const char* to_string(Conclusion::Test test) {
  static constexpr const char* names[] = {"nis", "whiteness", "independence", "gains", "feedback"};
  return names[size_t(test)];
}

const char* to_string(Conclusion::Reason reason) { return reasons[size_t(reason)].name; }

std::string in_words(const Conclusion& conclusion) { return reasons[size_t(conclusion.reason)].words(conclusion); }

}  // namespace tokid
