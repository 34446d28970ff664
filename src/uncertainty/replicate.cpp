// SPDX-License-Identifier: BSD-3-Clause
#include "uncertainty/replicate.hpp"

#include <algorithm>
#include <limits>

#include "base/integers.hpp"
#include "identify/identify.hpp"
#include "model/delays.hpp"
#include "tokid/em.hpp"

namespace tokid::uncertainty {

namespace {

// Most iterations of EM from a model to a replicate. Intervals from 20 iterations are 0.94 to 1.05 times as wide as
// those of whole identifications, and those from 5 iterations 0.65 to 0.86 times. Weaker smoothing moves the model
// farther, so EM goes on longer.
constexpr Index most_iterations = 20, most_farther = 60;
// EM has converged if an iteration without momentum increases the log-likelihood per output sample by less.
constexpr double settled = 1e-5, settled_farther = 1e-6;
// A thorough replicate has so many times the iterations, and converges to a smaller increase. EM is slow where the data
// say little. There, intervals of poles from 20 iterations are half as wide as those from 200.
constexpr Index thorough_factor = 10;
constexpr double thorough_settled = 1e-3;

// The options of the identification with all its choices fixed, for departures from the nominal trajectory.
IdentifyOptions held_options(const Model& model, IdentifyOptions options) {
  if (model.method != "regression") options.states = model.states();
  options.lags = model.max_lags() - latest(delays_of(model.provenance));
  options.feedthrough = has_feedthrough(model.provenance);
  options.initial_state = model.initial_state;
  options.nominal = NominalChoice::none;
  options.frame = Frame::raw;
  options.hold_out = 0.0;
  options.outliers = OutlierChoice::keep;  // the data are corrected already
  options.choices = model.provenance.choices;
  options.execution = {};
  return options;
}

Identifier by_identification(const Model& model, const IdentifyOptions& identification, double share) {
  IdentifyOptions held = held_options(model, identification);
  if (held.choices && share != 1.0) {
    held.choices->variation.smoothing *= share;
    held.choices->state_smoothing *= share;
  }
  return [held = std::move(held)](const Ensemble& e) { return identify_part(e, held, false).model; };
}

// The penalty of EM acts on the coordinates. The start therefore has coordinates that vary slowly.
Identifier by_more_em(const Model& model, double share, Care care) {
  Model start = model.frame == "smooth" ? model : smooth_frame(model, estimation_window(model));
  start.frame = "smooth";
  start.u_nominal.resize(0, 0);
  start.y_nominal.resize(0, 0);
  RefineOptions o;
  o.smoothing = share * model.provenance.refinement->smoothing;
  o.period = model.period;
  o.iterations = share == 1.0 ? most_iterations : most_farther;
  o.tolerance = share == 1.0 ? settled : settled_farther;
  if (care == Care::thorough) {
    o.iterations *= thorough_factor;
    o.tolerance *= thorough_settled;
  }
  o.initial_state = model.initial_state;
  o.feedthrough = has_feedthrough(model.provenance);
  if (model.provenance.choices && model.period == 0) o.jumps = model.provenance.choices->variation.jumps;
  o.warm_up = false;
  return [start = std::move(start), o](const Ensemble& e) { return refine(start, e, o).model; };
}

}  // namespace

bool by_em(const Model& model) { return model.method == "em" && model.provenance.refinement; }

double smoothing_of(const Model& model) {
  if (model.period > 0) return std::numeric_limits<double>::infinity();
  if (by_em(model)) return model.provenance.refinement->smoothing;
  return model.provenance.choices ? model.provenance.choices->variation.smoothing : 0.0;
}

Identifier identifier(const Model& model, const IdentifyOptions& identification, double share, Care care) {
  // EM would also change the states that hold inputs on their way.
  return by_em(model) && latest(delays_of(model.provenance)) == 0 ? by_more_em(model, share, care)
                                                                  : by_identification(model, identification, share);
}

Index unknowns_of_states(const Model& model, Index steps) {
  const bool on_windows = model.method == "regression" && smoothing_of(model) == 0;
  const Index all = on_windows ? unknowns(model, model.k_end() - 1) : model.states() + model.inputs;
  return model.period > 0 && steps > 0 ? ceil_div(all * std::min(model.period, steps), steps) : all;
}

}  // namespace tokid::uncertainty
