// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/plan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "base/integers.hpp"
#include "data/output_weights.hpp"
#include "model/delays.hpp"
#include "noise/observer_form.hpp"
#include "tokid/markov.hpp"
#include "tokid/subspace.hpp"
#include "tokid/tvera.hpp"

namespace tokid {

namespace {

// Block columns of the Hankel matrices H_k for noisy data. In trials, twice as many columns improved no model, and half
// as many made models worse.
constexpr Index noisy_columns = 48;

GtvArx regressions_of_each_step(const Windows& windows, const Plan& plan, const Execution& execution) {
  GtvArxOptions o;
  o.lags = {plan.lags};
  o.initial_state = plan.initial_state;
  o.feedthrough = plan.feedthrough.present;
  o.spent = plan.nominal ? 1 : 0;
  o.execution = execution;
  return windows.ensemble() ? gtv_arx(*windows.ensemble(), o) : gtv_arx(windows, o);
}

Model tvera_model(const Windows& windows, GtvArx arx, const FreeResponse& free, const Plan& plan,
                  const Execution& execution) {
  TveraOptions o = tvera_options(plan, windows.outputs());
  const Markov parameters = markov(arx, o.rows + o.cols - 1, share(execution, 0.0, 0.5));
  arx.forget_noise_shapes();
  o.execution = share(execution, 0.5, 1.0);
  return completed(tvera(parameters, free, o), windows, arx, plan);
}

// The weights of the outputs in a realisation. If n is not stated and there is no noise, the model has all states.
// Weights could then only falsify their numerical rank.
Vector realisation_weights(const Plan& plan) { return plan.states > 0 || plan.noisy ? plan.output_weights : Vector(); }

Vector weighted_sizes(const Plan& plan, Index outputs) {
  const Vector weights = realisation_weights(plan);
  if (weights.size() == 0) return plan.output_size;
  const Vector factors = unit_factors(weights, outputs);
  return plan.output_size.size() > 0 ? Vector(plan.output_size.cwiseProduct(factors)) : factors;
}

SubspaceOptions subspace_options(const Plan& plan, const Execution& execution) {
  SubspaceOptions o;
  o.states = plan.states;
  o.variation = plan.choices.variation;
  o.state_smoothing = plan.choices.state_smoothing;
  o.weighting = plan.choices.weighting;
  o.output_weights = realisation_weights(plan);
  o.noisy = plan.noisy;
  o.execution = execution;
  return o;
}

Model from_where_it_is_followed(Model model, const Plan& plan) {
  if (plan.from_full_dimension) return from_known_state(std::move(model), plan.initial_state);
  model.initial_state = plan.initial_state;
  return model;
}

}  // namespace

GtvArx regressions(const Windows& windows, const Plan& plan, const Execution& execution) {
  if (!plan.coupled) return regressions_of_each_step(windows, plan, execution);
  return smooth_arx(windows,
                    {plan.lags, plan.initial_state, plan.feedthrough.present, plan.choices.variation, execution});
}

Model realise(const Windows& windows, GtvArx arx, const FreeResponse& free, const Plan& plan,
              const Execution& execution) {
  if (plan.method == Method::tvera) return tvera_model(windows, std::move(arx), free, plan, execution);
  if (plan.method == Method::regression)
    return from_where_it_is_followed(observer_form(windows, arx, plan.choices.variation), plan);
  return from_where_it_is_followed(subspace(windows, arx, subspace_options(plan, execution)), plan);
}

TveraOptions tvera_options(const Plan& plan, Index outputs) {
  const Index p = plan.lags, n = plan.states;
  TveraOptions o;
  o.states = n;
  o.rows = plan.rows.value_or(std::max(p + 1, ceil_div(n, outputs) + 1));
  // A single input may have to reach all n states. This takes at most n steps of the input, so n block columns suffice.
  // With noise, more columns determine the states better, above all slow and unstable states.
  const Index most = plan.noisy ? noisy_columns : n > 0 ? n : p * outputs;
  o.cols = plan.cols.value_or(std::max(p, most));
  o.output_size = weighted_sizes(plan, outputs);
  o.input_size = plan.input_size;
  return o;
}

bool is_centred(const Plan& plan) { return plan.nominal && plan.nominal_period == 0; }

Model completed(Model model, const Windows& windows, const GtvArx& arx, const Plan& plan) {
  if (model.steps() > 0 && (arx.steps() != model.k_end() || arx.inputs != model.inputs || arx.outputs != model.outputs))
    throw std::invalid_argument(
        fmt::format("arx: {} steps, {} inputs, {} outputs found, {}, {}, {} needed as in the model", arx.steps(),
                    arx.inputs, arx.outputs, model.k_end(), model.inputs, model.outputs));
  model.dt = windows.dt;
  model.names = windows.names;
  for (Index k = model.k_begin; k < model.k_end(); ++k) {
    const GtvArxStep& regression = arx.step[size_t(k)];
    Step& step = model.at(k);
    step.set_innovation_cov(arx.residual_cov(k));
    step.set_condition(regression.condition);
    step.set_rank(regression.rank);
    step.set_lags(regression.lags);
  }
  return from_where_it_is_followed(std::move(model), plan);
}

Model from_known_state(Model model, InitialState initial) {
  model.initial_state = initial;
  if (initial == InitialState::unknown && model.period == 0 && model.states() > 0)
    model = from_step(model, model.full_begin());
  return model;
}

Index frame_step(const Model& model, const Plan& plan) { return plan.reference_step.value_or(model.full_begin()); }

FramedModel in_frame(Model model, const Plan& plan) {
  const Index rows = latest(plan.choices.delays) +
                     std::max<Index>(plan.lags, ceil_div(std::max<Index>(1, model.states()), model.outputs));
  if (plan.frame == Frame::reference) return reference_frame(model, frame_step(model, plan), rows);
  const Index begin = model.k_begin, end = model.k_end();
  return {plan.frame == Frame::smooth ? smooth_frame(model, rows) : std::move(model), begin, end};
}

Findings findings_of_frame(const FramedModel& framed, Index step, const Plan& plan) {
  if (plan.frame != Frame::reference) return {};
  return {{.kind = Finding::Kind::frame_limits,
           .numbers = {{"step", double(step)}, {"begin", double(framed.begin)}, {"end", double(framed.end)}}}};
}

}  // namespace tokid
