// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/update.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "realisation.hpp"
#include "regressions.hpp"
#include "survey.hpp"
#include "tokid/smooth_arx.hpp"
#include "tokid/subspace.hpp"
#include "tokid/tvera.hpp"
#include "tokid/version.hpp"
#include "words.hpp"

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
  // Without noise the rank goes on to tell n; with it, what was chosen.
  state.states = options.states > 0 ? options.states : result.noisy ? result.model.states() : 0;
  NoisyChoices choices = result.choices.value_or(
      NoisyChoices{result.variation, result.state_smoothing, options.weighting.value_or(Weighting::one_step), 0.0, 0});
  choices.refinement_smoothing = 0.0;
  choices.refinement_iterations = 0;
  if ((result.together && choices.weighting == Weighting::projection) || options.weighting == Weighting::projection)
    throw std::invalid_argument(
        "weighting: projection found, which needs samples; --weighting one-step or many-steps can be updated");
  Model told = with_options(result.model.options);
  note_update(told, data.experiments());
  if (result.together) note_choices(told, choices);
  state.options = told.options;
  state.factors = window_factors(data, result.lags, result.model.initial_state, options.execution);
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
    result.warnings.push_back(
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
  more.check();
  if (more.inputs() != state.factors.inputs)
    throw std::invalid_argument(
        fmt::format("inputs: {} found, {} needed as in the experiments before", more.inputs(), state.factors.inputs));
  if (more.outputs() != state.factors.outputs)
    throw std::invalid_argument(fmt::format("outputs: {} found, {} needed as in the experiments before", more.outputs(),
                                            state.factors.outputs));
  if (has_seen(with_options(state.options), more))
    throw std::invalid_argument("experiments: the state has these already, they would count twice");
  check_magnitudes(survey(more, 0, more.steps()), more.names, more.inputs());
  if (more.free.experiments > 0)
    throw std::invalid_argument("free responses: found, forced experiments alone can be added");
  if (more.initial_state && *more.initial_state != state.factors.initial_state)
    throw std::invalid_argument(fmt::format("initial states: {} found, {} needed as in the experiments before",
                                            to_string(*more.initial_state), to_string(state.factors.initial_state)));
  if (more.steps() != state.factors.steps())
    throw std::invalid_argument(
        fmt::format("steps: {} found, {} needed as in the experiments before", more.steps(), state.factors.steps()));
}

void update(UpdateState& state, const Ensemble& more, const Execution& execution) {
  check_update(state, more);
  Model told = with_options(state.options);
  merge(state.factors, window_factors(more, state.factors.lags, state.factors.initial_state, execution), execution);
  note_data(told, fingerprint(more));
  note_update(told, state.factors.experiments);
  state.options = told.options;
}

}  // namespace tokid
