// The sentences of all findings, in the order of their kinds.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/finding.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include "base/enum_table.hpp"
#include "base/words.hpp"

namespace tokid {

namespace {

using Kind = Finding::Kind;
using Channel = Finding::Channel;
using Experiment = Finding::Experiment;
using Term = Finding::Term;

// \throws std::logic_error if the finding has no number of this name
double number(const Finding& f, const char* name) {
  const auto found = f.numbers.find(name);
  if (found == f.numbers.end()) throw std::logic_error(fmt::format("finding {}: no {}", to_string(f.kind), name));
  return found->second;
}
std::string figure(const Finding& f, const char* name) { return words::figure(number(f, name)); }
Index count(const Finding& f, const char* name) { return Index(std::llround(number(f, name))); }
bool is(const Finding& f, const char* name) { return number(f, name) == 1; }

const std::string& channel(const Finding& f) { return f.channels.front().name; }
std::string experiment(const Experiment& e) { return words::experiment(e.row, e.name); }

// Lists the first `most` experiments, and the number of the other experiments.
std::string listed(const std::vector<Experiment>& experiments, size_t most) {
  std::vector<std::string> names;
  for (size_t i = 0; i < std::min(experiments.size(), most); ++i) names.push_back(experiment(experiments[i]));
  if (experiments.size() <= most) return words::listed(names);
  return fmt::format("{} and {} more", fmt::join(names, ", "), experiments.size() - most);
}

std::string names_of(const std::vector<Channel>& channels) {
  std::vector<std::string> names;
  for (const Channel& c : channels) names.push_back(c.name);
  return words::listed(names);
}

// "input u1 and output y2"
std::string sides_and_names(const std::vector<Channel>& channels) {
  std::vector<std::string> names;
  for (const Channel& c : channels) names.push_back((c.output ? "output " : "input ") + c.name);
  return words::listed(names);
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

std::string sines(const Finding& f) {
  if (f.numbers.count("sines") == 0) return "";
  const Index sines = count(f, "sines");
  return fmt::format(": the input consists of {}, but lag order {} needs {}",
                     sines == 1 ? "one frequency" : fmt::format("{} frequencies", sines), count(f, "lags"),
                     count(f, "sines_needed"));
}

std::string combination(const Finding& f, bool timed) {
  const char* what = is(f, "constant") ? "constant" : "zero";
  if (f.terms.size() > most_terms)
    return timed ? fmt::format("a weighted sum of {} is {}{}", samples(f.terms), what, sines(f))
                 : fmt::format("a weighted sum of {} is {}", names_of(f.channels), what);
  if (!is(f, "varying")) return fmt::format("{} is {}{}", sum(f.terms, timed), what, timed ? sines(f) : "");
  std::vector<std::string> names;
  for (const Term& term : f.terms) names.push_back(sample(term, timed));
  return fmt::format(
      "a weighted sum of {}, with weights that change from step to step, is {}",
      words::listed(names), what);
}

// The steps of a combination: all steps, the steps of every experiment, or phases of a period.
std::string where(const Finding& f) {
  const Index period = count(f, "period");
  if (period == 1) return "at every step";
  return period == 0 ? "in every experiment at " + words::step_list(f.steps)
                     : fmt::format("at {} of every period", words::step_list(f.steps));
}

// ---- dependent experiments ----

// "experiments 3 and 5"
std::string experiments(const std::vector<Experiment>& list, size_t most) {
  return (list.size() == 1 ? "experiment " : "experiments ") + listed(list, most);
}

// "experiment 3 has", "experiments 3 and 5 have"
std::string having(const Finding& f) {
  return experiments(f.experiments, 6) + (f.experiments.size() == 1 ? " has" : " have");
}

std::string made_of(const Finding& f, const char* one, const char* several) {
  constexpr size_t most_groups = 4;
  std::vector<std::string> parts;
  size_t more = 0;
  // Successive copies of one experiment are joined.
  for (size_t i = 0; i < f.experiments.size();) {
    std::vector<Experiment> alike{f.experiments[i]};
    size_t j = i + 1;
    while (f.kind == Kind::experiments_copied && j < f.experiments.size() && f.groups[j] == f.groups[i])
      alike.push_back(f.experiments[j++]);
    if (parts.size() < most_groups)
      parts.push_back(fmt::format("{} of {}", experiments(alike, most_groups), experiments(f.groups[i], most_groups)));
    else
      more += alike.size();
    i = j;
  }
  std::string text =
      fmt::format("{} of {} experiments {}, within rounding: {}", f.experiments.size(), count(f, "experiments"),
                  f.experiments.size() == 1 ? one : several, fmt::join(parts, "; "));
  if (more > 0) text += fmt::format("; and {}", words::plural(Index(more), "more experiment"));
  return text;
}

// What the identification does with copies and dependent experiments.
std::string consequence(const Finding& f) {
  if (f.scope == Finding::Scope::first_steps)
    return "An identification in blocks uses these experiments, too. If they agree at all steps, delete them from the data, or identify with --block all";
  if (f.kind == Kind::experiments_copied) return f.experiments.size() == 1 ? "The copy is not used" : "The copies are not used";
  return f.experiments.size() == 1 ? "This experiment adds no information and is not used"
                                   : "These experiments add no information and are not used";
}

// What is known of an experiment that does not fit, and what was done about it.
std::string misfit_details(const Finding& f) {
  std::string text;
  if (!f.channels.empty() && !f.explanation) text += fmt::format(". The largest residuals are in output {}", channel(f));
  if (f.explanation) text += ". " + in_words(*f.explanation);
  const double weight = number(f, "weight");
  if (weight == 0)
    text += ". The experiment was dropped";
  else if (weight < 1)
    text += fmt::format(". The experiment counts with the weight {} instead of 1", words::figure(weight, 2));
  else if (is(f, "held_out"))
    text += ". The experiment is held out from the identification, and the fit on held-out data includes its errors";
  return text;
}

std::string about_samples(const Finding& f) {
  const bool one = f.steps.size() == 1;
  const double weight = number(f, "weight");
  constexpr size_t many = 10;
  if (weight == 1 && f.steps.size() >= many && f.steps.back() - f.steps.front() + 1 == Index(f.steps.size()))
    return "So many successive samples may be right, and this experiment may differ from the others. Look at the "
           "experiment. Mark the samples as missing only if they are faulty";
  if (weight == 1)
    return fmt::format("If {} faulty, mark {} as missing, because faulty samples make the model worse",
                       one ? "this sample is" : "these samples are", one ? "it" : "them");
  if (weight == 0) return one ? "The sample was dropped" : "The samples were dropped";
  return one ? "The sample was moved towards its prediction" : "The samples were moved towards their predictions";
}

// A ratio with two digits.
std::string times(double ratio) {
  if (ratio >= 1e4) return "more than 10000";
  const double unit = ratio >= 1000 ? 100 : ratio >= 100 ? 10 : ratio >= 10 ? 1 : 0.1;
  return fmt::format("{:.{}f}", std::round(ratio / unit) * unit, unit < 1 ? 1 : 0);
}

std::string windows(const Finding& f) {
  return fmt::format("the data have only {} of {} successive steps{}", words::plural(count(f, "windows"), "window"),
                     count(f, "length"), is(f, "gaps") ? " without a gap" : "");
}

std::string as_read(const Finding& f) {
  return fmt::format("the axes of the arrays look swapped: tokid read {} of {} with {} and {}",
                     words::plural(count(f, "experiments"), "experiment"), words::plural(count(f, "steps"), "step"),
                     words::plural(count(f, "inputs"), "input"), words::plural(count(f, "outputs"), "output"));
}

// Lists the experiments that the state file contains already: the word "all", the first few names, or ranges of rows.
std::string known(const Finding& f) {
  const Index found = Index(f.experiments.size()), all = count(f, "experiments");
  if (found == all)
    return fmt::format("{} in the state file already. Nothing is added",
                       found == 1 ? "the experiment is" : fmt::format("all {} experiments are", found));
  std::vector<Index> rows;
  bool named = false;
  for (const Experiment& e : f.experiments) {
    rows.push_back(e.row);
    named = named || !e.name.empty();
  }
  return fmt::format("{} of {} experiments {} in the state file already: {}. {} not added again", found, all,
                     found == 1 ? "is" : "are", named ? listed(f.experiments, 6) : words::ranges(rows),
                     found == 1 ? "This experiment is" : "These experiments are");
}

// What differs from the model: the data, or what `detail` names.
std::string compared(const Finding& f) { return f.detail.empty() ? "data" : f.detail; }

std::string names_differ(const Finding& f, const char* side) {
  std::vector<std::string> found;
  for (const Channel& c : f.channels) found.push_back(c.name);
  return fmt::format(
      "the {}'s {} are named {}, but the model's {} are named {}",
      compared(f), side, fmt::join(found, ", "), side,
      fmt::join(f.names, ", "));
}

struct Entry {
  Kind kind;
  const char* name;
  Severity severity;
  std::string (*words)(const Finding& f);
};

constexpr Severity note = Severity::note, warning = Severity::warning;

constexpr Entry table[] = {
    {Kind::reader_remark, "reader_remark", note, [](const Finding& f) { return f.detail; }},
    {Kind::sample_time_missing, "sample_time_missing", note,
     [](const Finding& f) {
       return fmt::format(
           "the data contain no sample time, so tokid assumes dt = {:.6g} s. If the sample time is different, add dt to the data",
           number(f, "dt"));
     }},
    {Kind::sample_time_of_model, "sample_time_of_model", note,
     [](const Finding& f) {
       return fmt::format(
           "the data contain no sample time, so tokid assumes the model's dt = {:.6g} s",
           number(f, "dt"));
     }},
    {Kind::axes_of_one_experiment, "axes_of_one_experiment", warning,
     [](const Finding& f) {
       return fmt::format(
           "the array u of shape ({0}, {1}) was read as one experiment of {2} with {3}. For {0} experiments with one input, use the shape ({0}, {1}, 1). For one experiment with {4}, use the shape ({1}, {0})",
           count(f, "steps"), count(f, "inputs"), words::plural(count(f, "steps"), "step"),
           words::plural(count(f, "inputs"), "input"), words::plural(count(f, "steps"), "input"));
     }},
    {Kind::axes_of_one_step, "axes_of_one_step", warning,
     [](const Finding& f) {
       return fmt::format("{}. For one experiment of {}, use the shape (1, {}, channels)", as_read(f),
                          words::plural(count(f, "experiments"), "step"), count(f, "experiments"));
     }},
    {Kind::axes_channels_before_time, "axes_channels_before_time", warning,
     [](const Finding& f) { return as_read(f) + ". Use the order (experiments, steps, channels), not (experiments, channels, steps)"; }},
    {Kind::axes_time_before_experiments, "axes_time_before_experiments", warning,
     [](const Finding& f) {
       return as_read(f) +
              ". Successive experiments have similar samples, but successive steps do not. Use the order (experiments, steps, channels), not (steps, experiments, channels)";
     }},
    {Kind::input_zero, "input_zero", warning,
     [](const Finding& f) {
       return fmt::format("input {} is zero in every experiment at {}: its effect at these steps can't be identified",
                          channel(f), words::step_list(f.steps));
     }},
    {Kind::input_same, "input_same", warning,
     [](const Finding& f) {
       if (f.numbers.count("experiments") > 0)
         return fmt::format(
             "only one experiment has samples of input {} at {}: its effect at these steps can't be identified",
             channel(f), words::step_list(f.steps));
       return fmt::format(
           "input {} is the same in every experiment at {}: its effect at these steps can't be separated from the mean motion. Vary this input from experiment to experiment",
           channel(f), words::step_list(f.steps));
     }},
    {Kind::input_zero_throughout, "input_zero_throughout", warning,
     [](const Finding& f) {
       return fmt::format("input {} is zero at every step: its effect can't be identified", channel(f));
     }},
    {Kind::input_constant_throughout, "input_constant_throughout", warning,
     [](const Finding& f) {
       return fmt::format("input {} has the same value at every step: at most its step response can be identified",
                          channel(f));
     }},
    {Kind::input_zero_at_phases, "input_zero_at_phases", warning,
     [](const Finding& f) {
       return fmt::format(
           "input {} is zero at {} of every period: its effect at these steps can't be identified",
           channel(f), words::step_list(f.steps));
     }},
    {Kind::output_constant, "output_constant", warning,
     [](const Finding& f) {
       return fmt::format("output {} is constant: nothing about this output can be identified", channel(f));
     }},
    {Kind::samples_missing, "samples_missing", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} {} missing in every experiment at {}: the model of these steps is interpolated from neighbouring steps",
           sides_and_names(f.channels), f.channels.size() == 1 ? "is" : "are", words::step_list(f.steps));
     }},
    {Kind::experiments_without_overlap, "experiments_without_overlap", warning,
     [](const Finding& f) {
       return fmt::format(
           "experiment {} begins at step {}, after experiment {} has ended at step {}. Experiments without a common step can't be compared. Count the steps or times of each experiment from its beginning",
           experiment(f.experiments[0]), f.steps[0], experiment(f.experiments[1]), f.steps[1]);
     }},
    {Kind::early_steps_of_few, "early_steps_of_few", warning,
     [](const Finding& f) {
       return fmt::format(
           "only {} samples at {}, before the other experiments begin. A step needs at least {} experiments, so nothing about these steps can be identified. Count the steps or times of each experiment from its beginning, or delete these samples",
           having(f), words::step_list(f.steps), count(f, "needed"));
     }},
    {Kind::late_steps_of_few, "late_steps_of_few", warning,
     [](const Finding& f) {
       return fmt::format(
           "only {} samples at {}, after the other experiments have ended. A step needs at least {} experiments, so a model that varies over time ends with step {}, and does not use these samples. Measure more experiments of {}. If the system does not vary over time, state this (--time-invariant), because tokid then uses all samples",
           having(f), words::step_list(f.steps), count(f, "needed"), f.steps.front() - 1,
           words::plural(f.steps.back() + 1, "step"));
     }},
    {Kind::inputs_dependent, "inputs_dependent", warning,
     [](const Finding& f) {
       return fmt::format(
           "inputs {} move together ({}) {}: their effects at these steps can't be separated from each other",
           names_of(f.channels), combination(f, false), where(f));
     }},
    {Kind::input_predictable, "input_predictable", warning,
     [](const Finding& f) {
       return fmt::format(
           "input {} is determined by earlier inputs ({}) {}: its effect at these steps can't be separated from the effects of the earlier inputs",
           channel(f), combination(f, true), where(f));
     }},
    {Kind::input_feedback, "input_feedback", warning,
     [](const Finding& f) {
       return fmt::format(
           "input {} is determined by the samples before it ({}) {}. The input is a feedback without independent variation, so its effect at these steps can't be separated from the effects of these samples. Add an independent variation to the input",
           channel(f), combination(f, true), where(f));
     }},
    {Kind::more_dependent_inputs, "more_dependent_inputs", warning,
     [](const Finding& f) {
       return fmt::format("tokid found {} of dependent inputs. This list does not contain them",
                          words::plural(count(f, "count"), "more combination"));
     }},
    {Kind::outputs_dependent, "outputs_dependent", warning,
     [](const Finding& f) {
       return fmt::format(
           "outputs {} move together ({} is {}) at all steps: output {} adds no information to the other outputs",
           names_of(f.channels), sum(f.terms, false), is(f, "constant") ? "constant" : "zero", f.channels.back().name);
     }},
    {Kind::output_same, "output_same", warning,
     [](const Finding& f) {
       return fmt::format(
           "output {} is the same in every experiment at {}: nothing about this output can be identified at these steps",
           channel(f), words::step_list(f.steps));
     }},
    {Kind::output_stuck, "output_stuck", warning,
     [](const Finding& f) {
       return fmt::format(
           "output {} stays at {} in experiment {} at steps {}–{}, while the inputs of this experiment move. Check whether the sensor of this output was stuck",
           channel(f), figure(f, "value"), experiment(f.experiments[0]), f.steps.front(), f.steps.back());
     }},
    {Kind::more_stuck_outputs, "more_stuck_outputs", warning,
     [](const Finding& f) {
       return fmt::format("output {} also stays at one value in {}", channel(f),
                          words::plural(count(f, "count"), "more experiment"));
     }},
    {Kind::experiments_end_early, "experiments_end_early", warning,
     [](const Finding& f) {
       constexpr size_t most = 6;
       std::vector<std::string> texts;
       for (size_t i = 0; i < std::min(most, f.experiments.size()); ++i)
         texts.push_back(fmt::format("{} (from step {} on)", experiment(f.experiments[i]), f.steps[i]));
       const size_t more = f.experiments.size() - texts.size();
       const std::string named = more == 0 ? words::listed(texts) : fmt::format("{} and {} more", fmt::join(texts, ", "), more);
       return fmt::format(
           "all inputs and outputs stay constant to the last step in {} {}. If {} stopped early, replace these samples by NaN, or state the {}",
           f.experiments.size() == 1 ? "experiment" : "experiments", named,
           f.experiments.size() == 1 ? "this experiment" : "these experiments",
           f.experiments.size() == 1 ? "length of the experiment" : "lengths of the experiments");
     }},
    {Kind::angle_wraps, "angle_wraps", warning,
     [](const Finding& f) {
       return fmt::format(
           "output {} jumps by a whole turn ({:.4g}) {}, first in experiment {} at step {}. It looks like an angle between two limits. Unwrap the angle, for example by numpy.unwrap",
           channel(f), number(f, "turn"), count(f, "count") == 1 ? "once" : fmt::format("{} times", count(f, "count")),
           experiment(f.experiments[0]), f.steps.front());
     }},
    {Kind::experiments_empty, "experiments_empty", warning,
     [](const Finding& f) {
       const bool one = f.experiments.size() == 1;
       return fmt::format("{} of {} experiments {} no samples: {}. {} not used", f.experiments.size(),
                          count(f, "experiments"), one ? "has" : "have", experiments(f.experiments, 6),
                          one ? "This experiment is" : "These experiments are");
     }},
    {Kind::experiments_copied, "experiments_copied", warning,
     [](const Finding& f) {
       return fmt::format(
           "{}. {}",
           made_of(f, "is a copy of another experiment", "are copies of other experiments"), consequence(f));
     }},
    {Kind::experiments_dependent, "experiments_dependent", warning,
     [](const Finding& f) {
       return fmt::format(
           "{}. {}",
           made_of(f, "is a sum or multiple of other experiments", "are sums or multiples of other experiments"),
           consequence(f));
     }},
    {Kind::inputs_repeated, "inputs_repeated", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} have only {}. Experiments with the same inputs show the noise, but excite the system no more than one of them. Lag order {} needs at least {} different input signals",
           words::plural(count(f, "experiments"), "experiment"),
           words::plural(count(f, "courses"), "different input signal"),
           count(f, "lags"), count(f, "needed"));
     }},
    {Kind::experiment_outlying, "experiment_outlying", warning,
     [](const Finding& f) {
       return fmt::format(
           "experiment {} does not fit the other experiments: with models of the other experiments, its residuals are {} times as large as those of the other experiments{}",
           experiment(f.experiments[0]), times(number(f, "ratio")), misfit_details(f));
     }},
    {Kind::more_outlying_experiments, "more_outlying_experiments", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} not fit the other experiments: check that all experiments are runs of one system, in the same units",
           count(f, "count") == 1 ? "1 more experiment does" : fmt::format("{} more experiments do", count(f, "count")));
     }},
    {Kind::samples_outlying, "samples_outlying", warning,
     [](const Finding& f) {
       return fmt::format(
           "experiment {}, output {}, {}: {} by up to {} from {} (median prediction error of all experiments: {}). {}",
           experiment(f.experiments[0]), channel(f), words::step_list(f.steps),
           f.steps.size() == 1 ? "1 sample deviates" : fmt::format("{} samples deviate", f.steps.size()),
           figure(f, "error"), f.steps.size() == 1 ? "its prediction" : "their predictions",
           words::figure(number(f, "usual"), 2), about_samples(f));
     }},
    {Kind::more_outlying_samples, "more_outlying_samples", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} with samples that deviate strongly from their predictions. This list does not contain them",
           words::plural(count(f, "count"), "more output"));
     }},
    {Kind::outliers_undecided, "outliers_undecided", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} not fit the other experiments. tokid used them all the same, because it drops or downweights at most a quarter of the experiments (here {}). Check whether all experiments are runs of one system",
           count(f, "count") == 1 ? "1 more experiment does" : fmt::format("{} more experiments do", count(f, "count")),
           count(f, "most"));
     }},
    {Kind::many_misfits, "many_misfits", warning,
     [](const Finding& f) {
       return fmt::format(
           "the innovations of {} are much larger than those of the other experiments. tokid used these experiments, because they are too many to be outliers. The model may be too simple for their inputs, or the experiments may come from two systems. Check these experiments, or identify them separately",
           experiments(f.experiments, 6));
     }},
    {Kind::ill_conditioned, "ill_conditioned", warning,
     [](const Finding& f) {
       return fmt::format(
           "the regressions are ill-conditioned (condition number above {}) at {}: their coefficients have few correct digits",
           figure(f, "condition"), words::step_list(f.steps));
     }},
    {Kind::too_few_complete, "too_few_complete", warning,
     [](const Finding& f) {
       return fmt::format(
           "missing samples leave fewer experiments than the regression has unknowns ({}) at {}: tokid uses the solution of smallest norm at these steps",
           count(f, "unknowns"), words::step_list(f.steps));
     }},
    {Kind::inputs_unexcited, "inputs_unexcited", warning,
     [](const Finding& f) {
       return fmt::format(
           "the inputs of neighbouring steps and channels are linearly dependent in all experiments at {}: their effects at these steps can't be separated from each other",
           words::step_list(f.steps));
     }},
    {Kind::no_freedom, "no_freedom", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} experiments leave no degree of freedom at lag order {}: the regressions fit any data exactly, and the noise can't be estimated. Use {} experiments or more",
           count(f, "experiments"), count(f, "lags"), count(f, "sufficient"));
     }},
    {Kind::few_experiments, "few_experiments", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} experiments are few for the {} unknowns per output and step at lag order {}: averaging hardly reduces the noise of the coefficients. Use {} experiments or more. With {} experiments, use lag orders up to {}",
           count(f, "experiments"), count(f, "unknowns"), count(f, "lags"), count(f, "sufficient"),
           count(f, "experiments"), count(f, "largest_lags"));
     }},
    {Kind::lags_at_limit, "lags_at_limit", warning,
     [](const Finding& f) {
       return fmt::format(
           "the chosen lag order {} is the largest that {} experiments can test. A larger lag order may be better: use more experiments, or state the lag order",
           count(f, "lags"), count(f, "experiments"));
     }},
    {Kind::lags_untested, "lags_untested", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} experiments leave no degree of freedom to test lag order {}: a regression of this lag order fits any data exactly",
           count(f, "experiments"), count(f, "lags"));
     }},
    {Kind::lags_below_states, "lags_below_states", warning,
     [](const Finding& f) {
       return fmt::format(
           "lag order {} with {} outputs allows at most {} states, but {} states were asked for. State a larger lag order, or fewer states",
           count(f, "lags"), count(f, "outputs"), count(f, "most"), count(f, "states"));
     }},
    {Kind::smoothing_untested, "smoothing_untested", warning,
     [](const Finding& f) {
       return fmt::format(
           "a single record is too little data to choose the smoothing lambda. tokid uses lambda = {}",
           figure(f, "smoothing"));
     }},
    {Kind::smoothing_by_gaps, "smoothing_by_gaps", warning,
     [](const Finding& f) {
       return fmt::format(
           "because of missing samples, too few windows without a gap remain, so variation over time cannot be estimated from these data. The regressions use the smoothing lambda = {}, and EM chooses a lambda of its own",
           figure(f, "smoothing"));
     }},
    {Kind::no_variation, "no_variation", note,
     [](const Finding&) {
       return std::string("tokid uses one model for all steps, because models that vary over time do not predict better");
     }},
    {Kind::feedthrough_or_feedback, "feedthrough_or_feedback", warning,
     [](const Finding& f) {
       return fmt::format(
           "input {} and output {} are correlated within a step, and the inputs depend on earlier outputs. The data do not show whether feedthrough or feedback within the step causes this correlation, so D may be wrong. If the controller uses the output of the same step, state that there is no feedthrough (--no-feedthrough). Otherwise, state that there is feedthrough (--feedthrough)",
           f.channels[0].name, f.channels[1].name);
     }},
    {Kind::few_windows, "few_windows", warning,
     [](const Finding& f) {
       return fmt::format(
           "{}. This is few for the {} unknowns per output at lag order {}. Validate the model on other data",
           windows(f), count(f, "unknowns"), count(f, "lags"));
     }},
    {Kind::few_for_states, "few_for_states", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} are fewer than the {} unknowns that each row of A and B, or of C and D, has at every step: smoothing over time replaces the missing information. Validate the model on other data",
           words::plural(count(f, "experiments"), "experiment"), count(f, "unknowns"));
     }},
    {Kind::free_response_single, "free_response_single", warning,
     [](const Finding&) {
       return std::string(
           "the free response was not used: a single free response equals its own mean motion, so it is zero after the mean motion is removed");
     }},
    {Kind::free_responses_unused, "free_responses_unused", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} not used: the subspace realisation needs no free responses. --method tvera uses free responses",
           count(f, "count") == 1 ? "the free response was"
                                  : fmt::format("the {} free responses were", count(f, "count")));
     }},
    {Kind::free_responses_partial, "free_responses_partial", warning,
     [](const Finding& f) {
       return fmt::format("the {} free responses show all {} states only from step {} on. They should show them from step {} on",
                          count(f, "count"), count(f, "states"), count(f, "step"), count(f, "wanted"));
     }},
    {Kind::no_states, "no_states", warning,
     [](const Finding&) {
       return std::string("no state was found: the outputs respond to the inputs of the same step only, or not at all");
     }},
    {Kind::states_below_asked, "states_below_asked", warning,
     [](const Finding& f) {
       return fmt::format(
           "{0} states were asked for, but the Hankel matrices have at most rank {1}: the model has {1} states",
           count(f, "asked"), count(f, "found"));
     }},
    {Kind::regression_kept, "regression_kept", note,
     [](const Finding& f) {
       return fmt::format(
           "the regression on {} lags predicts held-out experiments better than models of fewer states, so the model is this regression, with {} states",
           figure(f, "lags"), figure(f, "states"));
     }},
    {Kind::states_hidden, "states_hidden", warning,
     [](const Finding& f) {
       return fmt::format(
           "the Hankel matrices have a rank below {} at {}: the outputs do not show all states at these steps, or the inputs do not reach all states. The model has fewer states at these steps",
           count(f, "states"), words::step_list(f.steps));
     }},
    {Kind::gains_grow, "gains_grow", warning,
     [](const Finding& f) {
       return fmt::format(
           "the Kalman gains at {} are up to {} times as large as usual. The outputs hardly determine a direction of the state at these steps. Use fewer states, or do not use the observer or a controller there",
           words::step_list(f.steps), times(number(f, "ratio")));
     }},
    {Kind::late_begin, "late_begin", note,
     [](const Finding& f) {
       return fmt::format(
           "the initial states are unknown, so the model begins at step {}, the first step with the full state dimension",
           count(f, "step"));
     }},
    {Kind::frame_limits, "frame_limits", note,
     [](const Finding& f) {
       return fmt::format(
           "only steps {} to {} are in the reference frame of step {}. At the other steps, the states keep their own coordinates",
           count(f, "begin"), count(f, "end") - 1, count(f, "step"));
     }},
    {Kind::uncertain_ahead, "uncertain_ahead", warning,
     [](const Finding& f) {
       return fmt::format(
           "in cross-validation, the errors of predictions {} steps ahead are {} times as large as the covariances of the models say. There are too few experiments for a system that varies like this, or the noise is not white. Use more experiments, and test long predictions and controllers on other data",
           count(f, "horizon"), words::figure(number(f, "ratio"), 2));
     }},
    {Kind::model_errs_ahead, "model_errs_ahead", warning,
     [](const Finding& f) {
       return fmt::format(
           "in predictions {} steps ahead, up to {:.0f} % of the error variance comes from errors of the model. This is an estimate from the differences between models of different parts of the experiments. Use more experiments, and test long predictions and controllers on other data",
           count(f, "horizon"), 100 * number(f, "share"));
     }},
    {Kind::em_unreliable, "em_unreliable", warning,
     [](const Finding&) {
       return std::string(
           "the model of EM predicts all experiments worse than the models of cross-validation predicted the held-out folds. The result of EM may be wrong");
     }},
    {Kind::em_worse_one_step, "em_worse_one_step", note,
     [](const Finding&) {
       return std::string(
           "EM made the predictions better in cross-validation, but made the predictions of the whole data worse. tokid dropped the result of EM");
     }},
    {Kind::em_worse_simulation, "em_worse_simulation", note,
     [](const Finding&) {
       return std::string(
           "EM made the model better in cross-validation, but made the simulations of the whole data worse. tokid dropped the result of EM");
     }},
    {Kind::em_no_noise, "em_no_noise", note,
     [](const Finding&) {
       return std::string(
           "some combinations of states and of outputs have no noise, so the likelihood has no maximum. For these combinations, EM sets the noise covariances Q and R to 1e-12 times the mean squares of the signals");
     }},
    {Kind::em_no_measurement_noise, "em_no_measurement_noise", note,
     [](const Finding&) {
       return std::string(
           "EM finds no measurement noise in some combination of outputs: for this combination, EM sets the covariance R to 1e-12 times the mean squares of the outputs");
     }},
    {Kind::em_no_process_noise, "em_no_process_noise", note,
     [](const Finding&) {
       return std::string(
           "EM finds no process noise in some combination of states: for this combination, EM sets the covariance Q to 1e-12 times the mean squares of the states");
     }},
    {Kind::em_not_converged, "em_not_converged", warning,
     [](const Finding& f) {
       return fmt::format(
           "EM has not converged after {}: the last iteration increased the log-likelihood per output sample by {}",
           words::plural(count(f, "iterations"), "iteration"), words::figure(number(f, "gain"), 2));
     }},
    {Kind::em_few_experiments, "em_few_experiments", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} are few for the {} unknowns that each row of A and B, or of C and D, has at every step. Use smoothing over time (lambda above zero)",
           words::plural(count(f, "experiments"), "experiment"), count(f, "unknowns"));
     }},
    {Kind::em_fewer_than_unknowns, "em_fewer_than_unknowns", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} than the {} unknowns that each row of A and B, or of C and D, has at every step: smoothing over time replaces the missing information, and the fit on these data is no test of the model",
           count(f, "experiments") == 1 ? "1 experiment is fewer"
                                        : fmt::format("{} experiments are fewer", count(f, "experiments")),
           count(f, "unknowns"));
     }},
    {Kind::em_extended, "em_extended", note,
     [](const Finding& f) {
       return fmt::format(
           "the data have {}, but the model ended with step {}. For the later steps, EM started from the matrices of this last step",
           words::plural(count(f, "steps"), "step"), count(f, "last"));
     }},
    {Kind::em_shortened, "em_shortened", note,
     [](const Finding& f) {
       return fmt::format(
           "the data have {}, but the model ended with step {}. The new model ends with the last step of the data",
           words::plural(count(f, "steps"), "step"), count(f, "last"));
     }},
    {Kind::output_unpredicted, "output_unpredicted", warning,
     [](const Finding& f) {
       return fmt::format("the one-step predictions of output {} are no better than the mean of this output (fit {} %)", channel(f),
                          figure(f, "fit"));
     }},
    {Kind::output_missimulated, "output_missimulated", warning,
     [](const Finding& f) {
       return fmt::format(
           "the simulation of output {} is worse than the mean of this output (fit {} %)",
           channel(f), figure(f, "fit"));
     }},
    {Kind::output_still, "output_still", warning,
     [](const Finding& f) { return fmt::format("output {} is constant in the new experiments", channel(f)); }},
    {Kind::sample_time_differs, "sample_time_differs", warning,
     [](const Finding& f) {
       return fmt::format("the {}'s dt = {:.6g} s differs from the model's dt = {:.6g} s{}", compared(f),
                          number(f, "data"), number(f, "model"),
                          is(f, "stated") ? "" : ", which was identified from data without a sample time");
     }},
    {Kind::input_names_differ, "input_names_differ", warning,
     [](const Finding& f) { return names_differ(f, "inputs"); }},
    {Kind::output_names_differ, "output_names_differ", warning,
     [](const Finding& f) { return names_differ(f, "outputs"); }},
    {Kind::units_differ, "units_differ", warning,
     [](const Finding& f) {
       return fmt::format(
           "the {}'s {} has the unit {}, but this channel of the model has the unit {}. tokid does not convert units",
           compared(f),
           sides_and_names(f.channels), f.names[0], f.names[1]);
     }},
    {Kind::model_ends_early, "model_ends_early", warning,
     [](const Finding& f) {
       return fmt::format("the model ends with step {}, so it does not cover the last {} of the data", count(f, "last"),
                          words::plural(count(f, "steps"), "step"));
     }},
    {Kind::nothing_predicted, "nothing_predicted", warning,
     [](const Finding& f) {
       return fmt::format(
           "no step could be predicted: the model covers steps {} to {}, and {} steps are needed to find an unknown initial state",
           count(f, "begin"), count(f, "end"), count(f, "needed"));
     }},
    {Kind::nothing_predicted_ahead, "nothing_predicted_ahead", warning,
     [](const Finding& f) { return fmt::format("no step could be predicted {} steps ahead. Use a smaller horizon", count(f, "horizon")); }},
    {Kind::simulation_overflows, "simulation_overflows", warning,
     [](const Finding&) { return std::string("the simulated outputs overflow, because the model is unstable over its steps"); }},
    {Kind::outputs_absent, "outputs_absent", warning,
     [](const Finding&) {
       return std::string("all computed outputs are missing (NaN): the model gives no output at any step of the data");
     }},
    {Kind::simulated_from, "simulated_from", note,
     [](const Finding& f) {
       return fmt::format(
           "the initial states are unknown: the simulation starts from the {} at step {}, where the model begins",
           f.detail, count(f, "step"));
     }},
    {Kind::exact_first_steps, "exact_first_steps", warning,
     [](const Finding&) {
       return std::string(
           "the first steps, on which tokid made its choices, are free of noise, but later steps are noisy. State --method subspace or --lags");
     }},
    {Kind::constant_first_steps, "constant_first_steps", note,
     [](const Finding& f) {
       return fmt::format(
           "the first steps, on which tokid made its choices, show no variation over time, but the system may vary later. tokid uses the smoothing lambda = {}",
           figure(f, "smoothing"));
     }},
    {Kind::experiments_known, "experiments_known", note, [](const Finding& f) { return known(f); }},
    {Kind::state_without_digests, "state_without_digests", warning,
     [](const Finding& f) {
       return fmt::format(
           "an earlier version of tokid began the state file, which has no digests of {}. If one of these experiments is added again, tokid does not notice it, and the experiment counts twice. To avoid this, make a new state file with identify --state",
           words::plural(count(f, "count"), "experiment"));
     }},
    {Kind::update_noisy, "update_noisy", warning,
     [](const Finding&) {
       return std::string(
           "the experiments are noisy, but the choices in the state file assume data without noise. Identify again from all experiments");
     }},
    {Kind::update_few_experiments, "update_few_experiments", warning,
     [](const Finding& f) {
       return fmt::format(
           "there are fewer experiments than unknowns at {}: tokid uses the solution of smallest norm at these steps",
           words::step_list(f.steps));
     }},
    {Kind::update_states_below, "update_states_below", warning,
     [](const Finding& f) {
       return fmt::format("{} states were asked for, but the experiments show only {} states", count(f, "asked"),
                          count(f, "found"));
     }},
    {Kind::bounds_of_other_data, "bounds_of_other_data", warning,
     [](const Finding&) {
       return std::string(
           "the model was not identified from these data, but bounds need the data of its identification");
     }},
    {Kind::no_eigenvalue_bounds, "no_eigenvalue_bounds", warning,
     [](const Finding& f) { return fmt::format("no bounds of the eigenvalues were computed: {}", f.detail); }},
    {Kind::replicates_failed, "replicates_failed", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} of {} replicates of the bootstrap could not be identified",
           count(f, "failed"), count(f, "replicates"));
     }},
    {Kind::bounds_of_other_model, "bounds_of_other_model", warning,
     [](const Finding&) {
       return std::string(
           "an identification from these data with the options of the model gives another model. The bounds belong to that other model");
     }},
    {Kind::bounds_with_bias, "bounds_with_bias", warning,
     [](const Finding& f) {
       return fmt::format(
           "do not rely on the bounds at {}: at these steps, the smoothing lambda = {} changes the estimates more than the noise does. The system may change faster than lambda permits, for example at a jump",
           words::step_list(f.steps), figure(f, "smoothing"));
     }},
    {Kind::bounds_without_bias, "bounds_without_bias", warning,
     [](const Finding& f) {
       return fmt::format(
           "the bounds do not include the bias of the smoothing lambda = {}, because no model with weaker smoothing could be identified. The bounds are too narrow where the system changes fast",
           figure(f, "smoothing"));
     }},
    {Kind::bounds_of_constant_system, "bounds_of_constant_system", note,
     [](const Finding&) {
       return std::string(
           "the bounds assume that the system does not vary over time. The bounds do not include variations that are too small to be found");
     }},
    {Kind::plan_of_departures, "plan_of_departures", note,
     [](const Finding&) {
       return std::string("the planned inputs are departures from the nominal trajectory: add the nominal trajectory of the model to them");
     }},
    {Kind::plan_windows_sampled, "plan_windows_sampled", note,
     [](const Finding& f) {
       return fmt::format(
           "because each window has {} inputs, their condition number was computed for only {} of {} windows",
           count(f, "inputs"), count(f, "sampled"), count(f, "windows"));
     }},
    {Kind::plan_late_forecasts, "plan_late_forecasts", note,
     [](const Finding& f) {
       return fmt::format(
           "the model begins at step {}, so tokid computes no forecasts and no optimal inputs for the windows before step {}. The forecasts of the later windows assume a zero state at step {}",
           count(f, "step"), count(f, "first"), count(f, "step"));
     }},
    {Kind::plan_unknown_states, "plan_unknown_states", note,
     [](const Finding&) { return std::string("the initial states are unknown: the forecasts assume zero initial states"); }},
    {Kind::plan_model_uncertain, "plan_model_uncertain", warning,
     [](const Finding& f) {
       return fmt::format(
           "the innovations of the preliminary model have {} % of the size of the outputs that it forecasts. Above {} %, inputs optimised with this model can be worse than orthogonal inputs",
           figure(f, "share"), figure(f, "bound"));
     }},
    {Kind::plan_no_freedom, "plan_no_freedom", warning,
     [](const Finding& f) {
       return fmt::format(
           "{} experiments leave no degree of freedom: the regressions will fit any data exactly, and the noise can't be estimated. If the data have noise, use more experiments",
           count(f, "experiments"));
     }},
    {Kind::plan_below_recommendation, "plan_below_recommendation", warning,
     [](const Finding& f) {
       return fmt::format("the plan has {} experiments, but {} are recommended with this noise. Use more experiments",
                          count(f, "experiments"), count(f, "recommended"));
     }},
    {Kind::plan_rank_by_noise, "plan_rank_by_noise", warning,
     [](const Finding& f) {
       return fmt::format(
           "the lag order times the outputs (p·m = {0}) exceeds the states (n = {1}). Without noise, the regressions have {3} unknowns, but at most rank {2}: noise alone determines the other directions",
           count(f, "lags_outputs"), count(f, "states"), count(f, "rank"), count(f, "unknowns"));
     }},
    {Kind::plan_noisy_input, "plan_noisy_input", warning,
     [](const Finding& f) {
       return fmt::format(
           "the noise on input {} is {} % of the RMS value of the input. If the recorded input contains this noise, the coefficients are too small by {} %",
           channel(f), figure(f, "share"), figure(f, "bias"));
     }},
    {Kind::plan_inputs_dependent, "plan_inputs_dependent", warning,
     [](const Finding& f) {
       return fmt::format(
           "the planned inputs are nearly linearly dependent in {} (condition number above {}). Use another kind of inputs, another seed or more experiments",
           words::plural(count(f, "windows"), "window"), figure(f, "condition"));
     }},
    {Kind::plan_ill_conditioned, "plan_ill_conditioned", warning,
     [](const Finding& f) {
       return fmt::format(
           "the model forecasts a condition number above {} in {}. Use more experiments, or other limits of the inputs",
           figure(f, "condition"), words::plural(count(f, "windows"), "window"));
     }},
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
  const std::string text = finding.file.empty() ? entry(finding.kind).words(finding)
                                                : finding.file + ": " + entry(finding.kind).words(finding);
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
      return fmt::format("cross-validation, {} of {} folds: {}", count(finding, "folds_with"), count(finding, "folds"),
                         text);
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

namespace {

struct ExplanationEntry {
  Explanation::Kind kind;
  const char* name;
  std::string (*words)(const Explanation& e);
};

std::string as_usual(const std::string& change) { return fmt::format("It would fit with {}", change); }

std::string name_of(const Explanation& e) { return sides_and_names(e.channels); }

// "2 steps earlier"
std::string shift(const Explanation& e) {
  const Index by = Index(std::llround(e.numbers.at("earlier")));
  return fmt::format("{} {}", words::plural(std::abs(by), "step"), by > 0 ? "earlier" : "later");
}

using Cause = Explanation::Kind;

constexpr ExplanationEntry explanations[] = {
    {Cause::swapped, "swapped",
     [](const Explanation& e) {
       return as_usual(
           fmt::format("{}s {} swapped", e.channels.front().output ? "output" : "input", names_of(e.channels)));
     }},
    {Cause::at_zero, "at_zero", [](const Explanation& e) { return as_usual(name_of(e) + " at zero"); }},
    {Cause::sign_changed, "sign_changed",
     [](const Explanation& e) { return as_usual(fmt::format("the sign of {} changed", name_of(e))); }},
    {Cause::scaled, "scaled",
     [](const Explanation& e) {
       return as_usual(fmt::format("{} multiplied by {}", name_of(e), words::figure(e.numbers.at("factor"))));
     }},
    {Cause::outputs_scaled, "outputs_scaled",
     [](const Explanation& e) {
       return as_usual(fmt::format("all outputs multiplied by {}", words::figure(e.numbers.at("factor"))));
     }},
    {Cause::offset, "offset",
     [](const Explanation& e) {
       const double offset = e.numbers.at("offset");
       return as_usual(
           fmt::format("{} {} {}", words::figure(std::abs(offset)), offset < 0 ? "subtracted from" : "added to", name_of(e)));
     }},
    {Cause::shifted, "shifted",
     [](const Explanation& e) { return as_usual(fmt::format("{} {}", name_of(e), shift(e))); }},
    {Cause::outputs_shifted, "outputs_shifted",
     [](const Explanation& e) { return as_usual("the outputs " + shift(e)); }},
    {Cause::all_shifted, "all_shifted", [](const Explanation& e) { return as_usual("all channels " + shift(e)); }},
    {Cause::stuck, "stuck",
     [](const Explanation& e) {
       return fmt::format(
           "Its {} stays at {} at steps {}–{}",
           name_of(e), words::figure(e.numbers.at("value")), e.steps.front(),
           e.steps.back());
     }},
    {Cause::one_output, "one_output",
     [](const Explanation& e) { return "Nearly all of its residual is in " + name_of(e); }},
};

}  // namespace

static_assert(lists_each_in_order(explanations, &ExplanationEntry::kind));

const char* to_string(Explanation::Kind kind) { return explanations[size_t(kind)].name; }

std::string in_words(const Explanation& explanation) {
  return explanations[size_t(explanation.kind)].words(explanation);
}

bool same_words(const Finding& a, const Finding& b) { return in_words(a) == in_words(b); }

void append(Findings& all, Findings more) {
  all.insert(all.end(), std::make_move_iterator(more.begin()), std::make_move_iterator(more.end()));
}

}  // namespace tokid
