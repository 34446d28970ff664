// Findings: facts about data, a model or an identification that the user should know, as values and as sentences.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <vector>

#include "tokid/types.hpp"

namespace tokid {

enum class Severity {
  note,     // an assumption that replaced missing information
  warning,  // the data or the model may differ from what the user expects
};
const char* to_string(Severity severity);

struct FindingChannel {
  bool output = false;  // true: an output; false: an input
  Index index = 0;      // among the inputs, or the outputs
  std::string name;
  bool operator==(const FindingChannel&) const = default;
};

struct Finding {
  using Channel = FindingChannel;
  struct Experiment {
    Index row = 0;
    std::string name = {};  // empty where the data give none
    bool operator==(const Experiment&) const = default;
  };
  // factor · the sample of a channel `lag` steps before k
  struct Term {
    Channel channel;
    Index lag = 0;
    double factor = 1.0;
    bool operator==(const Term&) const = default;
  };

  // A comment after a kind lists the fields of Finding that have values. `numbers` are counts unless a unit is given.
  enum class Kind {
    // data
    reader_remark,                 // detail: what the reader of a file did or found
    sample_time_missing,           // numbers: the assumed dt [s]
    sample_time_of_model,          // numbers: dt [s]
    axes_of_one_experiment,        // numbers: experiments, steps, inputs, outputs, as they were read
    axes_of_one_step,              // as axes_of_one_experiment
    axes_channels_before_time,     // as axes_of_one_experiment
    axes_time_before_experiments,  // as axes_of_one_experiment
    input_zero,                    // channels, steps: zero in every experiment
    input_same,                    // channels, steps: the same in every experiment; numbers: experiments, 1 if alone
    input_zero_throughout,         // channels
    input_constant_throughout,     // channels
    input_zero_at_phases,          // channels, steps: phases of a period
    output_constant,               // channels
    samples_missing,               // channels, steps: missing in every experiment
    experiments_without_overlap,   // experiments: a late and an early one; steps: late begin, early end
    early_steps_of_few,            // experiments, steps: before those that enough experiments reach; numbers: needed
    late_steps_of_few,             // as early_steps_of_few, after those steps: the model ends before them
    inputs_dependent,              // channels, terms, steps; numbers: constant, varying, period
    input_predictable,             // as inputs_dependent, from earlier inputs; for sines: sines, sines_needed, lags
    input_feedback,                // as inputs_dependent, from earlier inputs and outputs
    more_dependent_inputs,         // numbers: count
    outputs_dependent,             // channels, terms; numbers: constant
    output_same,                   // channels, steps: the same in every experiment
    output_stuck,                  // channels, experiments, steps; numbers: value
    more_stuck_outputs,            // channels; numbers: count
    experiments_end_early,         // experiments; steps: from which all channels of each experiment are constant
    angle_wraps,                   // channels, experiments, steps: the first jump; numbers: turn, count
    experiments_empty,             // experiments; numbers: experiments
    experiments_copied,            // experiments, groups: the original of each copy; numbers: experiments
    inputs_repeated,               // numbers: experiments, courses, needed, lags
    experiment_outlying,           // experiments, channels; numbers: ratio, weight, held_out
    more_outlying_experiments,     // numbers: count
    samples_outlying,              // channels, experiments, steps; numbers: error, usual, weight
    more_outlying_samples,         // numbers: count
    outliers_undecided,            // numbers: count, most: more experiments do not fit than may be dropped
    many_misfits,                  // experiments
    // regressions
    ill_conditioned,          // steps; numbers: condition
    too_few_complete,         // steps; numbers: unknowns
    inputs_unexcited,         // steps
    no_freedom,               // numbers: experiments, lags, sufficient
    few_experiments,          // numbers: experiments, unknowns, lags, sufficient, largest_lags
    lags_at_limit,            // numbers: lags, experiments; unknowns if their number ends the search
    lags_untested,            // numbers: lags, experiments
    lags_below_states,        // numbers: lags, outputs, most, states
    smoothing_untested,       // numbers: smoothing
    smoothing_by_gaps,        // numbers: smoothing
    no_variation,             // one model is used for all steps
    feedthrough_or_feedback,  // channels: the input and output that are correlated most
    few_windows,              // numbers: windows, length, gaps, unknowns, lags
    few_for_states,           // numbers: experiments, unknowns
    free_response_single,     // the free response was not used
    free_responses_unused,    // numbers: count
    free_responses_partial,   // numbers: count, states, wanted, step
    // model
    no_states,
    states_below_asked,       // numbers: asked, found
    regression_kept,          // numbers: lags, states: the model is the regression itself, with p·m states
    states_hidden,            // steps; numbers: states
    gains_grow,               // steps; numbers: ratio of the largest norm of K_k to its reference
    late_begin,               // numbers: step
    frame_limits,             // numbers: step, begin, end
    uncertain_ahead,          // numbers: ratio, horizon
    model_errs_ahead,         // numbers: share, horizon
    em_unreliable,            // EM predicts all experiments worse than it predicted the held-out ones
    em_worse_one_step,        // the result of EM was dropped
    em_worse_ahead,           // the result of EM was dropped
    em_no_noise,              // Q and R are at their floors
    em_no_measurement_noise,  // R is at its floor
    em_no_process_noise,      // Q is at its floor
    em_not_converged,         // numbers: iterations, gain
    em_few_experiments,       // numbers: experiments, unknowns
    em_fewer_than_unknowns,   // numbers: experiments, unknowns
    em_extended,              // numbers: steps, last
    em_shortened,             // numbers: steps, last
    output_unpredicted,       // channels; numbers: fit [%]
    output_missimulated,      // channels; numbers: fit [%]
    output_still,             // channels: of new experiments
    sample_time_differs,      // numbers: data [s], model [s], stated
    input_names_differ,       // channels of the data; names of the model
    output_names_differ,      // as input_names_differ
    units_differ,             // channels; names: units of the data and of the model
    model_ends_early,         // numbers: last, steps
    nothing_predicted,        // numbers: begin, end, needed
    nothing_predicted_ahead,  // numbers: horizon
    simulation_overflows,
    outputs_absent,  // no step of the data has outputs of the model
    simulated_from,  // detail: the state at the start; numbers: step
    // blocks and updates
    exact_first_steps,         // no noise in the first steps, which decide the plan, but noise in later ones
    constant_first_steps,      // numbers: smoothing
    experiments_known,       // experiments; numbers: experiments
    state_without_digests,   // numbers: count
    update_noisy,            // the new data are noisy, but the plan is for data without noise
    update_few_experiments,  // steps
    update_states_below,     // numbers: asked, found
    // bounds
    bounds_of_other_data,
    no_eigenvalue_bounds,   // detail: the reason
    replicates_failed,      // numbers: failed, replicates
    bounds_of_other_model,  // the options and the data do not reproduce the model
    bounds_with_bias,       // steps; numbers: smoothing, largest
    bounds_without_bias,    // numbers: smoothing
    bounds_of_constant_system,
    // plans of experiments
    plan_of_departures,
    plan_windows_sampled,  // numbers: inputs, sampled, windows
    plan_late_forecasts,   // numbers: step, first
    plan_unknown_states,
    plan_model_uncertain,       // numbers: share [%], bound [%]
    plan_no_freedom,            // numbers: experiments
    plan_below_recommendation,  // numbers: experiments, recommended
    plan_rank_by_noise,         // numbers: lags_outputs, states, rank, unknowns
    plan_noisy_input,           // channels; numbers: share [%], bias [%]
    plan_inputs_dependent,      // numbers: windows, condition
    plan_ill_conditioned,       // numbers: windows, condition
    last = plan_ill_conditioned
  };
  // The data and the work to which a finding belongs. first_steps: those of a long ensemble, which decide its plan.
  enum class Scope { all, first_steps, new_experiments, cross_validation, folds };

  Kind kind = Kind::reader_remark;
  Scope scope = Scope::all;
  std::vector<Channel> channels = {};
  std::vector<Experiment> experiments = {};
  std::vector<Index> steps = {};
  std::map<std::string, double> numbers = {};
  std::vector<Term> terms = {};
  // for each of `experiments`: the experiment of which it is a copy
  std::vector<std::vector<Experiment>> groups = {};
  std::vector<std::string> names = {};          // of channels in the model, if the data have other names
  std::string detail = {};                      // text of a file reader, an option or an error
  std::string file = {};                        // the file with the data of the finding, if there are several files

  bool operator==(const Finding&) const = default;
};

using Findings = std::vector<Finding>;

const char* to_string(Finding::Scope scope);
const char* to_string(Finding::Kind kind);  // "input_zero": the stable name in JSON and Python
Severity severity(Finding::Kind kind);

std::string in_words(const Finding& finding);
std::vector<std::string> in_words(const Findings& findings);
// Are the sentences of both findings the same, apart from the last digits of numbers?
bool same_words(const Finding& a, const Finding& b);

// Appends the findings of `more` to `all`.
void append(Findings& all, Findings more);

}  // namespace tokid
