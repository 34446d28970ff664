// The sentences of all findings, in the order of their kinds.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/finding.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include "base/enum_table.hpp"
#include "base/sentence.hpp"
#include "base/words.hpp"

namespace tokid {

namespace {

using Kind = Finding::Kind;
using Channel = Finding::Channel;
using Experiment = Finding::Experiment;
using Term = Finding::Term;

std::string filled(std::string_view text, const Finding& f);

bool is(const Finding& f, const char* name) { return f.numbers.at(name) == 1; }

std::string experiment(const Experiment& e) { return words::experiment(e.row, e.name); }

// Lists the first `most` experiments, and the number of the other experiments.
std::string listed(const std::vector<Experiment>& experiments, size_t most) {
  std::vector<std::string> names;
  for (size_t i = 0; i < std::min(experiments.size(), most); ++i) names.push_back(experiment(experiments[i]));
  if (experiments.size() <= most) return words::listed(names);
  return fmt::format("{} and {} more", fmt::join(names, ", "), experiments.size() - most);
}

std::vector<std::string> names_of(const std::vector<Channel>& channels, bool with_sides = false) {
  std::vector<std::string> names;
  for (const Channel& c : channels) names.push_back((!with_sides ? "" : c.output ? "output " : "input ") + c.name);
  return names;
}

// ---- sums of samples ----

std::string sample(const Term& term, bool timed) {
  if (!timed) return term.channel.name;
  return term.lag == 0 ? term.channel.name + "(k)" : fmt::format("{}(k-{})", term.channel.name, term.lag);
}

// "u1 - 2 u3", with all factors divided by the first factor.
std::string sum(const std::vector<Term>& terms, bool timed) {
  std::string text;
  for (const Term& term : terms) {
    const double value = term.factor / terms.front().factor;
    const std::string size = words::figure(std::abs(value)), name = sample(term, timed);
    if (!text.empty()) text += value < 0 ? " - " : " + ";
    text += size == "1" ? name : fmt::format("{} {}", size, name);
  }
  return text;
}

// "u1(k), u1(k-1…6) and y2(k-1, 3)"
std::string samples(const std::vector<Term>& terms) {
  std::map<std::pair<bool, Index>, std::pair<std::string, std::vector<Index>>> lags;  // by channel
  std::vector<std::string> parts;
  for (const Term& term : terms)
    if (term.lag == 0)
      parts.push_back(sample(term, true));
    else {
      auto& [name, list] = lags[{term.channel.output, term.channel.index}];
      name = term.channel.name;
      list.push_back(term.lag);
    }
  for (auto& [key, named] : lags) {
    auto& [name, list] = named;
    std::sort(list.begin(), list.end());
    std::string text;
    for (size_t i = 0; i < list.size();) {
      size_t j = i;
      while (j + 1 < list.size() && list[j + 1] == list[j] + 1) ++j;
      text += fmt::format("{}{}", text.empty() ? "" : ", ", list[i]);
      if (j > i) text += fmt::format("{}{}", j > i + 1 ? "…" : ", ", list[j]);
      i = j + 1;
    }
    parts.push_back(fmt::format("{}(k-{})", name, text));
  }
  return words::listed(parts);
}

// Most terms of a sum that is written with its factors. A longer sum is written as a list of its samples.
constexpr size_t most_terms = 4;

std::string combination(const Finding& f, bool timed) {
  const char* const end = timed ? " is {constant|constant|zero}{?sines|: the input consists of {sines|one frequency|{sines} frequencies}, but lag order {lags} needs {sines_needed}|}"
                                : " is {constant|constant|zero}";
  if (f.terms.size() > most_terms)
    return fmt::format("a weighted sum of {}{}", timed ? samples(f.terms) : words::listed(names_of(f.channels)), filled(end, f));
  if (!is(f, "varying")) return sum(f.terms, timed) + filled(end, f);
  std::vector<std::string> names;
  for (const Term& term : f.terms) names.push_back(sample(term, timed));
  return fmt::format("a weighted sum of {}, with weights that change from step to step,{}", words::listed(names),
                     filled(" is {constant|constant|zero}", f));
}

// The steps of a combination: all steps, the steps of every experiment, or phases of a period.
std::string where(const Finding& f) {
  const double period = f.numbers.at("period");
  return filled(period == 1 ? "at every step" : period == 0 ? "in every experiment at {@steps}" : "at {@steps} of every period", f);
}

// ---- experiments ----

// "experiments 3 and 5"
std::string experiments(const std::vector<Experiment>& list, size_t most) {
  return (list.size() == 1 ? "experiment " : "experiments ") + listed(list, most);
}

std::string made_of(const Finding& f) {
  constexpr size_t most_groups = 4;
  std::vector<std::string> parts;
  size_t more = 0;
  // Successive copies of one experiment are joined.
  for (size_t i = 0; i < f.experiments.size();) {
    std::vector<Experiment> alike{f.experiments[i]};
    size_t j = i + 1;
    while (j < f.experiments.size() && f.groups[j] == f.groups[i]) alike.push_back(f.experiments[j++]);
    if (parts.size() < most_groups)
      parts.push_back(fmt::format("{} of {}", experiments(alike, most_groups), experiments(f.groups[i], most_groups)));
    else
      more += alike.size();
    i = j;
  }
  const std::string text = fmt::to_string(fmt::join(parts, "; "));
  return more > 0 ? fmt::format("{}; and {}", text, words::plural(Index(more), "more experiment")) : text;
}

// "3 (from step 9 on) and 5 (from step 12 on)"
std::string ended(const Finding& f) {
  constexpr size_t most = 6;
  std::vector<std::string> texts;
  for (size_t i = 0; i < std::min(most, f.experiments.size()); ++i)
    texts.push_back(fmt::format("{} (from step {} on)", experiment(f.experiments[i]), f.steps[i]));
  const size_t more = f.experiments.size() - texts.size();
  return more == 0 ? words::listed(texts) : fmt::format("{} and {} more", fmt::join(texts, ", "), more);
}

// What is known of an experiment that does not fit, and what was done about it.
std::string misfit_details(const Finding& f) {
  const double weight = f.numbers.at("weight");
  return filled(f.channels.empty() ? "" : ". The largest residuals are in output {@channel}", f) +
         filled(weight == 0         ? ". The experiment was dropped"
                : weight < 1        ? ". The experiment counts with the weight {weight~2} instead of 1"
                : is(f, "held_out") ? ". The experiment is held out from the identification, and the fit on held-out data includes its errors"
                                    : "",
                f);
}

std::string about_samples(const Finding& f) {
  const double weight = f.numbers.at("weight");
  constexpr size_t many = 10;
  if (weight == 1 && f.steps.size() >= many && f.steps.back() - f.steps.front() + 1 == Index(f.steps.size()))
    return "So many successive samples may be right, and this experiment may differ from the others. Look at the "
           "experiment. Mark the samples as missing only if they are faulty";
  return filled(weight == 1   ? "If {#steps|this sample is|these samples are} faulty, mark {#steps|it|them} as missing, because faulty samples make the model worse"
                : weight == 0 ? "The {#steps|sample was|samples were} dropped"
                              : "The {#steps|sample was moved towards its prediction|samples were moved towards their predictions}",
                f);
}

// Lists the experiments that the state file contains already: the word "all", the first few names, or ranges of rows.
std::string known(const Finding& f) {
  if (double(f.experiments.size()) == f.numbers.at("experiments"))
    return filled("{#experiments|the experiment is|all {#experiments} experiments are} in the state file already. Nothing is added", f);
  std::vector<Index> rows;
  bool named = false;
  for (const Experiment& e : f.experiments) {
    rows.push_back(e.row);
    named = named || !e.name.empty();
  }
  return fmt::format("{}: {}. {}", filled("{#experiments} of {experiments} experiments {#experiments|is|are} in the state file already", f),
                     named ? listed(f.experiments, 6) : words::ranges(rows),
                     filled("{#experiments|This experiment is|These experiments are} not added again", f));
}

// ---- parts of sentences ----

struct Part {
  std::string_view name;
  std::string (*words)(const Finding& f);
};

constexpr Part parts[] = {
    {"channel", [](const Finding& f) { return f.channels.front().name; }},
    {"last channel", [](const Finding& f) { return f.channels.back().name; }},
    {"channels", [](const Finding& f) { return words::listed(names_of(f.channels)); }},
    {"sides", [](const Finding& f) { return words::listed(names_of(f.channels, true)); }},  // "input u1 and output y2"
    {"own names", [](const Finding& f) { return fmt::to_string(fmt::join(names_of(f.channels), ", ")); }},
    {"names", [](const Finding& f) { return fmt::to_string(fmt::join(f.names, ", ")); }},
    {"unit", [](const Finding& f) { return f.names.at(0); }},
    {"model unit", [](const Finding& f) { return f.names.at(1); }},
    {"compared", [](const Finding& f) { return f.detail.empty() ? "data" : f.detail; }},
    {"detail", [](const Finding& f) { return f.detail; }},
    {"step", [](const Finding& f) { return fmt::to_string(f.steps.front()); }},
    {"last", [](const Finding& f) { return fmt::to_string(f.steps.back()); }},
    {"step before", [](const Finding& f) { return fmt::to_string(f.steps.front() - 1); }},
    {"length", [](const Finding& f) { return words::plural(f.steps.back() + 1, "step"); }},
    {"last framed", [](const Finding& f) { return fmt::to_string(std::llround(f.numbers.at("end")) - 1); }},
    {"steps", [](const Finding& f) { return words::step_list(f.steps); }},
    {"experiment", [](const Finding& f) { return experiment(f.experiments.at(0)); }},
    {"experiment 2", [](const Finding& f) { return experiment(f.experiments.at(1)); }},
    {"experiments", [](const Finding& f) { return experiments(f.experiments, 6); }},
    {"as read", [](const Finding& f) { return filled("the axes of the arrays look swapped: tokid read {experiments experiment} of {steps step} with {inputs input} and {outputs output}", f); }},
    {"sum", [](const Finding& f) { return sum(f.terms, false); }},
    {"combination", [](const Finding& f) { return combination(f, false); }},
    {"timed combination", [](const Finding& f) { return combination(f, true); }},
    {"where", where},
    {"made of", made_of},
    {"ended", ended},
    {"misfit", misfit_details},
    {"about samples", about_samples},
    {"known", known},
};

std::string filled(std::string_view text, const Finding& f) {
  return sentence(text, {f.numbers,
                         [&](std::string_view list) {
                           return list == "channels"      ? Index(f.channels.size())
                                  : list == "experiments" ? Index(f.experiments.size())
                                  : list == "steps"       ? Index(f.steps.size())
                                                          : Index(f.scope == Finding::Scope::first_steps);
                         },
                         [&](std::string_view name) {
                           for (const Part& part : parts)
                             if (part.name == name) return part.words(f);
                           throw std::logic_error(fmt::format("no part {} of finding {}", name, to_string(f.kind)));
                         }});
}

// ---- kinds ----

struct Entry {
  Kind kind;
  const char* name;
  Severity severity;
  const char* text;  // a template, see sentence()
};

constexpr Severity note = Severity::note, warning = Severity::warning;

constexpr Entry table[] = {
    {Kind::reader_remark, "reader_remark", note,
     "{@detail}"},
    {Kind::sample_time_missing, "sample_time_missing", note,
     "the data contain no sample time, so tokid assumes dt = {dt:.6g} s. If the sample time is different, add dt to the data"},
    {Kind::sample_time_of_model, "sample_time_of_model", note,
     "the data contain no sample time, so tokid assumes the model's dt = {dt:.6g} s"},
    {Kind::axes_of_one_experiment, "axes_of_one_experiment", warning,
     "the array u of shape ({steps}, {inputs}) was read as one experiment of {steps step} with {inputs input}. For {steps} experiments with one input, use the shape ({steps}, {inputs}, 1). For one experiment with {steps input}, use the shape ({inputs}, {steps})"},
    {Kind::axes_of_one_step, "axes_of_one_step", warning,
     "{@as read}. For one experiment of {experiments step}, use the shape (1, {experiments}, channels)"},
    {Kind::axes_channels_before_time, "axes_channels_before_time", warning,
     "{@as read}. Use the order (experiments, steps, channels), not (experiments, channels, steps)"},
    {Kind::axes_time_before_experiments, "axes_time_before_experiments", warning,
     "{@as read}. Successive experiments have similar samples, but successive steps do not. Use the order (experiments, steps, channels), not (steps, experiments, channels)"},
    {Kind::input_zero, "input_zero", warning,
     "input {@channel} is zero in every experiment at {@steps}: its effect at these steps can't be identified"},
    {Kind::input_same, "input_same", warning,
     "{?experiments|only one experiment has samples of input {@channel} at {@steps}: its effect at these steps can't be identified|input {@channel} is the same in every experiment at {@steps}: its effect at these steps can't be separated from the mean motion. Vary this input from experiment to experiment}"},
    {Kind::input_zero_throughout, "input_zero_throughout", warning,
     "input {@channel} is zero at every step: its effect can't be identified"},
    {Kind::input_constant_throughout, "input_constant_throughout", warning,
     "input {@channel} has the same value at every step: at most its step response can be identified"},
    {Kind::input_zero_at_phases, "input_zero_at_phases", warning,
     "input {@channel} is zero at {@steps} of every period: its effect at these steps can't be identified"},
    {Kind::output_constant, "output_constant", warning,
     "output {@channel} is constant: nothing about this output can be identified"},
    {Kind::samples_missing, "samples_missing", warning,
     "{@sides} {#channels|is|are} missing in every experiment at {@steps}: the model of these steps is interpolated from neighbouring steps"},
    {Kind::experiments_without_overlap, "experiments_without_overlap", warning,
     "experiment {@experiment} begins at step {@step}, after experiment {@experiment 2} has ended at step {@last}. Experiments without a common step can't be compared. Count the steps or times of each experiment from its beginning"},
    {Kind::early_steps_of_few, "early_steps_of_few", warning,
     "only {@experiments} {#experiments|has|have} samples at {@steps}, before the other experiments begin. A step needs at least {needed} experiments, so nothing about these steps can be identified. Count the steps or times of each experiment from its beginning, or delete these samples"},
    {Kind::late_steps_of_few, "late_steps_of_few", warning,
     "only {@experiments} {#experiments|has|have} samples at {@steps}, after the other experiments have ended. A step needs at least {needed} experiments, so a model that varies over time ends with step {@step before}, and does not use these samples. Measure more experiments of {@length}. If the system does not vary over time, state this (--time-invariant), because tokid then uses all samples"},
    {Kind::inputs_dependent, "inputs_dependent", warning,
     "inputs {@channels} move together ({@combination}) {@where}: their effects at these steps can't be separated from each other"},
    {Kind::input_predictable, "input_predictable", warning,
     "input {@channel} is determined by earlier inputs ({@timed combination}) {@where}: its effect at these steps can't be separated from the effects of the earlier inputs"},
    {Kind::input_feedback, "input_feedback", warning,
     "input {@channel} is determined by the samples before it ({@timed combination}) {@where}. The input is a feedback without independent variation, so its effect at these steps can't be separated from the effects of these samples. Add an independent variation to the input"},
    {Kind::more_dependent_inputs, "more_dependent_inputs", warning,
     "tokid found {count more combination} of dependent inputs. This list does not contain them"},
    {Kind::outputs_dependent, "outputs_dependent", warning,
     "outputs {@channels} move together ({@sum} is {constant|constant|zero}) at all steps: output {@last channel} adds no information to the other outputs"},
    {Kind::output_same, "output_same", warning,
     "output {@channel} is the same in every experiment at {@steps}: nothing about this output can be identified at these steps"},
    {Kind::output_stuck, "output_stuck", warning,
     "output {@channel} stays at {value~} in experiment {@experiment} at steps {@step}–{@last}, while the inputs of this experiment move. Check whether the sensor of this output was stuck"},
    {Kind::more_stuck_outputs, "more_stuck_outputs", warning,
     "output {@channel} also stays at one value in {count more experiment}"},
    {Kind::experiments_end_early, "experiments_end_early", warning,
     "all inputs and outputs stay constant to the last step in {#experiments|experiment|experiments} {@ended}. If {#experiments|this experiment|these experiments} stopped early, replace these samples by NaN, or state the {#experiments|length of the experiment|lengths of the experiments}"},
    {Kind::angle_wraps, "angle_wraps", warning,
     "output {@channel} jumps by a whole turn ({turn:.4g}) {count|once|{count} times}, first in experiment {@experiment} at step {@step}. It looks like an angle between two limits. Unwrap the angle, for example by numpy.unwrap"},
    {Kind::experiments_empty, "experiments_empty", warning,
     "{#experiments} of {experiments} experiments {#experiments|has|have} no samples: {@experiments}. {#experiments|This experiment is|These experiments are} not used"},
    {Kind::experiments_copied, "experiments_copied", warning,
     "{#experiments} of {experiments} experiments {#experiments|is a copy of another experiment|are copies of other experiments}, within rounding: {@made of}. {#first steps|An identification in blocks uses these experiments, too. If they agree at all steps, delete them from the data, or identify with --block all|{#experiments|The copy is|The copies are} not used}"},
    {Kind::inputs_repeated, "inputs_repeated", warning,
     "{experiments experiment} have only {courses different input signal}. Experiments with the same inputs show the noise, but excite the system no more than one of them. Lag order {lags} needs at least {needed} different input signals"},
    {Kind::experiment_outlying, "experiment_outlying", warning,
     "experiment {@experiment} does not fit the other experiments: with models of the other experiments, its residuals are {ratio*} times as large as those of the other experiments{@misfit}"},
    {Kind::more_outlying_experiments, "more_outlying_experiments", warning,
     "{count|1 more experiment does|{count} more experiments do} not fit the other experiments: check that all experiments are runs of one system, in the same units"},
    {Kind::samples_outlying, "samples_outlying", warning,
     "experiment {@experiment}, output {@channel}, {@steps}: {#steps|1 sample deviates|{#steps} samples deviate} by up to {error~} from {#steps|its prediction|their predictions} (median prediction error of all experiments: {usual~2}). {@about samples}"},
    {Kind::more_outlying_samples, "more_outlying_samples", warning,
     "{count more output} with samples that deviate strongly from their predictions. This list does not contain them"},
    {Kind::outliers_undecided, "outliers_undecided", warning,
     "{count|1 more experiment does|{count} more experiments do} not fit the other experiments. tokid used them all the same, because it drops or downweights at most a quarter of the experiments (here {most}). Check whether all experiments are runs of one system"},
    {Kind::many_misfits, "many_misfits", warning,
     "the innovations of {@experiments} are much larger than those of the other experiments. tokid used these experiments, because they are too many to be outliers. The model may be too simple for their inputs, or the experiments may come from two systems. Check these experiments, or identify them separately"},
    {Kind::ill_conditioned, "ill_conditioned", warning,
     "the regressions are ill-conditioned (condition number above {condition~}) at {@steps}: their coefficients have few correct digits"},
    {Kind::too_few_complete, "too_few_complete", warning,
     "missing samples leave fewer experiments than the regression has unknowns ({unknowns}) at {@steps}: tokid uses the solution of smallest norm at these steps"},
    {Kind::inputs_unexcited, "inputs_unexcited", warning,
     "the inputs of neighbouring steps and channels are linearly dependent in all experiments at {@steps}: their effects at these steps can't be separated from each other"},
    {Kind::no_freedom, "no_freedom", warning,
     "{experiments} experiments leave no degree of freedom at lag order {lags}: the regressions fit any data exactly, and the noise can't be estimated. Use {sufficient} experiments or more"},
    {Kind::few_experiments, "few_experiments", warning,
     "{experiments} experiments are few for the {unknowns} unknowns per output and step at lag order {lags}: averaging hardly reduces the noise of the coefficients. Use {sufficient} experiments or more. With {experiments} experiments, use lag orders up to {largest_lags}"},
    {Kind::lags_at_limit, "lags_at_limit", warning,
     "the chosen lag order {lags} is the largest that {?unknowns|was tried, because larger ones have more than {unknowns} unknowns per output|{experiments} experiments can test}. A larger lag order may be better: {?unknowns|state the lag order|use more experiments, or state the lag order}"},
    {Kind::lags_untested, "lags_untested", warning,
     "{experiments} experiments leave no degree of freedom to test lag order {lags}: a regression of this lag order fits any data exactly"},
    {Kind::lags_below_states, "lags_below_states", warning,
     "lag order {lags} with {outputs} outputs allows at most {most} states, but {states} states were asked for. State a larger lag order, or fewer states"},
    {Kind::smoothing_untested, "smoothing_untested", warning,
     "a single record is too little data to choose the smoothing lambda. tokid uses lambda = {smoothing~}"},
    {Kind::smoothing_by_gaps, "smoothing_by_gaps", warning,
     "because of missing samples, too few windows without a gap remain, so variation over time cannot be estimated from these data. The regressions use the smoothing lambda = {smoothing~}, and EM chooses a lambda of its own"},
    {Kind::no_variation, "no_variation", note,
     "tokid uses one model for all steps, because models that vary over time do not predict better"},
    {Kind::feedthrough_or_feedback, "feedthrough_or_feedback", warning,
     "input {@channel} and output {@last channel} are correlated within a step, and the inputs depend on earlier outputs. The data do not show whether feedthrough or feedback within the step causes this correlation, so D may be wrong. If the controller uses the output of the same step, state that there is no feedthrough (--no-feedthrough). Otherwise, state that there is feedthrough (--feedthrough)"},
    {Kind::few_windows, "few_windows", warning,
     "the data have only {windows window} of {length} successive steps{gaps| without a gap|}. This is few for the {unknowns} unknowns per output at lag order {lags}. Validate the model on other data"},
    {Kind::few_for_states, "few_for_states", warning,
     "{experiments experiment} are fewer than the {unknowns} unknowns that each row of A and B, or of C and D, has at every step: smoothing over time replaces the missing information. Validate the model on other data"},
    {Kind::free_response_single, "free_response_single", warning,
     "the free response was not used: a single free response equals its own mean motion, so it is zero after the mean motion is removed"},
    {Kind::free_responses_unused, "free_responses_unused", warning,
     "{count|the free response was|the {count} free responses were} not used: the subspace realisation needs no free responses. --method tvera uses free responses"},
    {Kind::free_responses_partial, "free_responses_partial", warning,
     "the {count} free responses show all {states} states only from step {step} on. They should show them from step {wanted} on"},
    {Kind::no_states, "no_states", warning,
     "no state was found: the outputs respond to the inputs of the same step only, or not at all"},
    {Kind::states_below_asked, "states_below_asked", warning,
     "{asked} states were asked for, but the Hankel matrices have at most rank {found}: the model has {found} states"},
    {Kind::regression_kept, "regression_kept", note,
     "the regression on {lags} lags predicts held-out experiments better than models of fewer states, so the model is this regression, with {states} states"},
    {Kind::states_hidden, "states_hidden", warning,
     "the Hankel matrices have a rank below {states} at {@steps}: the outputs do not show all states at these steps, or the inputs do not reach all states. The model has fewer states at these steps"},
    {Kind::gains_grow, "gains_grow", warning,
     "the Kalman gains at {@steps} are up to {ratio*} times as large as usual. The outputs hardly determine a direction of the state at these steps. Use fewer states, or do not use the observer or a controller there"},
    {Kind::late_begin, "late_begin", note,
     "the initial states are unknown, so the model begins at step {step}, the first step with the full state dimension"},
    {Kind::frame_limits, "frame_limits", note,
     "only steps {begin} to {@last framed} are in the reference frame of step {step}. At the other steps, the states keep their own coordinates"},
    {Kind::uncertain_ahead, "uncertain_ahead", warning,
     "in cross-validation, the errors of predictions {horizon} steps ahead are {ratio~2} times as large as the covariances of the models say. There are too few experiments for a system that varies like this, or the noise is not white. Use more experiments, and test long predictions and controllers on other data"},
    {Kind::model_errs_ahead, "model_errs_ahead", warning,
     "in predictions {horizon} steps ahead, up to {share%} % of the error variance comes from errors of the model. This is an estimate from the differences between models of different parts of the experiments. Use more experiments, and test long predictions and controllers on other data"},
    {Kind::em_unreliable, "em_unreliable", warning,
     "the model of EM predicts all experiments worse than the models of cross-validation predicted the held-out folds. The result of EM may be wrong"},
    {Kind::em_worse_one_step, "em_worse_one_step", note,
     "EM made the predictions better in cross-validation, but made the predictions of the whole data worse. tokid dropped the result of EM"},
    {Kind::em_worse_ahead, "em_worse_ahead", note,
     "EM made the model better in cross-validation, but made the predictions of the whole data many steps ahead worse. tokid dropped the result of EM"},
    {Kind::em_no_noise, "em_no_noise", note,
     "some combinations of states and of outputs have no noise, so the likelihood has no maximum. For these combinations, EM sets the noise covariances Q and R to 1e-12 times the mean squares of the signals"},
    {Kind::em_no_measurement_noise, "em_no_measurement_noise", note,
     "EM finds no measurement noise in some combination of outputs: for this combination, EM sets the covariance R to 1e-12 times the mean squares of the outputs"},
    {Kind::em_no_process_noise, "em_no_process_noise", note,
     "EM finds no process noise in some combination of states: for this combination, EM sets the covariance Q to 1e-12 times the mean squares of the states"},
    {Kind::em_not_converged, "em_not_converged", warning,
     "EM has not converged after {iterations iteration}: the last iteration increased the log-likelihood per output sample by {gain~2}"},
    {Kind::em_few_experiments, "em_few_experiments", warning,
     "{experiments experiment} are few for the {unknowns} unknowns that each row of A and B, or of C and D, has at every step. Use smoothing over time (lambda above zero)"},
    {Kind::em_fewer_than_unknowns, "em_fewer_than_unknowns", warning,
     "{experiments|1 experiment is fewer|{experiments} experiments are fewer} than the {unknowns} unknowns that each row of A and B, or of C and D, has at every step: smoothing over time replaces the missing information, and the fit on these data is no test of the model"},
    {Kind::em_extended, "em_extended", note,
     "the data have {steps step}, but the model ended with step {last}. For the later steps, EM started from the matrices of this last step"},
    {Kind::em_shortened, "em_shortened", note,
     "the data have {steps step}, but the model ended with step {last}. The new model ends with the last step of the data"},
    {Kind::output_unpredicted, "output_unpredicted", warning,
     "the one-step predictions of output {@channel} are no better than the mean of this output (fit {fit~} %)"},
    {Kind::output_missimulated, "output_missimulated", warning,
     "the simulation of output {@channel} is worse than the mean of this output (fit {fit~} %)"},
    {Kind::output_still, "output_still", warning,
     "output {@channel} is constant in the new experiments"},
    {Kind::sample_time_differs, "sample_time_differs", warning,
     "the {@compared}'s dt = {data:.6g} s differs from the model's dt = {model:.6g} s{stated||, which was identified from data without a sample time}"},
    {Kind::input_names_differ, "input_names_differ", warning,
     "the {@compared}'s inputs are named {@own names}, but the model's inputs are named {@names}"},
    {Kind::output_names_differ, "output_names_differ", warning,
     "the {@compared}'s outputs are named {@own names}, but the model's outputs are named {@names}"},
    {Kind::units_differ, "units_differ", warning,
     "the {@compared}'s {@sides} has the unit {@unit}, but this channel of the model has the unit {@model unit}. tokid does not convert units"},
    {Kind::model_ends_early, "model_ends_early", warning,
     "the model ends with step {last}, so it does not cover the last {steps step} of the data"},
    {Kind::nothing_predicted, "nothing_predicted", warning,
     "no step could be predicted: the model covers steps {begin} to {end}, and {needed} steps are needed to find an unknown initial state"},
    {Kind::nothing_predicted_ahead, "nothing_predicted_ahead", warning,
     "no step could be predicted {horizon} steps ahead. Use a smaller horizon"},
    {Kind::simulation_overflows, "simulation_overflows", warning,
     "the simulated outputs overflow, because the model is unstable over its steps"},
    {Kind::outputs_absent, "outputs_absent", warning,
     "all computed outputs are missing (NaN): the model gives no output at any step of the data"},
    {Kind::simulated_from, "simulated_from", note,
     "the initial states are unknown: the simulation starts from the {@detail} at step {step}, where the model begins"},
    {Kind::exact_first_steps, "exact_first_steps", warning,
     "the first steps, on which tokid made its choices, are free of noise, but later steps are noisy. State --method subspace or --lags"},
    {Kind::constant_first_steps, "constant_first_steps", note,
     "the first steps, on which tokid made its choices, show no variation over time, but the system may vary later. tokid uses the smoothing lambda = {smoothing~}"},
    {Kind::experiments_known, "experiments_known", note,
     "{@known}"},
    {Kind::state_without_digests, "state_without_digests", warning,
     "an earlier version of tokid began the state file, which has no digests of {count experiment}. If one of these experiments is added again, tokid does not notice it, and the experiment counts twice. To avoid this, make a new state file with identify --state"},
    {Kind::update_noisy, "update_noisy", warning,
     "the experiments are noisy, but the choices in the state file assume data without noise. Identify again from all experiments"},
    {Kind::update_few_experiments, "update_few_experiments", warning,
     "there are fewer experiments than unknowns at {@steps}: tokid uses the solution of smallest norm at these steps"},
    {Kind::update_states_below, "update_states_below", warning,
     "{asked} states were asked for, but the experiments show only {found} states"},
    {Kind::bounds_of_other_data, "bounds_of_other_data", warning,
     "the model was not identified from these data, but bounds need the data of its identification"},
    {Kind::no_eigenvalue_bounds, "no_eigenvalue_bounds", warning,
     "no bounds of the eigenvalues were computed: {@detail}"},
    {Kind::replicates_failed, "replicates_failed", warning,
     "{failed} of {replicates} replicates of the bootstrap could not be identified"},
    {Kind::bounds_of_other_model, "bounds_of_other_model", warning,
     "an identification from these data with the options of the model gives another model. The bounds belong to that other model"},
    {Kind::bounds_with_bias, "bounds_with_bias", warning,
     "do not rely on the bounds at {@steps}: at these steps, the smoothing lambda = {smoothing~} changes the estimates more than the noise does. The system may change faster than lambda permits, for example at a jump"},
    {Kind::bounds_without_bias, "bounds_without_bias", warning,
     "the bounds do not include the bias of the smoothing lambda = {smoothing~}, because no model with weaker smoothing could be identified. The bounds are too narrow where the system changes fast"},
    {Kind::bounds_of_constant_system, "bounds_of_constant_system", note,
     "the bounds assume that the system does not vary over time. The bounds do not include variations that are too small to be found"},
    {Kind::plan_of_departures, "plan_of_departures", note,
     "the planned inputs are departures from the nominal trajectory: add the nominal trajectory of the model to them"},
    {Kind::plan_windows_sampled, "plan_windows_sampled", note,
     "because each window has {inputs} inputs, their condition number was computed for only {sampled} of {windows} windows"},
    {Kind::plan_late_forecasts, "plan_late_forecasts", note,
     "the model begins at step {step}, so tokid computes no forecasts and no optimal inputs for the windows before step {first}. The forecasts of the later windows assume a zero state at step {step}"},
    {Kind::plan_unknown_states, "plan_unknown_states", note,
     "the initial states are unknown: the forecasts assume zero initial states"},
    {Kind::plan_model_uncertain, "plan_model_uncertain", warning,
     "the innovations of the preliminary model have {share~} % of the size of the outputs that it forecasts. Above {bound~} %, inputs optimised with this model can be worse than orthogonal inputs"},
    {Kind::plan_no_freedom, "plan_no_freedom", warning,
     "{experiments} experiments leave no degree of freedom: the regressions will fit any data exactly, and the noise can't be estimated. If the data have noise, use more experiments"},
    {Kind::plan_below_recommendation, "plan_below_recommendation", warning,
     "the plan has {experiments} experiments, but {recommended} are recommended with this noise. Use more experiments"},
    {Kind::plan_rank_by_noise, "plan_rank_by_noise", warning,
     "the lag order times the outputs (p·m = {lags_outputs}) exceeds the states (n = {states}). Without noise, the regressions have {unknowns} unknowns, but at most rank {rank}: noise alone determines the other directions"},
    {Kind::plan_noisy_input, "plan_noisy_input", warning,
     "the noise on input {@channel} is {share~} % of the RMS value of the input. If the recorded input contains this noise, the coefficients are too small by {bias~} %"},
    {Kind::plan_inputs_dependent, "plan_inputs_dependent", warning,
     "the planned inputs are nearly linearly dependent in {windows window} (condition number above {condition~}). Use another kind of inputs, another seed or more experiments"},
    {Kind::plan_ill_conditioned, "plan_ill_conditioned", warning,
     "the model forecasts a condition number above {condition~} in {windows window}. Use more experiments, or other limits of the inputs"},
};

static_assert(lists_each_in_order(table, &Entry::kind));

const Entry& entry(Kind kind) { return table[size_t(kind)]; }

}  // namespace

const char* to_string(Severity severity) { return severity == Severity::note ? "note" : "warning"; }

const char* to_string(Finding::Scope scope) {
  switch (scope) {
    case Finding::Scope::first_steps:
      return "first_steps";
    case Finding::Scope::new_experiments:
      return "new_experiments";
    case Finding::Scope::cross_validation:
      return "cross_validation";
    case Finding::Scope::folds:
      return "folds";
    case Finding::Scope::all:
      break;
  }
  return "all";
}

const char* to_string(Finding::Kind kind) { return entry(kind).name; }

Severity severity(Finding::Kind kind) { return entry(kind).severity; }

std::string in_words(const Finding& finding) {
  const std::string text = (finding.file.empty() ? "" : finding.file + ": ") + filled(entry(finding.kind).text, finding);
  switch (finding.scope) {
    case Finding::Scope::first_steps:
      return "in the first steps, on which tokid made its choices, " + text;
    case Finding::Scope::new_experiments:
      return fmt::format(
          "test of the old model on the new experiments: {}. Check that the new experiments are runs of the same system with the same channels",
          text);
    case Finding::Scope::cross_validation:
      return "cross-validation: " + text;
    case Finding::Scope::folds:
      return filled("cross-validation, {folds_with} of {folds} folds: ", finding) + text;
    case Finding::Scope::all:
      break;
  }
  return text;
}

std::vector<std::string> in_words(const Findings& findings) {
  std::vector<std::string> result;
  for (const Finding& finding : findings) result.push_back(in_words(finding));
  return result;
}

bool same_words(const Finding& a, const Finding& b) { return in_words(a) == in_words(b); }

void append(Findings& all, Findings more) {
  all.insert(all.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
}

}  // namespace tokid
