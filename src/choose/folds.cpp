// SPDX-License-Identifier: BSD-3-Clause
#include "choose/folds.hpp"

#include <algorithm>
#include <cmath>

#include "base/integers.hpp"
#include "choose/first_steps.hpp"
#include "data/output_weights.hpp"
#include "tokid/plan.hpp"

namespace tokid {

namespace {

// For the progress: number of orders and of λ of the regressions on states that are usually tried.
constexpr double usual_orders = 15.0;

}  // namespace

void OrderScores::add(Index n, const Vector& errors_of_horizons) {
  states.push_back(n);
  errors.conservativeResize(Index(states.size()), errors_of_horizons.size());
  errors.bottomRows(1) = errors_of_horizons.transpose();
  smallest = std::min(smallest, mean(states.size() - 1));
}

double OrderScores::mean(size_t i) const { return errors.row(Index(i)).mean() + price * double(states[i]); }

void OrderScores::choose() {
  for (size_t i = states.size(); i-- > 0;) {
    const double uncertain = i < uncertainty.size() ? uncertainty[i] : 0.0;
    if (mean(i) <= smallest + std::clamp(uncertain, std::log(worth_it), std::log(most_uncertain))) best = states[i];
  }
}

Index Folds::validating(Index experiments) {
  constexpr Index fewest = 3, held_out = 20;
  const Index folds = fold_count(experiments), needed = (held_out * folds + experiments - 1) / experiments;
  return std::clamp(needed, std::min(fewest, folds), folds);
}

Folds::Folds(const Ensemble& ensemble, const Options& options)
    : options_(options), all_(fold_count(ensemble.experiments())), folds_(size_t(validating(ensemble.experiments()))) {
  const Index period = options.variation.period;
  ahead_ = ahead_in(ensemble, first_scored(options.initial_state, options.lags, period), options.horizons, period);
  SmoothArxOptions arx_options;
  arx_options.lags = options.lags;
  arx_options.initial_state = options.initial_state;
  arx_options.feedthrough = options.feedthrough;
  arx_options.variation = options.variation;
  options_.execution.progress = {};
  parallel_for(0, Index(folds_.size()), options.execution, [&](Index begin, Index end) {
    for (Index f = begin; f < end; ++f) {
      Fold& own = folds_[size_t(f)];
      own.data = fold(ensemble, f, all_, options.centred);
      own.arx = smooth_arx(own.data.training, arx_options);
    }
  });
  factorise(0);
}

// `future`: as in SubspaceOptions
void Folds::factorise(Index future) {
  parallel_for(0, Index(folds_.size()), options_.execution, [&](Index begin, Index end) {
    SubspaceOptions o;
    o.variation = options_.variation;
    o.output_weights = options_.output_weights;
    o.future = future;
    for (Index f = begin; f < end; ++f)
      for (const Weighting weighting : options_.weightings) {
        Fold& own = folds_[size_t(f)];
        o.weighting = weighting;
        own.factors[weighting] = predictor_factors(own.data.training, own.arx, o);
      }
  });
}

HeldOutError Folds::error_of(Index states, Weighting weighting, double smoothing, const Execution& execution) const {
  std::vector<Squares> found(folds_.size());
  std::vector<char> complete(folds_.size(), 0);
  parallel_for(0, Index(folds_.size()), execution, [&](Index begin, Index end) {
    for (size_t f = size_t(begin); f < size_t(end); ++f) {
      Model model = start(f, states, weighting, smoothing);
      if (model.steps() == 0 || model.states() != states) continue;
      found[f] = squares(f, std::move(model), ahead_);
      complete[f] = 1;
    }
  });
  if (std::find(complete.begin(), complete.end(), 0) != complete.end()) return {};
  return held_out_error(joined(found), weights_of(options_.output_weights, folds_.front().arx.outputs));
}

Model Folds::start(size_t f, Index states, Weighting weighting, double smoothing) const {
  SubspaceOptions o;
  o.variation = options_.variation;
  o.states = states;
  o.weighting = weighting;
  o.output_weights = options_.output_weights;
  o.state_smoothing = smoothing;
  const Fold& own = folds_[f];
  return from_known_state(realise(own.data.training, own.arx, own.factors.at(weighting), o), options_.initial_state);
}

std::vector<Model> Folds::models_of(const OrderScores& scores, Index states) const {
  std::vector<Model> models(folds_.size());
  parallel_for(0, Index(models.size()), {options_.execution.threads, {}}, [&](Index begin, Index end) {
    for (size_t f = size_t(begin); f < size_t(end); ++f)
      models[f] = start(f, states, scores.weighting, scores.smoothing);
  });
  return models;
}

std::vector<Model> Folds::from_first_step(std::vector<Model> models) const {
  parallel_for(0, Index(models.size()), {options_.execution.threads, {}}, [&](Index begin, Index end) {
    for (size_t f = size_t(begin); f < size_t(end); ++f)
      models[f] = with_first_steps(models[f], folds_[f].data.training, options_.initial_state, 1);
  });
  return models;
}

RefinementSettings Folds::refinement_settings() const {
  RefinementSettings s;
  s.em.period = options_.variation.period;
  s.em.initial_state = options_.initial_state;
  s.em.feedthrough = options_.feedthrough;
  s.em.jumps = options_.variation.jumps;
  s.smoothing = options_.variation.smoothing;
  s.output_weights = weights_of(options_.output_weights, folds_.front().arx.outputs);
  s.ahead = ahead_;
  for (const Fold& fold : folds_) s.data.push_back(&fold.data);
  s.folds = all_;
  s.threads = options_.execution.threads;
  return s;
}

Squares Folds::squares(size_t f, Model model, const Ahead& ahead) const {
  const Ensemble& held_out = folds_[f].data.held_out;
  return squares_of(predicted_by(std::move(model), held_out, options_.initial_state, ahead), held_out, ahead);
}

std::vector<Squares> Folds::squares(const std::vector<Model>& models, const Ahead& ahead) const {
  std::vector<Squares> result(models.size());
  parallel_for(0, Index(models.size()), {options_.execution.threads, {}}, [&](Index begin, Index end) {
    for (size_t f = size_t(begin); f < size_t(end); ++f) result[f] = squares(f, models[f], ahead);
  });
  return result;
}

// Tries increasing orders, with larger steps between larger ones, until two in succession are worse than the best one.
// Then orders between its neighbours follow, in halves, and those below it down to the fewest states that suffice.
OrderScores Folds::scores(Weighting weighting, double smoothing, Index least, Index most,
                          const Execution& execution) const {
  std::map<Index, HeldOutError> found;
  const auto error = [&](Index n) {
    if (!found.contains(n)) found.emplace(n, error_of(n, weighting, smoothing, execution));
    return found.at(n).value;
  };
  Index best = least;
  for (Index n = least, i = 1, worse = 0; !std::isinf(error(n)); n = std::min(least + i - 1, most)) {
    worse = error(n) <= error(best) ? 0 : worse + 1;
    if (worse == 0) best = n;
    if (worse == 2 || n == most) break;
    i = next_of_grid(i);
  }
  for (Index step = (best - least + 1) / 4; step > 0; step /= 2)
    for (const Index n : {best - step, best + step})
      if (n >= least && n <= most && error(n) <= error(best)) best = n;
  const auto chosen = [&] {
    OrderScores result;
    result.smoothing = smoothing;
    result.weighting = weighting;
    result.cross_validated = true;
    result.horizons = ahead_.horizons;
    for (const auto& [n, errors] : found) {
      if (std::isinf(errors.value)) continue;
      result.add(n, errors.of_horizon);
      result.uncertainty.push_back(standard_error(errors, found.at(best)));
    }
    result.choose();
    return result;
  };
  OrderScores result = chosen();
  Index below = least - 1;  // the most states that do not suffice
  for (const Index n : result.states) below = n < result.best ? std::max(below, n) : below;
  while (result.best - below > 1) {
    const Index n = (below + result.best) / 2;
    error(n);
    result = chosen();
    if (result.best > n) below = n;
  }
  return result;
}

// If the search comes near the number of singular values that the factors show, factors with all p block rows show
// more. realise() then uses them, too (SubspaceOptions::future).
OrderScores Folds::choose_states(std::optional<Index> states, Index most, const Execution& execution) {
  const OrderScores found = choose_shown_states(states, most, execution);
  const PredictorFactors& factors = folds_.front().factors.at(options_.weightings.front());
  const Index shown = factors.future * folds_.front().arx.outputs;
  if (factors.future >= options_.lags || (found.best > 0 && 2 * found.best <= shown)) return found;
  factorise(options_.lags);
  return choose_shown_states(states, most, execution);
}

OrderScores Folds::choose_shown_states(std::optional<Index> states, Index most, const Execution& execution) const {
  SearchProgress work(execution, double(folds_.size()) * usual_orders);
  const auto among = [&](Weighting weighting, double smoothing, Index least, Index largest) {
    return scores(weighting, smoothing, states.value_or(least), states.value_or(largest),
                  {execution.threads, work.counted()});
  };
  OrderScores all =
      among(options_.weightings.front(), SubspaceOptions::state_share * options_.variation.smoothing, 1, most);
  for (size_t i = 1; i < options_.weightings.size(); ++i) {
    OrderScores other = among(options_.weightings[i], all.smoothing, 1, most);
    if (other.smallest < all.smallest) all = std::move(other);
  }
  if (options_.variation.period > 0) return all;
  OrderScores best = all;
  for (const double factor : {std::sqrt(0.1), std::sqrt(10.0)}) {
    bool moved = false;
    for (int step = 0; step < 3 && best.smoothing > 0 && best.best > 0; ++step) {
      OrderScores next = among(best.weighting, best.smoothing * factor, std::max<Index>(1, best.best - 1),
                               std::min(best.best + 1, most));
      if (!(next.smallest < best.smallest)) break;
      best = std::move(next);
      moved = true;
    }
    if (moved) break;
  }
  all.best = best.best;
  all.smoothing = best.smoothing;
  all.smallest = best.smallest;
  return all;
}

}  // namespace tokid
