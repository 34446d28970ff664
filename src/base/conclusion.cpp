// The sentences of all conclusions, in the order of their reasons.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/conclusion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/enum_table.hpp"
#include "base/sentence.hpp"
#include "base/words.hpp"

namespace tokid {

namespace {

using Reason = Conclusion::Reason;

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
  return inputs(c, [&](const std::string& name, size_t i) {
    const double error = c.errors[i];
    const std::string how =
        error < -1 ? "with the opposite sign of what"
                   : fmt::format("{} % {} than", words::figure(100 * std::abs(error)), error > 0 ? "more" : "less");
    return fmt::format("to {} {} the model says (± {} %)", name, how, words::figure(100 * c.intervals[i], 2));
  });
}

std::string unknown_gains(const Conclusion& c) {
  return inputs(c, [&](const std::string& name, size_t i) {
    return std::isfinite(c.intervals[i]) ? fmt::format("{} (± {:.0f} %)", name, 100 * c.intervals[i]) : name;
  });
}

std::string filled(std::string_view text, const Conclusion& c);

std::string part(const Conclusion& c, std::string_view name) {
  if (name == "p") return words::probability(c.numbers.at("p"));
  if (name == "size") return filled("{ratio~} times the stated covariance ({@p})", c);
  if (name == "correlation")
    return filled(
        " up to {correlation~} at lag {lag}{#negligible|, too small to matter (less than {limit~2})|}{@pooled}", c);
  if (name == "pooled") return c.pooled ? "; tested over all steps together, because there are few experiments" : "";
  if (name == "wrong") return wrong_gains(c);
  if (name == "unknown") return unknown_gains(c);
  if (name == "interval") return words::figure(100 * c.numbers.at("interval"), 2);
  return inputs(c, [](const std::string& input, size_t) { return input; });
}

std::string filled(std::string_view text, const Conclusion& c) {
  const auto count = [&](std::string_view name) {
    return Index(name == "all" ? c.channels.empty() : c.result == TestResult::negligible);
  };
  return sentence(text, {c.numbers, count, [&](std::string_view name) { return part(c, name); }});
}

struct ReasonEntry {
  Reason reason;
  const char *name, *text;  // a template, see sentence()
};

constexpr ReasonEntry reasons[] = {
    {Reason::few_samples, "few_samples", "not tested (too few samples)"},
    {Reason::rounding_level, "rounding_level", "not tested (the innovations are at rounding level)"},
    {Reason::no_covariance, "no_covariance", "not tested (the model states no covariance)"},
    {Reason::no_varying_inputs, "no_varying_inputs",
     "not tested (the inputs do not differ between the experiments, or have no effect in the model)"},
    {Reason::size_as_stated, "size_as_stated", "{@size}: no sign of a difference from the model"},
    {Reason::size_slightly_smaller, "size_slightly_smaller", "{@size}: a little smaller than the model says"},
    {Reason::size_smaller, "size_smaller", "{@size}: smaller than the model says: its error bounds are too wide"},
    {Reason::size_slightly_larger, "size_slightly_larger", "{@size}: a little larger than the model says"},
    {Reason::size_larger, "size_larger", "{@size}: larger than the model says, but less than twice"},
    {Reason::size_overconfident, "size_overconfident",
     "{@size}: larger than the model says: the model is overconfident, so do not rely on its error bounds"},
    {Reason::size_of_experiments, "size_of_experiments",
     "{@size}: much larger than the model says, at least in single experiments"},
    {Reason::white, "white", "{@p}: no sign of correlation between innovations{@pooled}"},
    {Reason::correlated, "correlated", "{@p}: the innovations are correlated in time,{@correlation}"},
    {Reason::correlated_on_average, "correlated_on_average",
     "{@p}: on average over the steps, the innovations are correlated in time,{@correlation}"},
    {Reason::inputs_explain_nothing, "inputs_explain_nothing",
     "{@p}: no sign that the inputs explain part of the innovations{@pooled}"},
    {Reason::inputs_explain_part, "inputs_explain_part",
     "{@p}: the inputs explain part of the innovations, correlation{@correlation}"},
    {Reason::gains_wrong, "gains_wrong", "the outputs respond {@wrong}{#negligible|; too small to matter|}"},
    {Reason::gains_unknown, "gains_unknown", "the data do not show how strongly the outputs respond to {@unknown}"},
    {Reason::gains_confirmed, "gains_confirmed",
     "the outputs respond to {#all|the inputs|the other inputs} as strongly as the model says (± {@interval} "
     "%){#all||; the response to {@inputs} is too small to be seen in the noise}"},
    {Reason::gains_lost_in_noise, "gains_lost_in_noise",
     "the response to {@inputs} is too small to be seen in the noise"},
    {Reason::no_feedback, "no_feedback", "{@p}: no sign of feedback from outputs to inputs{@pooled}"},
    {Reason::feedback, "feedback",
     "{@p}: later inputs depend on the outputs (feedback), which is not a fault of the model{@pooled}"},
};

static_assert(lists_each_in_order(reasons, &ReasonEntry::reason));

}  // namespace

const char* to_string(TestResult result) {
  static constexpr const char* names[] = {"untested", "nothing", "negligible", "against"};
  return names[size_t(result)];
}

const char* to_string(Conclusion::Test test) {
  static constexpr const char* names[] = {"nis", "whiteness", "independence", "gains", "feedback"};
  return names[size_t(test)];
}

const char* to_string(Conclusion::Reason reason) { return reasons[size_t(reason)].name; }

std::string in_words(const Conclusion& c) { return filled(reasons[size_t(c.reason)].text, c); }

}  // namespace tokid
