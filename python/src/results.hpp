// Converts the structs of the library to the dataclasses of tokid/results.py. Functions of the module return the
// structs.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>
#include <string>
#include <type_traits>
#include <vector>

#include "python.hpp"
#include "words.hpp"

namespace tokid::python {

inline const char* to_string(Weighting weighting) {
  return weighting == Weighting::one_step     ? "one-step"
         : weighting == Weighting::many_steps ? "many-steps"
                                              : "projection";
}
inline const char* to_string(Pooling over) {
  return over == Pooling::experiments ? "experiments" : over == Pooling::time ? "time" : "nothing";
}

// A value of Python: the word of an enumerator, an array for a vector of numbers.
template <class T>
nb::object object_of(const T& value) {
  if constexpr (std::is_enum_v<T>)
    return nb::cast(to_string(value));
  else if constexpr (std::is_same_v<T, std::vector<double>>)
    return nb::cast(Vector(Vector::Map(value.data(), Index(value.size()))));
  else
    return nb::cast(value, nb::rv_policy::copy);
}
template <class T>
nb::object object_of(const std::optional<T>& value) {
  return value ? object_of(*value) : nb::none();
}

// A field of a dataclass: its name and its value.
struct Field {
  template <class T>
  Field(const char* field_name, const T& field_value) : name(field_name), value(object_of(field_value)) {}
  const char* name;
  nb::object value;
};
nb::dict dict_of(std::initializer_list<Field> fields);
nb::any make(const char* type, std::initializer_list<Field> fields);  // the dataclass with the name `type`

template <class T>
inline constexpr bool is_result = false;
template <class T>
nb::any result_of(const T& s);

// Structs of the type `type` become the dataclass `name` with these fields. FIELD(x) is the field x of the struct s.
#define RESULT(type, name, ...)                 \
  template <>                                   \
  inline constexpr bool is_result<type> = true; \
  template <>                                   \
  inline nb::any result_of(const type& s) {     \
    return make(name, {__VA_ARGS__});           \
  }
#define FIELD(x) Field(#x, s.x)

}  // namespace tokid::python

template <class T>
struct nanobind::detail::type_caster<T, nanobind::detail::enable_if_t<tokid::python::is_result<T>>> {
  static constexpr auto Name = const_name("typing.Any");  // a stub cannot import the package
  template <class>
  using Cast = T;
  static handle from_cpp(const T& value, rv_policy, cleanup_list*) noexcept {
    try {
      return tokid::python::result_of(value).release();
    } catch (python_error& error) {
      error.restore();
    } catch (const std::bad_alloc&) {
      PyErr_NoMemory();
    } catch (const std::exception& error) {
      PyErr_SetString(PyExc_RuntimeError, error.what());
    }
    return {};
  }
};

namespace tokid::python {

inline std::optional<std::string> if_known(const std::string& name) {
  return name.empty() ? std::nullopt : std::optional(name);
}

// The text of a finding has the words of Python.
RESULT(Finding::Channel, "FindingChannel", Field("side", s.output ? "output" : "input"), FIELD(index), FIELD(name))
RESULT(Finding::Experiment, "FindingExperiment", FIELD(row), Field("name", if_known(s.name)))
RESULT(Finding::Term, "FindingTerm", FIELD(channel), FIELD(lag), FIELD(factor))
RESULT(Finding, "Finding", FIELD(kind), Field("severity", severity(s.kind)), FIELD(scope), FIELD(channels),
       FIELD(experiments), FIELD(steps), FIELD(numbers), Field("text", in_python(in_words(s))), FIELD(terms),
       FIELD(groups), FIELD(names), FIELD(detail), FIELD(file))

RESULT(Fit, "Fit", FIELD(fit), FIELD(rmse), FIELD(samples))
RESULT(ExperimentFits, "ExperimentFits", FIELD(simulation_fit), FIELD(one_step_fit), FIELD(simulation_rmse),
       FIELD(one_step_rmse), FIELD(simulation_samples), FIELD(one_step_samples), FIELD(over_median),
       FIELD(simulation_error), FIELD(one_step_error), FIELD(simulation_limit), FIELD(one_step_limit), FIELD(excess),
       Field("outlying", (s.excess.array() > 1).eval()), FIELD(worst_first), FIELD(worst_output))
RESULT(Similarity, "ModelDifference", FIELD(relative_error), Field("largest", s.max_difference), FIELD(begin),
       FIELD(end), FIELD(band))

RESULT(Whiteness, "Whiteness", FIELD(p), FIELD(z), FIELD(correlation), FIELD(bound), FIELD(over))
RESULT(Independence, "Independence", FIELD(p), FIELD(first), FIELD(z), FIELD(correlation), FIELD(over))
RESULT(NormalisedSquares, "NormalisedSquares", FIELD(ratio), FIELD(p), FIELD(normal), FIELD(step), FIELD(step_p))
RESULT(InputGains, "InputGains", FIELD(error), FIELD(deviation), FIELD(share))
RESULT(Conclusion, "Conclusion", FIELD(result), FIELD(reason), FIELD(channels), FIELD(numbers), FIELD(errors),
       FIELD(intervals), FIELD(pooled), Field("text", in_words(s)))
RESULT(OutlyingSamples, "OutlyingSamples", FIELD(experiment), Field("name", if_known(s.name)), FIELD(output),
       FIELD(steps), FIELD(error), FIELD(usual), FIELD(weight))

// A validation, with the names of the channels for the conclusions.
struct NamedValidation : Validation {
  NamedValidation(const Validation& validation, const Channels& names);
  nb::dict by_test;
};
RESULT(NamedValidation, "Validation", FIELD(simulation), FIELD(one_step), FIELD(horizon), FIELD(noisy),
       FIELD(whiteness_p), FIELD(whiteness), FIELD(independence), FIELD(feedback), FIELD(squares), FIELD(gains),
       Field("conclusions", s.by_test), FIELD(outlying), FIELD(first_predicted), FIELD(first_simulated),
       FIELD(findings))

RESULT(TimeVariation, "TimeVariation", FIELD(smoothing), FIELD(period))
RESULT(NoisyChoices, "NoisyChoices", FIELD(variation), FIELD(state_smoothing), FIELD(weighting),
       FIELD(refinement_smoothing), FIELD(refinement_iterations), Field("jumps", s.variation.jumps), FIELD(delays))
RESULT(NominalTest::Departure, "Departure", FIELD(channel), FIELD(steps))
RESULT(NominalTest, "NominalTest", FIELD(statistic), FIELD(threshold), FIELD(step_statistic), FIELD(step_threshold),
       FIELD(constant_statistic), FIELD(constant_threshold), FIELD(departures), FIELD(significant))
RESULT(InitialStateTest, "InitialStateTest", FIELD(statistic), FIELD(threshold), FIELD(decision), FIELD(reason))
RESULT(LagOrderErrors, "LagOrderErrors", FIELD(steps), FIELD(error), FIELD(mean), FIELD(best))
RESULT(SmoothingTrial, "SmoothingTrial", FIELD(lags), FIELD(smoothing), FIELD(error))
RESULT(SmoothingChoice, "SmoothingChoice", FIELD(trials), FIELD(lags), FIELD(smoothing), FIELD(error))
RESULT(OrderScores, "OrderScores", FIELD(states), FIELD(horizons), FIELD(errors), FIELD(cross_validated),
       FIELD(smoothing), FIELD(weighting), FIELD(price), FIELD(smallest), FIELD(uncertainty), FIELD(best))
RESULT(RefinementTrial, "RefinementTrial", FIELD(states), FIELD(smoothing), FIELD(iterations), FIELD(error),
       FIELD(log_likelihood))
RESULT(Jump, "Jump", FIELD(step), FIELD(loss))
RESULT(HeldOutErrors, "HeldOutErrors", FIELD(error), FIELD(standard_error))
RESULT(RegressionComparison, "RegressionComparison", FIELD(horizons), FIELD(experiments), FIELD(first_step),
       FIELD(model), FIELD(regression), FIELD(lags), FIELD(smoothing))
RESULT(RefinementChoice, "RefinementChoice", FIELD(trials), FIELD(states), FIELD(smoothing), FIELD(iterations),
       FIELD(error), FIELD(one_step), FIELD(jumps), Field("ahead_ratio", s.ahead.ratio),
       Field("ahead_model_share", s.ahead.model_share))
RESULT(FeedthroughChoice, "FeedthroughChoice", FIELD(present), FIELD(reason), FIELD(response_p), FIELD(feedback_p))
RESULT(LikelihoodChoice, "LikelihoodChoice", FIELD(smoothing), FIELD(log_likelihood), FIELD(error), FIELD(best))
RESULT(Outlier, "Outlier", FIELD(experiment), Field("name", if_known(s.name)), FIELD(ratio), FIELD(outputs),
       FIELD(weight), FIELD(held_out))
RESULT(Identification, "Identification", FIELD(experiments), FIELD(steps), Field("lags", s.plan.lags),
       Field("variation", s.plan.choices.variation), Field("state_smoothing", s.plan.choices.state_smoothing),
       FIELD(min_experiments), FIELD(rank_deficient_steps), FIELD(condition_max), FIELD(nominal_test),
       FIELD(initial_state_test), Field("feedthrough", s.plan.feedthrough), FIELD(lag_order_errors),
       FIELD(smoothing_choice), FIELD(order_scores), FIELD(refinement), FIELD(comparison),
       Field("choices", s.plan.coupled ? std::optional(s.plan.choices) : std::nullopt),
       Field("together", s.plan.coupled), Field("noisy", s.plan.noisy), Field("nominal", s.plan.nominal),
       FIELD(singular_value_gap), FIELD(held_out), FIELD(held_out_experiments),
       Field("validation", NamedValidation(s.validation, s.model.names)), FIELD(outliers),
       Field("copies", s.copies.groups), FIELD(findings), FIELD(seconds))

RESULT(VerdictReason, "VerdictReason", FIELD(trust), FIELD(text))
RESULT(CheckFigure, "CheckFigure", FIELD(name), FIELD(values), FIELD(rule), FIELD(bound), FIELD(distrust))
RESULT(VerdictCheck, "VerdictCheck", Field("name", s.kind), Field("subject", in_words(s).subject),
       Field("found", in_words(s).found), Field("needed", in_words(s).needed), FIELD(result), FIELD(untested),
       FIELD(figures), FIELD(one_suffices), FIELD(numbers), FIELD(experiment), Field("conclusion", s.reason),
       FIELD(reasons))
RESULT(Verdict, "Verdict", FIELD(trust), FIELD(summary), FIELD(reasons), FIELD(checks), FIELD(horizon))

}  // namespace tokid::python
