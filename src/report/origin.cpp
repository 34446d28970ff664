// SPDX-License-Identifier: BSD-3-Clause
#include "report/origin.hpp"

#include <optional>
#include <stdexcept>
#include <utility>

#include "base/integers.hpp"
#include "data/extents.hpp"
#include "model/channels.hpp"
#include "tokid/identify.hpp"

namespace tokid::report {

Tested tested_part(const Ensemble& data, Ensemble part, std::vector<Index> rows, ReportOptions options) {
  Tested result;
  result.data = std::move(part);
  result.options = std::move(options);
  result.rows = std::move(rows);
  for (const Index n : result.rows) result.names.push_back(data.experiment_name(n));
  return result;
}

std::vector<OutlyingSamples> Tested::in_given_data(std::vector<OutlyingSamples> outlying) const {
  for (OutlyingSamples& one : outlying) {
    const size_t n = size_t(one.experiment);
    one.experiment = rows[n];
    one.name = names[n];
  }
  return outlying;
}

namespace {

// The part of the data of an identification that remains after the corrections of its outliers, if there were
// any.
std::optional<Tested> after_corrections(const Model& model, const Ensemble& data, const Tested& all) {
  if (model.provenance.corrections.empty()) return std::nullopt;
  Corrected remaining = corrected(data, all.rows, model.provenance.corrections);
  return tested_part(data, std::move(remaining.data), std::move(remaining.rows), all.options);
}

}  // namespace

Tested tested(const Model& model, const Ensemble& data, const ReportOptions& options) {
  check_channels(model, data, true);  // messages then name the caller's rows, not those of a part
  return tested(model, data, used_experiments(data), options);
}

Tested tested(const Model& model, const Ensemble& data, const UsedExperiments& used, const ReportOptions& options) {
  Tested result = tested_part(data, used.all(data) ? data : data.subset(used.rows), used.rows, options);
  result.distinct = true;
  append(result.options.findings, findings_of(used, data));
  if (options.evaluation != Evaluation::automatic) return result;
  result.options.evaluation = has_seen(model.provenance, data) ? Evaluation::training : Evaluation::given;
  const std::optional<Tested> remaining = after_corrections(model, data, result);
  const Tested& own = remaining ? *remaining : result;
  if (result.options.evaluation == Evaluation::training) return own;
  try {
    const IdentifyOptions identification = identify_options(model.provenance);
    Split parts = split(own.data, identification.hold_out, identification.period);
    if (has_seen(model.provenance, parts.training)) {
      for (Index& n : parts.held_out_rows) n = own.rows[size_t(n)];
      result = tested_part(data, std::move(parts.held_out), std::move(parts.held_out_rows), std::move(result.options));
      result.options.evaluation = Evaluation::held_out;
    }
  } catch (const std::invalid_argument&) {
    // If nothing was held out, or the data are too few to hold out this share, then these are not the data of the
    // identification.
  }
  return result;
}

Tested tested(const Identification& result, const Ensemble& data, const IdentifyOptions& identified,
              ReportOptions options) {
  options.evaluation = result.held_out ? Evaluation::held_out : Evaluation::training;
  options.identified_from = result.experiments;
  options.findings = result.findings;
  options.comparison = result.comparison;
  options.initial_state = result.model.initial_state;
  // Too few experiments may have reached the later steps. Of a single record, the later steps may be held out.
  if (identified.period == 0 && result.steps < data.steps())
    return tested(result, begin_of(data, result.steps), identified, std::move(options));
  std::vector<Index> rows = result.used;
  if (rows.empty()) rows = range(0, data.experiments());  // the identification looked for no copies
  const Corrections& corrections = result.model.provenance.corrections;
  const bool all = Index(rows.size()) == data.experiments() && corrections.empty();
  if (!result.held_out && all) return tested(result.model, data, options);
  Ensemble own;
  if (!all) {
    Corrected remaining = corrected(data, rows, corrections);
    own = std::move(remaining.data);
    rows = std::move(remaining.rows);
  }
  if (!result.held_out) return tested_part(data, std::move(own), std::move(rows), std::move(options));
  Split parts = split(all ? data : own, identified.hold_out, identified.period);
  for (Index& n : parts.held_out_rows) n = rows[size_t(n)];
  return tested_part(data, std::move(parts.held_out), std::move(parts.held_out_rows), std::move(options));
}

}  // namespace tokid::report
