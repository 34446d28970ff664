// SPDX-License-Identifier: BSD-3-Clause
#include "verdict.hpp"

#include <algorithm>
#include <initializer_list>

namespace tokid::app {

namespace {

using Kind = Finding::Kind;
using Check = VerdictCheck::Kind;

// Findings of folds concern other models.
bool any_of(const Findings& findings, std::initializer_list<Kind> kinds) {
  return std::any_of(findings.begin(), findings.end(), [&](const Finding& finding) {
    return finding.scope == Finding::Scope::all && std::find(kinds.begin(), kinds.end(), finding.kind) != kinds.end();
  });
}

// Has one of these checks found something against the model?
bool any_against(const Verdict& verdict, std::initializer_list<VerdictCheck::Kind> kinds) {
  return std::any_of(verdict.checks.begin(), verdict.checks.end(), [&](const VerdictCheck& check) {
    return check.result.value_or(Trust::good) != Trust::good &&
           std::find(kinds.begin(), kinds.end(), check.kind) != kinds.end();
  });
}

// The data were read in another way than they were meant, or contain faults that can be mended.
constexpr std::initializer_list<Kind> faulty_data = {
    Kind::axes_of_one_experiment,      Kind::axes_of_one_step,
    Kind::axes_channels_before_time,   Kind::axes_time_before_experiments,
    Kind::experiments_without_overlap, Kind::output_stuck};

// The inputs cannot show all effects.
constexpr std::initializer_list<Kind> weak_inputs = {
    Kind::input_zero,           Kind::input_same,       Kind::input_zero_throughout, Kind::input_constant_throughout,
    Kind::input_zero_at_phases, Kind::inputs_dependent, Kind::input_predictable,     Kind::input_feedback,
    Kind::inputs_repeated,      Kind::inputs_unexcited};

constexpr std::initializer_list<Kind> too_few = {
    Kind::no_freedom,         Kind::few_experiments,        Kind::lags_at_limit,    Kind::lags_untested,
    Kind::few_windows,        Kind::few_for_states,         Kind::uncertain_ahead,  Kind::model_errs_ahead,
    Kind::em_few_experiments, Kind::em_fewer_than_unknowns, Kind::too_few_complete, Kind::update_few_experiments};

// An experiment or samples that do not fit, but count as much as the others.
bool used_outlier(const Finding& finding) {
  return (finding.kind == Kind::experiment_outlying || finding.kind == Kind::samples_outlying) &&
         finding.numbers.at("weight") == 1;
}

NextStep plan_more(const std::string& purpose, const Tested& tested) {
  return {purpose, fmt::format("tokid plan --model {} -o inputs.npz", word(tested.model.string()))};
}

// "tokid NAME MODEL DATA -o OUTPUT", with the options that read the data.
std::string on_same_data(const char* name, const Tested& tested, const char* output) {
  return fmt::format("tokid {} {} {} -o {}{}", name, word(tested.model.string()), words_of(tested.data), output,
                     words_of(tested.read));
}

NextStep on_page(const std::string& purpose, const Tested& tested) {
  return {purpose, on_same_data("report", tested, "report.html")};
}

std::string look_at(const Tested& tested) {
  return fmt::format("tokid info {}{}", words_of(tested.data), words_of(tested.read));
}

}  // namespace

void add_verdict(const Verdict& verdict, bool verbose, Page& page) {
  const std::string status = to_string(verdict.trust);
  if (verbose) {
    page.row("Verdict", status);
    page.row("", verdict.summary);
    for (const std::string& reason : verdict.reasons) page.row("", "- " + reason);
    return;
  }
  if (verdict.reasons.empty()) return page.row("Verdict", fmt::format("{}. {}", status, verdict.summary));
  const size_t more = verdict.reasons.size() - 1;
  page.row("Verdict",
           fmt::format("{}. {}{}", status, verdict.reasons.front(),
                       more == 0 ? "" : fmt::format(" ({} with --verbose)", plural(Index(more), "more reason"))));
}

NextStep test_on_other_data(const fs::path& model, const std::vector<fs::path>& data, const ReadOptions& read) {
  const bool tables = data.size() > 1 || fs::is_directory(data.front());  // only .csv files are read together
  return {"test the model on other experiments",
          fmt::format("tokid validate {} fresh{}{}", word(model.string()), tables ? ".csv" : extension_of(data.front()),
                      words_of(read))};
}

NextStep next_step(const Verdict& verdict, const Findings& findings, const Tested& tested) {
  if (any_of(findings, faulty_data))
    return {"correct the data as the warnings say, and look at the data again", look_at(tested)};
  if (any_against(verdict, {Check::channels}))
    return {"compare the sample times, names and units of data and model", look_at(tested)};
  if (tested.identify && std::any_of(findings.begin(), findings.end(), used_outlier))
    return {"check the experiments that do not fit, or leave them out", tested.identify("--outliers drop")};
  if (any_of(findings, weak_inputs) || any_against(verdict, {Check::inputs, Check::rank}))
    return plan_more("measure with inputs that excite all channels", tested);
  if (any_of(findings, too_few) || any_against(verdict, {Check::samples, Check::missing}))
    return plan_more("measure more experiments, for example with these inputs", tested);
  if (tested.seen && tested.identify && tested.can_hold_out)
    return {"test the model on experiments that the identification did not use", tested.identify("--hold-out 0.2")};
  if (tested.seen || any_against(verdict, {Check::experiments, Check::coverage}))
    return test_on_other_data(tested.model, tested.data, tested.read);
  if (verdict.trust != Trust::good) return on_page("see where and when the model fails", tested);
  if (tested.identify) return {"use the model; for error bounds", on_same_data("confidence", tested, "bounds.npz")};
  return on_page("use the model; for a page with the evidence", tested);
}

}  // namespace tokid::app
