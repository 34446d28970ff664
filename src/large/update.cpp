// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/update.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <iterator>
#include <numeric>
#include <optional>
#include <stdexcept>
#include <type_traits>
#include <utility>

#include "data/check.hpp"
#include "data/extents.hpp"
#include "data/subjects.hpp"
#include "diagnose/model_states.hpp"
#include "diagnose/regressions.hpp"
#include "large/evaluate.hpp"
#include "large/finding_archive.hpp"
#include "large/plan_archive.hpp"
#include "model/archived.hpp"
#include "tokid/copies.hpp"
#include "tokid/remarks.hpp"
#include "tokid/version.hpp"

namespace tokid {

namespace {

// Adds the given digests to the known digests, in ascending order. The result does not depend on the order of the
// files.
void remember(std::vector<Digest>& known, std::vector<Digest> given) {
  std::sort(given.begin(), given.end());
  std::vector<Digest> both;
  std::set_union(known.begin(), known.end(), given.begin(), given.end(), std::back_inserter(both));
  known = std::move(both);
}

}  // namespace

UpdateState update_state(const Ensemble& data, const Identification& result, const IdentifyOptions& options) {
  check_samples(data);
  if (result.held_out)
    throw std::invalid_argument(
        "hold-out fraction: held-out experiments found, but a state file needs all experiments; use no hold-out");
  for (const Corrections::Experiment& e : result.model.provenance.corrections.experiments)
    if (e.weight > 0)
      throw std::invalid_argument(
          "outliers: downweight found, which gave experiments different weights, but a state file needs experiments of "
          "equal weight; use drop or keep");
  if (data.free.experiments > 0 && result.plan.method == Method::tvera)
    throw std::invalid_argument(
        "free responses: free responses found, but a state file of the method tvera can't contain them; data without "
        "free responses needed");
  if (!result.plan.choices.delays.empty())
    throw std::invalid_argument(
        "delays: dead times found, but a state file can't contain them; state that there are none, or write no state file");
  if (result.plan.noisy && result.model.states() == 0)
    throw std::invalid_argument(
        "states: no state can be distinguished from the noise, but a state file needs at least one");
  UpdateState state;
  Plan& plan = state.plan = result.plan;
  NoisyChoices& choices = plan.choices;
  // Without noise, each identification determines n from the rank. With noise, n stays as chosen.
  plan.states = options.states.value_or(plan.noisy ? result.model.states() : 0);
  // These choices were made as a start for EM. An update does not use EM, so it takes the best choices without EM.
  if (choices.refinement_iterations > 0 && !options.choices) {
    choices.state_smoothing = result.order_scores.smoothing;
    if (!options.states) plan.states = result.order_scores.best;
  }
  choices.refinement_smoothing = 0.0;
  choices.refinement_iterations = 0;
  if ((plan.coupled && choices.weighting == Weighting::projection) || options.weighting == Weighting::projection)
    throw std::invalid_argument(
        "weighting: projection found, which needs samples, but a state file contains no samples; use --weighting "
        "one-step or many-steps");
  // Too few experiments may reach the later steps.
  if (result.steps > 0 && result.steps < data.steps())
    return update_state(begin_of(data, result.steps), result, options);
  const std::vector<Index>& rows = result.used;
  const bool all = rows.empty() || Index(rows.size()) == data.experiments();
  const Corrections& corrections = result.model.provenance.corrections;
  Ensemble own = all ? Ensemble() : data.subset(rows);
  if (!corrections.empty()) own = corrected(all ? data : own, corrections).data;
  const Ensemble& used = all && corrections.empty() ? data : own;
  state.provenance = result.model.provenance;
  state.provenance.experiments = used.experiments();
  state.provenance.refinement.reset();
  if (plan.coupled) state.provenance.choices = choices;
  state.factors = window_factors(used, plan.lags, plan.initial_state, options.execution);
  remember(state.digests, experiment_digests(data));
  return state;
}

Updated identify(const UpdateState& state, const Execution& execution) {
  const WindowFactors& factors = state.factors;
  Plan plan = state.plan;
  Nominal nominal;
  if (plan.nominal) nominal = factors.nominal();
  if (plan.nominal_period > 0) share_phases(nominal, plan.nominal_period);
  const Windows windows(factors, plan.nominal ? &nominal : nullptr);
  const Vector sizes = windows.channel_sizes();
  plan.input_size = sizes.head(windows.inputs());
  plan.output_size = sizes.tail(windows.outputs());
  GtvArx arx = regressions(windows, plan, execution);
  const RegressionSurvey survey = survey_of(arx, plan.nominal, 0, arx.steps());
  Model model = realise(windows, std::move(arx), {}, plan, execution);
  if (plan.nominal) {
    model.u_nominal = nominal.u;
    model.y_nominal = nominal.y;
  }
  const Index step = frame_step(model, plan);
  FramedModel framed = in_frame(std::move(model), plan);

  Updated result;
  result.experiments = factors.experiments;
  result.findings = findings_of_frame(framed, step, plan);
  result.model = std::move(framed.model);
  result.model.provenance = state.provenance;
  result.model.provenance.version = version;
  check_finite(result.model);
  if (!plan.noisy && survey.noisy()) result.findings.push_back({.kind = Finding::Kind::update_noisy});
  if (!plan.coupled) {
    result.condition_max = survey.condition_max;
    result.rank_deficient_steps = survey.rank_deficient;
    if (!survey.starved.empty())
      result.findings.push_back({.kind = Finding::Kind::update_few_experiments, .steps = survey.starved});
  }
  if (plan.states > 0 && result.model.states() < plan.states)
    result.findings.push_back({.kind = Finding::Kind::update_states_below,
                               .numbers = {{"asked", double(plan.states)}, {"found", double(result.model.states())}}});
  return result;
}

void check_update(const UpdateState& state, const Ensemble& more) {
  const Survey samples = checked(more);
  const WindowFactors& before = state.factors;
  check_alike(before, kind_of(more, before.lags, more.initial_state.value_or(before.initial_state)));
  if (more.free.experiments > 0)
    throw std::invalid_argument(
        "free responses: free responses found, but they can't be added to a state file; data without free responses needed");
  check_magnitudes(samples, more.names, more.inputs());
}

namespace {

// Data whose experiments may be added to the state, and what decides which of them are added.
struct Given {
  Ensemble data;
  Copies copies;                // copies of an experiment within the data
  std::vector<Digest> digests;  // (N)
  std::string fingerprint;      // of the data
  Findings findings;            // findings on the file of the data
};

Given given(Ensemble data) {
  Given result{{}, find_copies(data), experiment_digests(data), fingerprint(data), {}};
  result.data = std::move(data);
  return result;
}

// Rows of the experiments that the state already has. A copy of an experiment that the state has counts, too.
std::vector<Index> known_rows(const UpdateState& state, const Given& given) {
  std::vector<bool> known(given.digests.size());
  // If the state has experiments without digests, it can only recognise a whole ensemble, by its fingerprint.
  const bool all = state.without_digest > 0 && has_seen(state.provenance, given.data);
  for (size_t n = 0; n < known.size(); ++n)
    known[n] = all || std::binary_search(state.digests.begin(), state.digests.end(), given.digests[n]);
  for (const std::vector<Index>& group : given.copies.groups)
    if (std::any_of(group.begin(), group.end(), [&](Index n) { return known[size_t(n)]; }))
      for (const Index n : group) known[size_t(n)] = true;
  std::vector<Index> rows;
  for (size_t n = 0; n < known.size(); ++n)
    if (known[n]) rows.push_back(Index(n));
  return rows;
}

Findings findings_of_known(const std::vector<Index>& rows, const Ensemble& data) {
  if (rows.empty()) return {};
  return {{.kind = Finding::Kind::experiments_known,
           .experiments = experiments(data, rows),
           .numbers = {{"experiments", double(data.experiments())}}}};
}

// The given experiments that are added: those that the state does not have, without copies.
struct Joining {
  Ensemble data;
  std::vector<Index> known;  // rows that are not added, because the state has these experiments
  std::string fingerprint;
  Findings findings;
};

Joining joining(const UpdateState& state, Given given) {
  Joining result{{}, known_rows(state, given), std::move(given.fingerprint), std::move(given.findings)};
  const auto is_known = [&](Index n) { return std::binary_search(result.known.begin(), result.known.end(), n); };
  std::vector<Index>& used = given.copies.used;
  std::erase_if(used, is_known);
  std::erase_if(given.copies.groups, [&](const std::vector<Index>& group) { return is_known(group.front()); });
  append(result.findings, findings_of_known(result.known, given.data));
  append(result.findings, findings_of(given.copies, given.data));
  result.data = Index(used.size()) == given.data.experiments() ? std::move(given.data) : given.data.subset(used);
  return result;
}

// The result of the factorisation of the experiments that are added.
struct Portion {
  WindowFactors factors;  // empty if no experiment is added
  std::vector<Index> known;
  std::string fingerprint;
  ErrorTotals errors;  // errors of the model before the update
  Findings findings;
};

Portion portion(const UpdateState& state, const Joining& more, const Execution& execution) {
  Portion result{{}, more.known, more.fingerprint, {}, more.findings};
  if (more.data.experiments() > 0)
    result.factors = window_factors(more.data, state.factors.lags, state.factors.initial_state, execution);
  return result;
}

void add(UpdateState& state, const Portion& more, const Execution& execution) {
  if (more.factors.experiments > 0) merge(state.factors, more.factors, execution);
  note_data(state.provenance, more.fingerprint);
  state.provenance.experiments = state.factors.experiments;
  state.provenance.refinement.reset();
}

Findings findings_of_unknown(const UpdateState& state, Index added) {
  if (state.without_digest == 0 || added == 0) return {};
  return {{.kind = Finding::Kind::state_without_digests, .numbers = {{"count", double(state.without_digest)}}}};
}

}  // namespace

Findings update(UpdateState& state, const Ensemble& more, const Execution& execution) {
  check_update(state, more);
  Given asking = given(more);
  const std::vector<Digest> digests = asking.digests;
  Portion added = portion(state, joining(state, std::move(asking)), execution);
  add(state, added, execution);
  remember(state.digests, digests);
  append(added.findings, findings_of_unknown(state, added.factors.experiments));
  return std::move(added.findings);
}

// Serialisation for messages between processes.
template <class Archive, class F>
requires std::is_same_v<std::remove_const_t<F>, WindowFactors>
void fields(Archive& archive, F& f) {
  archive(f.inputs, f.outputs, f.lags, f.initial_state, f.dt, f.names, f.experiments, f.rows, f.factor, f.count, f.sum,
          f.spread);
}

template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, UpdateState>
void fields(Archive& archive, S& s) { archive(s.factors, s.plan, s.provenance, s.digests, s.without_digest); }

namespace {

template <class Archive, class P>
requires std::is_same_v<std::remove_const_t<P>, Portion>
void fields(Archive& archive, P& p) { archive(p.factors, p.known, p.fingerprint, p.errors, p.findings); }

// The parts of the state and of its model that a process needs to compute a Portion.
struct Needs {
  UpdateState state;  // without factors
  Model model;        // describes departures from `mean`, if `mean` is not empty
  Nominal mean;
};

template <class Archive, class N>
requires std::is_same_v<std::remove_const_t<N>, Needs>
void fields(Archive& archive, N& n) { archive(n.state, n.model, n.mean.u, n.mean.y); }

Needs needs_of(const UpdateState& state, const Model& before) {
  Needs result;
  const WindowFactors& f = state.factors;
  WindowFactors& kind = result.state.factors;
  kind.inputs = f.inputs, kind.outputs = f.outputs, kind.lags = f.lags;
  kind.initial_state = f.initial_state;
  kind.dt = f.dt;
  kind.names = f.names;
  kind.rows.assign(f.rows.size(), 0);
  result.state.provenance = state.provenance;
  result.state.digests = state.digests;
  result.state.without_digest = state.without_digest;
  result.model = continued(before, f.steps());
  std::swap(result.mean.u, result.model.u_nominal);
  std::swap(result.mean.y, result.model.y_nominal);
  return result;
}

template <class Work>
auto about(const std::filesystem::path& file, Work&& work) {
  try {
    return work();
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(fmt::format("{}: {}", file.string(), error.what()));
  }
}

Given given(const Needs& needs, Ensemble data, Findings findings) {
  check_update(needs.state, data);
  Given result = given(std::move(data));
  result.findings = std::move(findings);
  return result;
}

Given given_by(const std::filesystem::path& file, const Needs& needs, const UpdateOptions& options) {
  ReadOptions read = options.read;
  read.wanted = complete(needs.state.factors.names, needs.state.factors.inputs, needs.state.factors.outputs);
  Ensemble data = load_ensemble(file, read);
  return about(file, [&] {
    Findings found = remarks(needs.model, data);
    if (!data.dt_stated) data.dt = needs.state.factors.dt;
    return given(needs, std::move(data), std::move(found));
  });
}

Portion evaluated_portion(const Needs& needs, Given given, const Execution& execution) {
  Joining more = joining(needs.state, std::move(given));
  Portion result = portion(needs.state, more, execution);
  if (more.data.experiments() == 0) return result;
  if (needs.mean.y.size() > 0) more.data = departures(std::move(more.data), needs.mean);
  result.errors = stream::evaluate(needs.model, more.data, 0, more.data.steps(), needs.model.initial_state, true);
  return result;
}

// Reports outputs of the new experiments that the old model predicts no better than their mean, or simulates far worse
// than their mean.
Findings findings_of_fits(const Fit& simulation, const Fit& one_step, const Channels& names) {
  Findings result;
  for (Index j = 0; j < one_step.fit.size(); ++j)
    if (one_step.samples > 0 && std::isnan(one_step.fit(j)))
      result.push_back({.kind = Finding::Kind::output_still, .channels = {output_channel(names, j)}});
  append(result, findings_of_fit(one_step.fit, names));
  // For slow outputs, the one-step predictions of any model are good. So the simulation is checked, too.
  constexpr double much_worse = -20.0;
  const bool predicted = result.empty();
  for (Index j = 0; predicted && j < simulation.fit.size(); ++j)
    if (simulation.fit(j) < much_worse)
      result.push_back({.kind = Finding::Kind::output_missimulated,
                        .channels = {output_channel(names, j)},
                        .numbers = {{"fit", simulation.fit(j)}}});
  for (Finding& finding : result) finding.scope = Finding::Scope::new_experiments;
  return result;
}

// A numbered sequence of ensembles, and the names of their files, if they come from files.
struct Source {
  Index count = 0;
  std::function<Given(const Needs&, Index)> given;
  std::function<std::string(Index)> file;
};

// Works in rounds. In each round, each process has one ensemble. First all processes exchange the digests of their
// experiments, because an ensemble must not add an experiment that an earlier ensemble adds. Then all processes
// factorise their experiments. Finally, the first process adds the portions in order, with only one portion in memory
// at a time.
Additions update_from(UpdateState& state, const Model& before, const Source& source, const Execution& execution,
                      const Team& team) {
  const bool first = team.rank == 0;
  // All processes use exactly the state and the model of the first process.
  auto needs =
      archive::unpacked<Needs>(team.broadcast(first ? archive::packed(needs_of(state, before)) : std::string()));
  const size_t outputs = size_t(needs.state.factors.outputs);
  Additions result;
  ErrorTotals errors;
  errors.one_step.resize(outputs), errors.simulation.resize(outputs);
  for (Index begin = 0; begin < source.count; begin += team.size) {
    const Index end = std::min(source.count, begin + team.size), mine = begin + team.rank;
    std::optional<Given> own;
    if (mine < end) own = source.given(needs, mine);
    const auto digests = archive::unpacked<std::vector<std::string>>(
        team.broadcast(archive::packed(team.gather(archive::packed(own ? own->digests : std::vector<Digest>())))));
    std::optional<Portion> portion;
    for (Index i = begin; i < end; ++i) {
      if (i == mine) portion = evaluated_portion(needs, *std::exchange(own, {}), execution);
      remember(needs.state.digests, archive::unpacked<std::vector<Digest>>(digests[size_t(i - begin)]));
    }
    for (Index i = begin; i < end; ++i) {
      std::vector<std::string> all = team.gather(i == mine && !first ? archive::packed(*portion) : std::string());
      if (!first) continue;
      if (i != mine) portion = archive::unpacked<Portion>(all[size_t(i - begin)]);
      all.clear();
      add(state, *portion, execution);
      result.experiments.push_back(portion->factors.experiments);
      result.known.push_back(portion->known);
      if (portion->factors.experiments > 0) errors.add(portion->errors);
      for (Finding& finding : portion->findings) {
        finding.file = source.file(i);
        result.findings.push_back(std::move(finding));
      }
    }
  }
  if (!first) return result;
  state.digests = std::move(needs.state.digests);
  const bool centred = needs.mean.y.size() > 0;
  result.simulation = fit_of(errors.simulation, centred);
  result.one_step = fit_of(errors.one_step, centred);
  const Index added = std::accumulate(result.experiments.begin(), result.experiments.end(), Index{0});
  append(result.findings, findings_of_unknown(state, added));
  append(result.findings, findings_of_fits(result.simulation, result.one_step, state.factors.names));
  return result;
}

}  // namespace

Additions update(UpdateState& state, const Model& before, const Ensemble& more, const Execution& execution) {
  const Source source{1, [&](const Needs& needs, Index) { return given(needs, more, {}); },
                      [](Index) { return std::string(); }};
  return update_from(state, before, source, execution, {});
}

Additions update(UpdateState& state, const Model& before, const std::vector<std::filesystem::path>& files,
                 const UpdateOptions& options) {
  const Source source{Index(files.size()),
                      [&](const Needs& needs, Index i) { return given_by(files[size_t(i)], needs, options); },
                      [&](Index i) { return files[size_t(i)].string(); }};
  return update_from(state, before, source, options.execution, options.team);
}

}  // namespace tokid
