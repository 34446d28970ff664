// SPDX-License-Identifier: BSD-3-Clause
#include "choose/folds.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/nan.hpp"
#include "data/output_weights.hpp"
#include "tokid/plan.hpp"
#include "tokid/validate.hpp"

namespace tokid {

namespace {

// For the progress: number of orders and of λ of the regressions on states that are usually tried.
constexpr double usual_orders = 15.0;
// After 1, 2, 3, 4, 6, 8, 12, 16, 24 …
Index next_of_grid(Index i) { return i < 4 ? i + 1 : (i & (i - 1)) == 0 ? i / 2 * 3 : i / 3 * 4; }

// Standard error of the difference of two models that were validated on the same folds.
double standard_error(const std::vector<Errors>& a, const std::vector<Errors>& b) {
  const double count = double(a.size()), mean = mean_of(a).mean() - mean_of(b).mean();
  double square = 0.0;
  for (size_t f = 0; f < a.size(); ++f) square += std::pow(a[f].mean() - b[f].mean() - mean, 2);
  return count > 1 ? std::sqrt(square / (count * (count - 1))) : 0.0;
}

}  // namespace

Errors mean_of(const std::vector<Errors>& folds) {
  Errors mean;
  for (const Errors& e : folds) {
    mean.one_step += e.one_step / double(folds.size());
    mean.ahead += e.ahead / double(folds.size());
    mean.simulation += e.simulation / double(folds.size());
  }
  return mean;
}

void OrderScores::add(Index n, double one_step_error, double ahead_error, double simulation_error) {
  states.push_back(n);
  one_step.push_back(one_step_error);
  ahead.push_back(ahead_error);
  simulation.push_back(simulation_error);
  smallest = std::min(smallest, mean(states.size() - 1));
}

double OrderScores::mean(size_t i) const {
  return Errors{one_step[i], ahead[i], simulation[i]}.mean() + price * double(states[i]);
}

void OrderScores::choose() {
  for (size_t i = states.size(); i-- > 0;) {
    const double uncertain = i < uncertainty.size() ? uncertainty[i] : 0.0;
    if (mean(i) <= smallest + std::clamp(uncertain, std::log(worth_it), std::log(most_uncertain))) best = states[i];
  }
}

Model of_departures(Model model, const Ensemble& data) {
  model.y_nominal = Matrix::Zero(data.steps(), data.outputs());
  model.u_nominal = Matrix::Zero(data.steps(), data.inputs());
  return model;
}

Ensemble ahead_by(Model model, const Ensemble& data, InitialState initial) {
  const Index horizon = std::min(OrderScores::horizon, std::max<Index>(1, data.steps() - 1));
  return predict(of_departures(std::move(model), data), data, {horizon, initial}).y;
}

Computed computed_by(Model model, const Ensemble& data, InitialState initial, Index first) {
  model = of_departures(std::move(model), data);
  Computed result{predict(model, data, {1, initial}).y, ahead_by(model, data, initial),
                  simulate_data(model, data, initial)};
  for (Ensemble* outputs : {&result.one_step, &result.ahead, &result.simulation})
    for (Index k = 0; k < std::min(first, data.steps()); ++k) outputs->output(k).setConstant(nan);
  return result;
}

Errors errors_of(Computed computed, const Ensemble& data, const Vector& weights, const Computed* like) {
  const Matrix none =
      Matrix::Zero(data.steps(), data.outputs());  // `data` are departures, so errors are relative to zero
  // Outputs that are always zero do not count, nor do outputs of weight zero.
  const Vector of_output = weights_of(weights, data.outputs());
  std::vector<Index> counted;
  for (Index j = 0; j < data.outputs(); ++j)
    for (Index k = 0; k < data.steps(); ++k)
      if (of_output(j) > 0 && (data.output(k).col(j).array().abs() > 0).any()) {  // neither zero nor NaN
        counted.push_back(j);
        break;
      }
  const auto score = [&](Ensemble Computed::*outputs) {
    Ensemble& own = computed.*outputs;
    if (like)
      for (Index k = 0; k < data.steps(); ++k)
        own.output(k) += 0.0 * (like->*outputs).output(k);  // NaN where `like` is NaN
    if (counted.empty()) return 0.0;
    Vector left = 1 - fit(data, own, none).fit(counted).array() / 100;
    left = left.array().isFinite().select(left, 1e12).eval();
    const Vector logs = left.array().max(std::max(1e-12, least_counted * left.maxCoeff())).log();
    return weights.size() == 0 ? logs.mean() : logs.dot(of_output(counted)) / of_output(counted).sum();
  };
  return {score(&Computed::one_step), std::min(score(&Computed::ahead), 0.0),
          std::min(score(&Computed::simulation), 0.0)};
}

namespace {

// Squared error of the outputs that a regression simulates from the inputs and from the outputs before step `first`,
// over the squared outputs: weighted mean of the logs of the outputs that count. Missing samples count as zero.
double simulation_error(const GtvArx& arx, const Ensemble& measured, Index first, const Vector& weights) {
  const Index m = measured.outputs(), d = measured.channels();
  Ensemble e = measured;
  e.samples() = measured.samples().array().isNaN().select(0.0, measured.samples());
  Vector errors = Vector::Zero(m), sizes = errors;
  for (Index k = first; k < e.steps(); ++k) {
    const Index from = (k - arx.step[size_t(k)].lags) * d;
    const Matrix computed = e.samples().middleCols(from, arx.regressors(k)) * arx.coefficients(k).transpose();
    const Eigen::ArrayXXd y = measured.output(k), error = y - computed.array();
    e.output(k) = computed;
    errors += error.isNaN().select(0.0, error.square()).colwise().sum().matrix().transpose();
    sizes += error.isNaN().select(0.0, y.square()).colwise().sum().matrix().transpose();
  }
  const Eigen::ArrayXd counted = (sizes.array() > 0).select(weights.array(), 0.0);
  if (!(counted.sum() > 0)) return std::numeric_limits<double>::infinity();
  const Eigen::ArrayXd relative = (counted > 0).select(errors.array() / sizes.array(), 0.0);
  return (counted * relative.max(1e-24).min(1e24).log()).sum() / counted.sum();
}

}  // namespace

Index Folds::refined_folds(Index experiments) {
  constexpr Index fewest = 3, held_out = 20;
  const Index folds = fold_count(experiments), needed = (held_out * folds + experiments - 1) / experiments;
  return std::clamp(needed, std::min(fewest, folds), folds);
}

Folds::Folds(const Ensemble& ensemble, const Options& options)
    : options_(options), experiments_(ensemble.experiments()) {
  const Index count = fold_count(ensemble.experiments());
  first_ = first_scored(options.initial_state, options.lags, options.variation.period);
  SmoothArxOptions arx_options;
  arx_options.lags = options.lags;
  arx_options.initial_state = options.initial_state;
  arx_options.feedthrough = options.feedthrough;
  arx_options.variation = options.variation;
  folds_.resize(size_t(count));
  options_.execution.progress = {};
  parallel_for(0, count, options.execution, [&](Index begin, Index end) {
    for (Index f = begin; f < end; ++f) {
      Fold& own = folds_[size_t(f)];
      own.data = fold(ensemble, f, count, options.centred);
      own.arx = smooth_arx(own.data.training, arx_options);
    }
  });
  factorise(0);
  double error = 0.0;
  for (const Fold& own : folds_)
    error += simulation_error(own.arx, own.data.held_out, std::max(own.arx.k_begin, first_),
                              weights_of(options.output_weights, own.arx.outputs));
  simulates_ = !(error > 0.0);
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

std::optional<std::vector<Errors>> Folds::errors_of_folds(size_t count, Index states,
                                                          const std::function<Model(size_t)>& make, Index first,
                                                          const Execution& execution,
                                                          const std::vector<Computed>& like) const {
  std::vector<Errors> found(count);
  std::vector<char> complete(count, 0);
  parallel_for(0, Index(count), execution, [&](Index begin, Index end) {
    for (Index f = begin; f < end; ++f) {
      Model model = make(size_t(f));
      if (model.steps() == 0 || model.states() != states) continue;
      const Ensemble& held_out = folds_[size_t(f)].data.held_out;
      found[size_t(f)] = errors_of(computed_by(std::move(model), held_out, options_.initial_state, first), held_out,
                                   options_.output_weights, size_t(f) < like.size() ? &like[size_t(f)] : nullptr);
      if (!simulates_) found[size_t(f)].simulation = 0.0;
      complete[size_t(f)] = 1;
    }
  });
  if (std::find(complete.begin(), complete.end(), 0) != complete.end()) return std::nullopt;
  return found;
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

std::vector<Model> Folds::models_of(const OrderScores& scores) const {
  std::vector<Model> models;
  for (size_t f = 0; f < size_t(refined_folds(experiments_)); ++f)
    models.push_back(start(f, scores.best, scores.weighting, scores.smoothing));
  return models;
}

std::vector<Squares> Folds::squares(const std::vector<Model>& models, const Ahead& ahead) const {
  std::vector<Squares> result(models.size());
  parallel_for(0, Index(models.size()), {options_.execution.threads, {}}, [&](Index begin, Index end) {
    for (Index f = begin; f < end; ++f) {
      const Ensemble& held_out = folds_[size_t(f)].data.held_out;
      Squares& own = result[size_t(f)] =
          Squares(held_out.experiments(), Index(ahead.horizons.size()) * held_out.outputs());
      const Model model = of_departures(models[size_t(f)], held_out);
      for (size_t i = 0; i < ahead.horizons.size(); ++i) {
        const Index h = ahead.horizons[i];
        const Ensemble y = predict(model, held_out, {h, options_.initial_state}).y;
        for (Index s = ahead.from; s + h <= held_out.steps(); ++s)
          if (i == 0 || ahead.all_begin(s, held_out.steps()))
            own.add(Index(i), y.output(s + h - 1), held_out, s + h - 1);
      }
    }
  });
  return result;
}

// Tries increasing orders, with larger steps between larger ones, until two in succession are worse than the best one.
// Then orders between its neighbours follow, in halves, and those below it down to the fewest states that suffice.
OrderScores Folds::scores(Weighting weighting, double smoothing, Index least, Index most,
                          const Execution& execution) const {
  std::map<Index, std::vector<Errors>> found;
  const auto error = [&](Index n) {
    if (!found.contains(n))
      if (auto errors = errors_of_folds(
              folds_.size(), n, [&](size_t f) { return start(f, n, weighting, smoothing); }, first_, execution))
        found.emplace(n, std::move(*errors));
    return found.contains(n) ? mean_of(found.at(n)).mean() : std::numeric_limits<double>::infinity();
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
    for (const auto& [n, folds] : found) {
      const Errors errors = mean_of(folds);
      result.add(n, errors.one_step, errors.ahead, errors.simulation);
      result.uncertainty.push_back(standard_error(folds, found.at(best)));
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
