// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/cross_validate.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "base/integers.hpp"
#include "base/nan.hpp"
#include "base/random.hpp"
#include "data/check.hpp"
#include "data/rows.hpp"
#include "data/unused.hpp"
#include "identify/identify.hpp"
#include "model/comparison.hpp"
#include "tokid/copies.hpp"

namespace tokid {

namespace {

std::vector<std::vector<Index>> fold_members(Index experiments, const CrossValidateOptions& options) {
  if (experiments < 2)
    throw std::invalid_argument(
        fmt::format("experiments: {} found, at least 2 needed for cross-validation", experiments));
  if (options.folds < 2 || options.folds > experiments)
    throw std::invalid_argument(
        fmt::format("folds: {} found, 2 to {} (one for each experiment) needed", options.folds, experiments));
  const std::vector<Index> order =
      options.seed ? RandomNumbers(*options.seed).permutation(experiments) : range(0, experiments);
  std::vector<std::vector<Index>> members(size_t(options.folds));
  for (Index n = 0; n < experiments; ++n) members[size_t(n % options.folds)].push_back(order[size_t(n)]);
  for (std::vector<Index>& fold : members) std::sort(fold.begin(), fold.end());
  return members;
}

std::vector<std::string> names_of(const Ensemble& e, const std::vector<Index>& members) {
  std::vector<std::string> names;
  if (!e.experiment_names.empty())
    for (const Index n : members) names.push_back(e.experiment_name(n));
  return names;
}

// Outputs of the whole ensemble, collected from the folds.
class Pooled {
 public:
  explicit Pooled(const Ensemble& data) : outputs_(data) {
    for (Index k = 0; k < data.steps(); ++k) outputs_.output(k).setConstant(nan);
  }
  void add(const std::vector<Index>& experiments, const Ensemble& computed) {
    for (Index k = 0; k < computed.steps(); ++k)
      for (size_t i = 0; i < experiments.size(); ++i)
        outputs_.output(k).row(experiments[i]) = computed.output(k).row(Index(i));
  }
  const Ensemble& outputs() const { return outputs_; }

 private:
  Ensemble outputs_;
};

Vector spread(const std::vector<Fold>& folds, Fit Fold::*fit) {
  const Index m = (folds.front().*fit).fit.size();
  Vector result = Vector::Constant(m, nan);
  for (Index j = 0; j < m; ++j) {
    double sum = 0.0, squares = 0.0;
    Index count = 0;
    for (const Fold& fold : folds)
      if (const double f = (fold.*fit).fit(j); std::isfinite(f)) sum += f, ++count;
    if (count < 2) continue;
    for (const Fold& fold : folds)
      if (const double f = (fold.*fit).fit(j); std::isfinite(f))
        squares += (f - sum / double(count)) * (f - sum / double(count));
    result(j) = std::sqrt(squares / double(count - 1));
  }
  return result;
}

Identification identify_without(const Ensemble& training, const IdentifyOptions& options, size_t fold, size_t folds) {
  try {
    return identify_part(training, options, true);
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(fmt::format("fold {} of {}, identified from the other {} experiments: {}", fold + 1,
                                            folds, training.experiments(), error.what()));
  }
}

}  // namespace

CrossValidation cross_validate(const Ensemble& ensemble, const IdentifyOptions& identify_options,
                               const CrossValidateOptions& options) {
  check_horizon(options.horizon, ensemble.steps());
  check_first_step(options.first_step, ensemble.steps());
  const UsedExperiments used = used_experiments(ensemble);
  if (!used.all(ensemble)) {  // a copy in another fold would make errors look too small
    CrossValidation result = with_remark_on_unused(
        ensemble, [&] { return cross_validate(ensemble.subset(used.rows), identify_options, options); });
    for (Fold& fold : result.folds) {
      for (Index& n : fold.experiments) n = used.rows[size_t(n)];
      fold.experiment_names = names_of(ensemble, fold.experiments);
    }
    const Findings dropped = findings_of(used, ensemble);
    result.findings.insert(result.findings.begin(), dropped.begin(), dropped.end());
    return result;
  }
  const auto members = fold_members(ensemble.experiments(), options);
  // Checks the whole ensemble here, so that messages name its rows. Rows within a fold would mislead the user.
  const Survey samples = checked(ensemble);
  Pooled simulation(ensemble), one_step(ensemble), horizon(ensemble);
  bool nominal = false;
  CrossValidation result;
  if (identify_options.period == 0 && samples.missing > 0) result.findings = findings_of_overlap(ensemble);
  for (size_t i = 0; i < members.size(); ++i) {
    IdentifyOptions fold_options = identify_options;
    fold_options.hold_out = 0.0;
    fold_options.frame = Frame::raw;  // the outputs are the same in any frame
    fold_options.execution =
        share(identify_options.execution, double(i) / double(members.size()), double(i + 1) / double(members.size()),
              fmt::format("fold {} of {}", i + 1, members.size()));
    Identification found = identify_without(ensemble.subset(other_rows(ensemble.experiments(), members[i])),
                                            fold_options, i, members.size());
    const Model& model = found.model;
    const Ensemble kept = ensemble.subset(members[i]);
    nominal = nominal || model.y_nominal.size() > 0;

    Fold fold{members[i], names_of(ensemble, members[i]), model.states(), found.plan.lags, {}, {},
              {},         std::move(found.findings)};
    const auto evaluate = [&](const Ensemble& computed, Pooled& pooled) {
      pooled.add(members[i], computed);
      return fit(kept, computed, model.y_nominal, options.first_step);
    };
    const Ensemble next = predict(model, kept, {1, model.initial_state}).y;
    fold.simulation = evaluate(simulate_data(model, kept, model.initial_state), simulation);
    fold.one_step = evaluate(next, one_step);
    fold.horizon =
        evaluate(options.horizon == 1 ? next : predict(model, kept, {options.horizon, model.initial_state}).y, horizon);
    result.folds.push_back(std::move(fold));
  }
  Nominal mean = nominal ? nominal_trajectory(ensemble) : Nominal{};
  if (nominal && identify_options.period > 0) share_phases(mean, identify_options.period);
  const Matrix& reference = mean.y;
  result.simulation = fit(ensemble, simulation.outputs(), reference, options.first_step);
  result.one_step = fit(ensemble, one_step.outputs(), reference, options.first_step);
  result.horizon = fit(ensemble, horizon.outputs(), reference, options.first_step);
  result.simulation_spread = spread(result.folds, &Fold::simulation);
  result.one_step_spread = spread(result.folds, &Fold::one_step);
  result.horizon_spread = spread(result.folds, &Fold::horizon);
  return result;
}

Findings remarks(const CrossValidation& cross) {
  std::vector<std::pair<Finding, int>> seen;
  for (const Fold& fold : cross.folds)
    for (const Finding& finding : fold.findings) {
      const auto same = [&finding](const auto& entry) { return same_words(entry.first, finding); };
      const auto found = std::find_if(seen.begin(), seen.end(), same);
      if (found == seen.end())
        seen.emplace_back(finding, 1);
      else
        ++found->second;
    }
  Findings result = cross.findings;
  for (Finding& finding : result) finding.scope = Finding::Scope::cross_validation;
  for (auto& [finding, count] : seen) {
    finding.scope = Finding::Scope::folds;
    finding.numbers["folds"] = double(cross.folds.size());
    finding.numbers["folds_with"] = count;
    result.push_back(std::move(finding));
  }
  return result;
}

}  // namespace tokid
