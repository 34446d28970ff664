// Conclusions of the tests of the innovations, as values and as sentences.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <vector>

#include "tokid/finding.hpp"

namespace tokid {

// The result of a test of the innovations: nothing against the model; a significant effect that is too small to matter;
// or a significant effect that matters.
enum class TestResult { untested, nothing, negligible, against };
const char* to_string(TestResult result);  // "untested", "nothing", "negligible", "against"

struct Conclusion {
  enum class Test { nis, whiteness, independence, gains, feedback };
  // Each reason is followed by the fields that it fills.
  enum class Reason {
    // not tested
    few_samples,
    rounding_level,     // the innovations are rounding errors
    no_covariance,      // the model states none
    no_varying_inputs,  // the inputs do not differ between the experiments, or the model does not respond to them
    // nis; numbers: p and ratio, the mean square over the stated covariance
    size_as_stated,
    size_slightly_smaller,
    size_smaller,
    size_slightly_larger,
    size_larger,  // but not overconfident
    size_overconfident,
    size_of_experiments,  // single experiments are much larger
    // whiteness; numbers: p; of a correlation also correlation, lag, and limit: the size that counts
    white,
    correlated,
    correlated_on_average,  // over the steps; single steps do not show it
    // independence; the same
    inputs_explain_nothing,
    inputs_explain_part,
    // gains; channels: inputs. errors and intervals of each: see InputGains, and half of the 99 % interval
    gains_wrong,
    gains_unknown,
    gains_confirmed,  // channels: the inputs without an answer; numbers: interval, the widest of the others
    gains_lost_in_noise,
    // feedback; numbers: p
    no_feedback,
    feedback,  // later inputs depend on the outputs, which is not a fault of the model
    last = feedback
  };

  Test test = Test::nis;
  TestResult result = TestResult::untested;
  Reason reason = Reason::few_samples;
  std::map<std::string, double> numbers = {};
  std::vector<Finding::Channel> channels = {};
  std::vector<double> errors = {}, intervals = {};  // for each channel, relative to the effect in the model
  bool pooled = false;                              // the test took all steps together, because the experiments are few

  bool operator==(const Conclusion&) const = default;
};

const char* to_string(Conclusion::Test test);      // "nis", …: the stable name in JSON and Python
const char* to_string(Conclusion::Reason reason);  // "size_as_stated": the same
std::string in_words(const Conclusion& conclusion);

struct Conclusions {
  Conclusion nis, whiteness, independence, gains, feedback;
  std::vector<Conclusion> all() const { return {nis, whiteness, independence, gains, feedback}; }
};

}  // namespace tokid
