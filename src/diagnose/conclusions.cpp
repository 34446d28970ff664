// Test results of the innovations → conclusions about the model.
// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/conclusions.hpp"

#include <algorithm>
#include <cmath>

#include "data/subjects.hpp"
#include "tokid/validate.hpp"

namespace tokid {

namespace {

using Test = Conclusion::Test;
using Reason = Conclusion::Reason;

Conclusion untested(Test test, const Validation& v) {
  return {.test = test, .reason = v.noisy ? Reason::few_samples : Reason::rounding_level};
}

// Rates a significant result by its size.
TestResult beyond_chance(double size, double counts) {
  return size >= counts ? TestResult::against : TestResult::negligible;
}

Conclusion nis(const Validation& v) {
  // A ratio up to this is only slightly larger. With many data, even small differences are significant.
  constexpr double little = 1.2;
  const NormalisedSquares& s = v.squares;
  if (!v.noisy) return untested(Test::nis, v);
  if (std::isnan(s.ratio)) return {.test = Test::nis, .reason = Reason::no_covariance};
  const auto conclusion = [&](TestResult result, Reason reason) {
    return Conclusion{
        .test = Test::nis, .result = result, .reason = reason, .numbers = {{"ratio", s.ratio}, {"p", s.p}}};
  };
  if (s.ratio > NormalisedSquares::wild && s.p >= unlikely)
    return conclusion(TestResult::against, Reason::size_of_experiments);
  if (s.p >= unlikely || std::isnan(s.p)) return conclusion(TestResult::nothing, Reason::size_as_stated);
  if (s.ratio > counts::overconfident) return conclusion(TestResult::against, Reason::size_overconfident);
  if (s.ratio > little) return conclusion(TestResult::negligible, Reason::size_larger);
  if (s.ratio > 1) return conclusion(TestResult::negligible, Reason::size_slightly_larger);
  if (s.ratio < 1 / little) return conclusion(TestResult::negligible, Reason::size_smaller);
  return conclusion(TestResult::negligible, Reason::size_slightly_smaller);
}

Conclusion whiteness(const Validation& v) {
  const Whiteness& w = v.whiteness;
  if (std::isnan(w.p)) return untested(Test::whiteness, v);
  double size = 0.0;
  Index lag = 0;
  bool steady = false;  // correlation of one sign at many steps, too small to be significant at a single step
  for (Index j = 0; j < w.correlation.rows(); ++j)
    for (const double c : w.correlation.row(j)) {
      steady = steady || std::abs(c) > 1.5 * w.bound(j);
      if (std::abs(c) > size) size = std::abs(c), lag = j + 1;
    }
  const bool pooled = w.over == Pooling::time;
  if (w.p >= unlikely && !steady)
    return {.test = Test::whiteness,
            .result = TestResult::nothing,
            .reason = Reason::white,
            .numbers = {{"p", w.p}},
            .pooled = pooled};
  return {.test = Test::whiteness,
          .result = beyond_chance(size, counts::correlation),
          .reason = w.p < unlikely ? Reason::correlated : Reason::correlated_on_average,
          .numbers = {{"p", w.p}, {"correlation", size}, {"lag", double(lag)}, {"limit", counts::correlation}},
          .pooled = pooled};
}

Conclusion independence(const Validation& v) {
  const Independence& i = v.independence;
  if (std::isnan(i.p)) return untested(Test::independence, v);
  const bool pooled = i.over == Pooling::time;
  if (i.p >= unlikely)
    return {.test = Test::independence,
            .result = TestResult::nothing,
            .reason = Reason::inputs_explain_nothing,
            .numbers = {{"p", i.p}},
            .pooled = pooled};
  double size = 0.0;
  Index lag = 0;
  for (Index j = 0; j < i.correlation.size(); ++j)
    if (i.correlation(j) > size) size = i.correlation(j), lag = i.first + j;
  return {.test = Test::independence,
          .result = beyond_chance(size, counts::correlation),
          .reason = Reason::inputs_explain_part,
          .numbers = {{"p", i.p}, {"correlation", size}, {"lag", double(lag)}, {"limit", counts::correlation}},
          .pooled = pooled};
}

Conclusion feedback(const Validation& v) {
  const Independence& f = v.feedback;
  if (std::isnan(f.p)) return untested(Test::feedback, v);
  return {.test = Test::feedback,
          .result = TestResult::nothing,
          .reason = f.p < unlikely ? Reason::feedback : Reason::no_feedback,
          .numbers = {{"p", f.p}},
          .pooled = f.over == Pooling::time};
}

Conclusion gains(const Validation& v, const Channels& names) {
  constexpr double two_sided_99 = 2.5758293035489;  // quantile of the normal distribution
  const InputGains& g = v.gains;
  Conclusion wrong{.test = Test::gains, .result = TestResult::against, .reason = Reason::gains_wrong};
  Conclusion unknown{.test = Test::gains, .result = TestResult::against, .reason = Reason::gains_unknown};
  Conclusion small{.test = Test::gains, .result = TestResult::negligible, .reason = Reason::gains_wrong};
  Conclusion lost{.test = Test::gains, .result = TestResult::nothing, .reason = Reason::gains_lost_in_noise};
  double widest = 0.0;
  bool confirmed = false;
  for (Index i = 0; i < g.error.size(); ++i) {
    const double error = g.error(i), half = two_sided_99 * g.deviation(i), share = std::min(1.0, g.share(i));
    if (std::isnan(half)) continue;
    const auto add_to = [&](Conclusion& conclusion) {
      conclusion.channels.push_back(input_channel(names, i));
      conclusion.errors.push_back(error);
      conclusion.intervals.push_back(half);
    };
    if (share > 0 && !(half * share <= counts::gain_unknown))
      add_to(unknown);
    else if (std::abs(error) > half)
      add_to(std::abs(error) * share >= counts::gain ? wrong : small);
    else if (std::isfinite(half) && half > 1)
      add_to(lost);
    else if (std::isfinite(half))
      widest = std::max(widest, half), confirmed = true;
  }
  for (Conclusion* found : {&wrong, &unknown, &small})
    if (!found->channels.empty()) return *found;
  if (confirmed) {
    lost.reason = Reason::gains_confirmed;
    lost.numbers = {{"interval", widest}};
    return lost;
  }
  if (!lost.channels.empty()) return lost;
  if (v.noisy && g.error.size() > 0) return {.test = Test::gains, .reason = Reason::no_varying_inputs};
  return untested(Test::gains, v);
}

}  // namespace

Conclusions conclusions(const Validation& v, const Channels& names) {
  return {nis(v), whiteness(v), independence(v), gains(v, names), feedback(v)};
}

}  // namespace tokid
