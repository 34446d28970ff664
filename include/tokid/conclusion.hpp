// Conclusions of the tests of the innovations, as values and as sentences.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <vector>

#include "tokid/finding.hpp"

namespace tokid {

// The result of a test of the innovations. nothing: no significant effect. negligible: a significant effect that is too
// small to matter. against: a significant effect that matters.
enum class TestResult { untested, nothing, negligible, against };
const char* to_string(TestResult result);  // "untested", "nothing", "negligible", "against"

struct Conclusion {
  enum class Test { nis, whiteness, independence, gains, feedback };
  // A comment after a reason lists the fields of Conclusion that have values.
  enum class Reason {
    // not tested
    few_samples,
    rounding_level,     // the innovations are rounding errors
    no_covariance,      // the model has no innovation covariance
    no_varying_inputs,  // the inputs do not differ between the experiments, or the model does not respond to them
    // nis; numbers: p; ratio: mean square of the innovations over the covariance in the model
    size_as_stated,
    size_slightly_smaller,
    size_smaller,
    size_slightly_larger,
    size_larger,  // by less than a factor of two
    size_overconfident,
    size_of_experiments,  // the innovations of single experiments are much larger
    // whiteness; numbers: p; if correlated also correlation, its lag, and limit: smaller correlations do not matter
    white,
    correlated,
    correlated_on_average,  // the mean correlation over the steps is significant, but p is not
    // independence; numbers: as for whiteness
    inputs_explain_nothing,
    inputs_explain_part,
    // gains; channels: inputs; errors: InputGains::error of each input; intervals: half of its 99 % interval
    gains_wrong,
    gains_unknown,
    gains_confirmed,      // channels: inputs as in gains_lost_in_noise; numbers: widest interval of the other inputs
    gains_lost_in_noise,  // half of the 99 % interval is larger than 1
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
  std::vector<double> errors = {}, intervals = {};  // of each channel, relative to its effect in the model
  bool pooled = false;                              // the test took all steps together, because the experiments are few

  bool operator==(const Conclusion&) const = default;
};

const char* to_string(Conclusion::Test test);      // "nis", …: the stable name in JSON and Python
const char* to_string(Conclusion::Reason reason);  // "size_as_stated", …: the stable name in JSON and Python
std::string in_words(const Conclusion& conclusion);

struct Conclusions {
  Conclusion nis, whiteness, independence, gains, feedback;
  std::vector<Conclusion> all() const { return {nis, whiteness, independence, gains, feedback}; }
};

}  // namespace tokid
