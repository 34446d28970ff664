// Test results of the innovations → conclusions about the model, in words.
// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/conclusions.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "base/words.hpp"
#include "tokid/validate.hpp"

namespace tokid {

const char* to_string(TestResult result) {
  switch (result) {
    case TestResult::nothing:
      return "nothing";
    case TestResult::negligible:
      return "negligible";
    case TestResult::against:
      return "against";
    default:
      return "untested";
  }
}

namespace {

using words::figure, words::probability;

Conclusion untested(const Validation& v) {
  return {TestResult::untested,
          v.noisy ? "not tested, the samples are too few" : "not tested, the innovations are at rounding level"};
}

const char* over(Pooling pooling) {
  return pooling == Pooling::time ? "; over all steps together, because the experiments are few" : "";
}

// Rates a significant result by its size.
TestResult beyond_chance(double size, double counts) {
  return size >= counts ? TestResult::against : TestResult::negligible;
}

std::string too_small(TestResult result, double counts) {
  return result == TestResult::negligible ? fmt::format(", too little to count (less than {:.2g})", counts) : "";
}

Conclusion squares(const Validation& v) {
  // Many data make any difference significant, however small.
  constexpr double little = 1.2;
  const NormalisedSquares& s = v.squares;
  if (!v.noisy) return untested(v);
  if (std::isnan(s.ratio)) return {TestResult::untested, "not tested, the model states no covariance"};
  const auto conclusion = [&](TestResult result, const char* meaning) {
    return Conclusion{
        result, fmt::format("{} times the stated covariance ({}): {}", figure(s.ratio, 3), probability(s.p), meaning)};
  };
  if (s.ratio > NormalisedSquares::wild && s.p >= unlikely)
    return conclusion(TestResult::against, "much larger than the model says in single experiments, if not in all");
  if (s.p >= unlikely || std::isnan(s.p))
    return conclusion(TestResult::nothing, "no sign of another size than the model says");
  if (s.ratio > counts::overconfident)
    return conclusion(TestResult::against,
                      "larger than the model says: it is overconfident, don't rely on its error bounds");
  if (s.ratio > little) return conclusion(TestResult::negligible, "larger than the model says, but less than twice");
  if (s.ratio > 1) return conclusion(TestResult::negligible, "a little larger than the model says");
  if (s.ratio < 1 / little) return conclusion(TestResult::negligible, "smaller than the model says: it is too careful");
  return conclusion(TestResult::negligible, "a little smaller than the model says");
}

Conclusion whiteness(const Validation& v) {
  const Whiteness& w = v.whiteness;
  if (std::isnan(w.p)) return untested(v);
  double size = 0.0;
  Index lag = 0;
  bool steady = false;  // one sign at many steps, which single steps do not show
  for (Index j = 0; j < w.correlation.rows(); ++j)
    for (const double c : w.correlation.row(j)) {
      steady = steady || std::abs(c) > 1.5 * w.bound(j);
      if (std::abs(c) > size) size = std::abs(c), lag = j + 1;
    }
  if (w.p >= unlikely && !steady)
    return {TestResult::nothing,
            fmt::format("{}: no sign of correlation between innovations{}", probability(w.p), over(w.over))};
  const TestResult result = beyond_chance(size, counts::correlation);
  return {result, fmt::format("{}: the innovations are correlated in time{}, up to {:.3f} at lag {}{}{}",
                              probability(w.p), w.p < unlikely ? "" : " in the mean over the steps", size, lag,
                              too_small(result, counts::correlation), over(w.over))};
}

Conclusion inputs(const Validation& v) {
  const Independence& i = v.independence;
  if (std::isnan(i.p)) return untested(v);
  if (i.p >= unlikely)
    return {TestResult::nothing, fmt::format("{}: the inputs explain nothing more{}", probability(i.p), over(i.over))};
  double size = 0.0;
  Index lag = 0;
  for (Index j = 0; j < i.correlation.size(); ++j)
    if (i.correlation(j) > size) size = i.correlation(j), lag = i.first + j;
  const TestResult result = beyond_chance(size, counts::correlation);
  return {result, fmt::format("{}: the inputs explain part of the innovations, correlation up to {:.3f} at lag {}{}{}",
                              probability(i.p), size, lag, too_small(result, counts::correlation), over(i.over))};
}

Conclusion feedback(const Validation& v) {
  const Independence& f = v.feedback;
  if (std::isnan(f.p)) return untested(v);
  return {TestResult::nothing,
          fmt::format("{}: {}{}", probability(f.p),
                      f.p < unlikely ? "later inputs answer to the outputs, which is no fault of the model"
                                     : "no sign that inputs answer to outputs",
                      over(f.over))};
}

// "50 % less"
std::string answer(double error) {
  if (error < -1) return "the other way than";
  return fmt::format("{:.3g} % {} than", 100 * std::abs(error), error > 0 ? "more" : "less");
}

Conclusion gains(const Validation& v, const Channels& names) {
  constexpr double two_sided_99 = 2.5758293035489;  // quantile of the normal distribution
  const InputGains& g = v.gains;
  Conclusion result = untested(v);
  double widest = 0.0;
  std::vector<std::string> wrong, small, unknown, lost;
  for (Index i = 0; i < g.error.size(); ++i) {
    const double error = g.error(i), half = two_sided_99 * g.deviation(i), share = std::min(1.0, g.share(i));
    if (std::isnan(half)) continue;
    const std::string name = words::quoted(names.input(i));
    if (share > 0 && !(half * share <= counts::gain_unknown)) {
      unknown.push_back(std::isfinite(half) ? fmt::format("{} (± {:.0f} %)", name, 100 * half) : name);
    } else if (std::abs(error) > half) {
      const std::string text = fmt::format("to {} {} the model says (± {:.2g} %)", name, answer(error), 100 * half);
      (std::abs(error) * share >= counts::gain ? wrong : small).push_back(text);
    } else if (std::isfinite(half) && half > 1) {
      lost.push_back(name);
      result.result = TestResult::nothing;
    } else if (std::isfinite(half)) {
      widest = std::max(widest, half);
      result.result = TestResult::nothing;
    }
  }
  const auto listed = [](const std::vector<std::string>& texts) {
    constexpr size_t most = 6;
    const size_t shown = std::min(most, texts.size());
    std::string text = fmt::format("{}", fmt::join(texts.begin(), texts.begin() + std::ptrdiff_t(shown), ", "));
    if (texts.size() > most) text += fmt::format(" and more ({} inputs in all)", texts.size());
    return text;
  };
  if (!wrong.empty()) return {TestResult::against, "the outputs answer " + listed(wrong)};
  if (!unknown.empty())
    return {TestResult::against, "the data do not tell how strongly the outputs answer to " + listed(unknown)};
  if (!small.empty())
    return {TestResult::negligible, fmt::format("the outputs answer {}; too little to count", listed(small))};
  const std::string too_faint =
      lost.empty() ? "" : fmt::format("what the outputs answer to {} is lost in the noise", listed(lost));
  if (widest > 0)
    result.text = fmt::format("the outputs answer to {} as strongly as the model says (± {:.2g} %){}",
                              lost.empty() ? "the inputs" : "the other inputs", 100 * widest,
                              lost.empty() ? "" : "; " + too_faint);
  else if (!lost.empty())
    result.text = too_faint;
  else if (v.noisy && g.error.size() > 0)
    result.text = "not tested, the inputs do not differ between the experiments or the model says that they do nothing";
  return result;
}

}  // namespace

Conclusions conclusions(const Validation& v, const Channels& names) {
  return {squares(v), whiteness(v), inputs(v), gains(v, names), feedback(v)};
}

}  // namespace tokid
