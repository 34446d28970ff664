// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/update.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <string_view>
#include <type_traits>
#include <utility>

#include "base/archive.hpp"
#include "base/words.hpp"
#include "data/window_kind.hpp"
#include "diagnose/regressions.hpp"
#include "diagnose/survey.hpp"
#include "identify/identify_stretch.hpp"
#include "large/evaluate.hpp"
#include "method/realisation.hpp"
#include "tokid/remarks.hpp"
#include "tokid/smooth_arx.hpp"
#include "tokid/subspace.hpp"
#include "tokid/tvera.hpp"
#include "tokid/version.hpp"

namespace tokid {

namespace {

// The options and choices that the text of a model holds, as a model that has nothing else.
Model with_options(const std::string& options) {
  Model model;
  model.options = options;
  return model;
}

GtvArx regressions(const UpdateState& state, const Windows& windows, const NoisyChoices& choices,
                   const Execution& execution) {
  if (state.together)
    return smooth_arx(windows, {state.factors.lags, state.factors.initial_state, choices.variation, execution});
  GtvArxOptions o;
  o.lags = {state.factors.lags};
  o.initial_state = state.factors.initial_state;
  o.spent = state.nominal ? 1 : 0;
  o.execution = execution;
  return gtv_arx(windows, o);
}

Model tvera_model(const UpdateState& state, const IdentifyOptions& options, const Windows& windows, const GtvArx& arx,
                  const Execution& execution) {
  const Index m = windows.outputs(), r = windows.inputs();
  TveraOptions o = tvera_options(options, state.factors.lags, m, state.noisy);
  const Vector sizes = windows.channel_sizes();
  o.states = state.states;
  o.input_size = sizes.head(r);
  o.output_size = sizes.tail(m);
  o.execution = execution;
  Model model = tvera(markov(arx, o.rows + o.cols - 1, execution), {}, o);
  note_regressions(arx, model);
  return model;
}

Model subspace_model(const UpdateState& state, const IdentifyOptions& options, const Windows& windows,
                     const GtvArx& arx, const NoisyChoices& choices, const Execution& execution) {
  SubspaceOptions o;
  o.states = state.states;
  o.noisy = state.noisy;
  o.weighting = options.weighting.value_or(Weighting::one_step);
  if (state.together) {
    o.variation = choices.variation;
    o.state_smoothing = choices.state_smoothing;
    o.weighting = choices.weighting;
  }
  o.execution = execution;
  return subspace(windows, arx, o);
}

}  // namespace

UpdateState update_state(const Ensemble& data, const Identification& result, const IdentifyOptions& options) {
  if (result.held_out)
    throw std::invalid_argument("hold-out fraction: a state is of all experiments, none can be held out");
  if (data.free.experiments > 0 && result.model.method == "tvera")
    throw std::invalid_argument("free responses: found, a state of forced experiments alone can be kept");
  if (result.noisy && result.model.states() == 0)
    throw std::invalid_argument("states: none found in the noise, at least one needed to go on from");
  UpdateState state;
  state.together = result.together;
  state.noisy = result.noisy;
  state.nominal = result.nominal;
  state.method = result.model.method == "tvera" ? Method::tvera : Method::subspace;
  NoisyChoices choices = result.choices.value_or(
      NoisyChoices{result.variation, result.state_smoothing, options.weighting.value_or(Weighting::one_step), 0.0, 0});
  // Without noise the rank goes on to tell n; with it, what was chosen.
  state.states = options.states > 0 ? options.states : result.noisy ? result.model.states() : 0;
  // Where EM began is not what does best without it.
  if (choices.refinement_iterations > 0 && !options.choices) {
    choices.state_smoothing = result.order_scores.smoothing;
    if (options.states == 0) state.states = result.order_scores.best;
  }
  choices.refinement_smoothing = 0.0;
  choices.refinement_iterations = 0;
  if ((result.together && choices.weighting == Weighting::projection) || options.weighting == Weighting::projection)
    throw std::invalid_argument(
        "weighting: projection found, which needs samples; --weighting one-step or many-steps can be updated");
  const bool copied = !result.copies.groups.empty();
  const Ensemble once = copied ? data.subset(result.copies.used) : Ensemble();
  const Ensemble& used = copied ? once : data;
  Model told = with_options(result.model.options);
  note_update(told, used.experiments());
  if (result.together) note_choices(told, choices);
  state.options = told.options;
  state.factors = window_factors(used, result.lags, result.model.initial_state, options.execution);
  return state;
}

Updated identify(const UpdateState& state, const Execution& execution) {
  const Model told = with_options(state.options);
  const IdentifyOptions options = identify_options(told);
  const std::optional<NoisyChoices> noted = noted_choices(told);
  if (state.together && !noted)
    throw std::invalid_argument("options of the state: no choices found, those of an identification needed");
  const NoisyChoices choices = noted.value_or(NoisyChoices{});
  const WindowFactors& factors = state.factors;
  Nominal nominal;
  if (state.nominal) nominal = factors.nominal();
  if (state.nominal && options.period > 0) share_phases(nominal, options.period);
  const Windows windows(factors, state.nominal ? &nominal : nullptr);
  const GtvArx arx = regressions(state, windows, choices, execution);

  Updated result;
  result.experiments = factors.experiments;
  Model& model = result.model;
  model = state.method == Method::tvera ? tvera_model(state, options, windows, arx, execution)
                                        : subspace_model(state, options, windows, arx, choices, execution);
  model.dt = factors.dt;
  model.names = factors.names;
  model.initial_state = factors.initial_state;
  if (model.initial_state == InitialState::unknown && model.period == 0 && model.states() > 0)
    model = from_step(model, model.full_begin());
  if (state.nominal) {
    model.u_nominal = nominal.u;
    model.y_nominal = nominal.y;
  }
  std::string told_of_frame;
  model = in_frame(std::move(model), options, factors.lags, told_of_frame);
  if (!told_of_frame.empty()) result.warnings.push_back(told_of_frame);
  model.version = version;
  model.options = state.options;

  check_finite(model);

  std::vector<Index> starved;
  double residual = 0.0, square = 0.0;
  for (Index k = arx.k_begin; k < arx.steps(); ++k) {
    const GtvArxStep& step = arx.step[size_t(k)];
    residual += arx.residual_cov(k).trace();
    square += arx.output_rms(k).squaredNorm();
    if (state.together) continue;
    result.condition_max = std::max(result.condition_max, step.condition);
    if (step.rank < arx.regressors(k)) ++result.rank_deficient_steps;
    if (step.rows - (state.nominal ? 1 : 0) < arx.regressors(k)) starved.push_back(k);
  }
  if (!state.noisy && residual > rounding_share * rounding_share * square)
    result.warnings.emplace_back(
        "the experiments are noisy, and what was chosen from the first ones supposes that they are not: begin anew with "
        "identify");
  if (!starved.empty())
    result.warnings.push_back(
        fmt::format("fewer experiments than unknowns at {}: the solution of smallest norm stands "
                    "in there",
                    words::step_list(starved)));
  if (state.states > 0 && model.states() < state.states)
    result.warnings.push_back(
        fmt::format("{} states asked for, but the experiments show only {}", state.states, model.states()));
  return result;
}

void check_update(const UpdateState& state, const Ensemble& more) {
  const Survey samples = checked(more);
  const WindowFactors& before = state.factors;
  check_alike(before, kind_of(more, before.lags, more.initial_state.value_or(before.initial_state)));
  if (more.free.experiments > 0)
    throw std::invalid_argument("free responses: found, forced experiments alone can be added");
  if (has_seen(with_options(state.options), more))
    throw std::invalid_argument("experiments: the state has these already, they would count twice");
  check_magnitudes(samples, more.names, more.inputs());
}

namespace {

// What is left of experiments when they have been factorised.
struct Portion {
  WindowFactors factors;
  std::string fingerprint;
  ErrorTotals errors;                // of the model before
  std::vector<std::string> remarks;  // on their file
};

// Of experiments that are checked, each of them once; they are left that way.
Portion portion(const UpdateState& state, Ensemble& more, const Execution& execution) {
  Portion result;
  result.fingerprint = tokid::fingerprint(more);
  const Copies copies = find_copies(more);
  result.remarks = warnings_of(copies, more);
  if (!copies.groups.empty()) more = more.subset(copies.used);
  result.factors = window_factors(more, state.factors.lags, state.factors.initial_state, execution);
  return result;
}

void add(UpdateState& state, const Portion& more, const Execution& execution) {
  Model told = with_options(state.options);
  merge(state.factors, more.factors, execution);
  note_data(told, more.fingerprint);
  note_update(told, state.factors.experiments);
  state.options = told.options;
}

}  // namespace

std::vector<std::string> update(UpdateState& state, const Ensemble& more, const Execution& execution) {
  check_update(state, more);
  Ensemble experiments = more;
  Portion added = portion(state, experiments, execution);
  add(state, added, execution);
  return std::move(added.remarks);
}

// For messages between processes.
template <class Archive, class F>
requires std::is_same_v<std::remove_const_t<F>, WindowFactors>
void fields(Archive& archive, F& f) {
  archive(f.inputs, f.outputs, f.lags, f.initial_state, f.dt, f.names, f.experiments, f.rows, f.factor, f.count, f.sum,
          f.spread);
}

template <class Archive, class S>
requires std::is_same_v<std::remove_const_t<S>, UpdateState>
void fields(Archive& archive, S& s) {
  archive(s.factors, s.options, s.method, s.states, s.together, s.noisy, s.nominal);
}

namespace {

template <class Archive, class P>
requires std::is_same_v<std::remove_const_t<P>, Portion>
void fields(Archive& archive, P& p) { archive(p.factors, p.fingerprint, p.errors, p.remarks); }

// All that a member needs to know of the state and its model to make a portion of a file.
struct Needs {
  UpdateState state;  // without factors
  Model model;        // of departures, where `mean` is what they depart from
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
  result.state.options = state.options;
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

Portion portion_of_file(const Needs& needs, const std::filesystem::path& file, const UpdateOptions& options) {
  ReadOptions read = options.read;
  read.wanted = complete(needs.state.factors.names, needs.state.factors.inputs, needs.state.factors.outputs);
  Ensemble data = load_ensemble(file, read);
  return about(file, [&] {
    std::vector<std::string> found = remarks(needs.model, data);
    if (!data.dt_stated) data.dt = needs.state.factors.dt;
    check_update(needs.state, data);
    Portion result = portion(needs.state, data, options.execution);
    result.remarks.insert(result.remarks.begin(), found.begin(), found.end());
    if (needs.mean.y.size() > 0) data = departures(std::move(data), needs.mean);
    result.errors = stream::evaluate(needs.model, data, 0, data.steps(), needs.model.initial_state, true);
    return result;
  });
}

}  // namespace

Additions additions(std::vector<Index> experiments, Fit simulation, Fit one_step, const Channels& names) {
  Additions result{std::move(experiments), std::move(simulation), std::move(one_step), {}};
  const auto warn = [&](std::string_view text) {
    result.warnings.push_back(fmt::format(
        "new experiments, by the model before: {}; are they of the same system, with the same channels?", text));
  };
  for (Index j = 0; j < result.one_step.fit.size(); ++j)
    if (result.one_step.samples > 0 && std::isnan(result.one_step.fit(j)))
      warn(fmt::format("output {} never moves in them", names.output(j)));
  for (const std::string& text : warnings_of_fit(result.one_step.fit, names)) warn(text);
  if (!result.warnings.empty()) return result;
  // Outputs that change slowly are predicted by themselves, whatever the system.
  constexpr double much_worse = -20.0;
  for (Index j = 0; j < result.simulation.fit.size(); ++j)
    if (result.simulation.fit(j) < much_worse)
      warn(fmt::format("output {} is simulated worse than by its mean: {:.3g} % fit", names.output(j),
                       result.simulation.fit(j)));
  return result;
}

Additions update(UpdateState& state, const Model& before, const std::vector<std::filesystem::path>& files,
                 const UpdateOptions& options) {
  const Team& team = options.team;
  const bool first = team.rank == 0;
  // All members follow what the first one knows, to the last bit.
  const Needs needs =
      archive::unpacked<Needs>(team.broadcast(first ? archive::packed(needs_of(state, before)) : std::string()));
  std::vector<Index> experiments;
  std::vector<std::string> fingerprints;
  ErrorTotals errors;
  std::vector<std::string> found;
  // In the order of the files; meanwhile each member is at the next of its own. So the first one holds one portion.
  for (size_t i = 0; i < files.size(); ++i) {
    const Index owner = Index(i) % team.size;
    std::optional<Portion> own;
    if (owner == team.rank) own = portion_of_file(needs, files[i], options);
    std::vector<std::string> all = team.gather(own && !first ? archive::packed(*own) : std::string());
    if (!first) continue;
    if (!own) own = archive::unpacked<Portion>(all[size_t(owner)]);
    all.clear();
    const auto same = std::find(fingerprints.begin(), fingerprints.end(), own->fingerprint);
    if (same != fingerprints.end())
      throw std::invalid_argument(fmt::format("{}: experiments: the same as in {}, they would count twice",
                                              files[i].string(), files[size_t(same - fingerprints.begin())].string()));
    fingerprints.push_back(own->fingerprint);
    about(files[i], [&] { add(state, *own, options.execution); });
    experiments.push_back(own->factors.experiments);
    errors.add(own->errors);
    for (const std::string& text : own->remarks) found.push_back(fmt::format("{}: {}", files[i].string(), text));
  }
  const bool centred = needs.mean.y.size() > 0;
  Additions result = additions(std::move(experiments), fit_of(errors.simulation, centred),
                               fit_of(errors.one_step, centred), state.factors.names);
  result.warnings.insert(result.warnings.begin(), found.begin(), found.end());
  return result;
}

}  // namespace tokid
