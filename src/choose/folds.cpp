// SPDX-License-Identifier: BSD-3-Clause
#include "choose/folds.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <span>
#include <utility>

#include "tokid/em.hpp"
#include "tokid/plan.hpp"
#include "tokid/validate.hpp"

namespace tokid {

namespace {

// Number of orders that are tried after the best order so far.
constexpr Index patience = 4;
// A larger order must raise the likelihood by `significant` standard errors, and a smaller order may reduce it by
// `noticeable` ones. The search for λ goes on while the likelihood rises by more than `noticeable` ones.
constexpr double significant = 2.0, noticeable = 1.0;
// Most folds that validate EM. EM takes longer than all other choices.
constexpr size_t most_refined = 3;
// EM runs in stages. Each has a number of iterations, after those of its warm-up, and ends with an evaluation. For few
// experiments, few iterations are often the best. If steps share their matrices, EM needs more iterations, but an
// iteration takes less time. If matrices jump, EM first follows them without jumps. It then goes on with them, and
// without a warm-up, so that a comparison of jumps starts from the same models.
struct Stage {
  Index iterations = 0;
  bool jumps = false;
};
constexpr Stage pooled_stages[] = {{10}, {30}, {100}}, first_stages[] = {{3}, {5}, {40}}, last_stage[] = {{120}},
                jump_stages[] = {{48, true}}, last_jump_stage[] = {{120, true}};
// For every λ the stages `first`, then with jumps also `jumping`. Only for the best λ the stages `last`.
struct Schedule {
  std::span<const Stage> first, jumping, last;
};
Schedule schedule_of(const RefineOptions& o) {
  if (o.period.value_or(0) > 0) return {pooled_stages, {}, {}};
  if (!o.jumps.empty()) return {first_stages, jump_stages, last_jump_stage};
  return {first_stages, {}, last_stage};
}
Model refined_in(const Stage& stage, const Model& start, const Ensemble& data, RefineOptions o) {
  o.iterations = stage.iterations;
  o.warm_up = !stage.jumps;
  if (!stage.jumps) o.jumps.clear();
  return refine(start, data, o).model;
}
// A usual λ of EM, bounds of its first λ, and the largest λ. With a larger one EM does not converge in these stages.
constexpr double usual = 3.0, first_least = 1e-2, first_most = 1e2, largest = 320.0;
// The most half decades that a search goes in one direction.
constexpr Index most_moves = 6;
// A jump is tried where its gain exceeds the gains two steps before and after by the factor `sharp`, and the median
// gain by another factor. Gains vary slowly over time if the matrices do.
constexpr double sharp = 1.25, above_median = 2.0;
constexpr size_t most_jumps = 8;
// A larger order must reduce the error of subspace models by the factor `worth_it`. If the errors are uncertain, the
// required factor is higher, but at most `most_uncertain`.
constexpr double worth_it = 1.005, most_uncertain = 1.02;

Errors mean_of(const std::vector<Errors>& folds) {
  Errors mean;
  for (const Errors& e : folds) {
    mean.one_step += e.one_step / double(folds.size());
    mean.ahead += e.ahead / double(folds.size());
    mean.simulation += e.simulation / double(folds.size());
  }
  return mean;
}

// Standard error of the difference of two models that were validated on the same folds.
double standard_error(const std::vector<Errors>& a, const std::vector<Errors>& b) {
  const double count = double(a.size()), mean = mean_of(a).mean() - mean_of(b).mean();
  double square = 0.0;
  for (size_t f = 0; f < a.size(); ++f) square += std::pow(a[f].mean() - b[f].mean() - mean, 2);
  return count > 1 ? std::sqrt(square / (count * (count - 1))) : 0.0;
}

}  // namespace

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

Computed computed_by(Model model, const Ensemble& data, InitialState initial, Index first) {
  model.y_nominal = Matrix::Zero(data.steps(), data.outputs());
  model.u_nominal = Matrix::Zero(data.steps(), data.inputs());
  const Index horizon = std::min(OrderScores::horizon, std::max<Index>(1, data.steps() - 1));
  Computed result{predict(model, data, {1, initial}).y, predict(model, data, {horizon, initial}).y,
                  simulate_data(model, data, initial)};
  for (Ensemble* outputs : {&result.one_step, &result.ahead, &result.simulation})
    for (Index k = 0; k < std::min(first, data.steps()); ++k)
      outputs->output(k).setConstant(std::numeric_limits<double>::quiet_NaN());
  return result;
}

// Smaller relative errors of an output are raised to this share of the largest relative error. Otherwise the logarithm
// of an exact output, such as a recorded command, would outweigh the errors of all other outputs.
constexpr double least_counted = 1e-3;

Errors errors_of(Computed computed, const Ensemble& data, const Computed* like) {
  const Matrix none =
      Matrix::Zero(data.steps(), data.outputs());  // `data` are departures, so errors are relative to zero
  // Outputs that are always zero do not count.
  std::vector<Index> moving;
  for (Index j = 0; j < data.outputs(); ++j)
    for (Index k = 0; k < data.steps(); ++k)
      if ((data.output(k).col(j).array().abs() > 0).any()) {  // neither zero nor NaN
        moving.push_back(j);
        break;
      }
  const auto score = [&](Ensemble Computed::*outputs) {
    Ensemble& own = computed.*outputs;
    if (like)
      for (Index k = 0; k < data.steps(); ++k)
        own.output(k) += 0.0 * (like->*outputs).output(k);  // NaN where `like` is NaN
    if (moving.empty()) return 0.0;
    Vector left = 1 - fit(data, own, none).fit(moving).array() / 100;
    left = left.array().isFinite().select(left, 1e12).eval();
    return left.array().max(std::max(1e-12, least_counted * left.maxCoeff())).log().mean();
  };
  return {score(&Computed::one_step), std::min(score(&Computed::ahead), 0.0),
          std::min(score(&Computed::simulation), 0.0)};
}

Index first_scored(InitialState initial, Index lags, Index period) {
  return initial == InitialState::zero ? 0 : period > 0 ? lags : 2 * lags;
}

Folds::Folds(const Ensemble& ensemble, const Options& options) : options_(options) {
  const Index count = fold_count(ensemble.experiments());
  first_ = first_scored(options.initial_state, options.lags, options.variation.period);
  SmoothArxOptions arx_options;
  arx_options.lags = options.lags;
  arx_options.initial_state = options.initial_state;
  arx_options.feedthrough = options.feedthrough;
  arx_options.variation = options.variation;
  folds_.resize(size_t(count));
  parallel_for(0, count, {options.threads, {}}, [&](Index begin, Index end) {
    SubspaceOptions o;
    o.variation = options.variation;
    for (Index f = begin; f < end; ++f) {
      Fold& own = folds_[size_t(f)];
      own.data = fold(ensemble, f, count, options.centred);
      own.arx = smooth_arx(own.data.training, arx_options);
      for (const Weighting weighting : options.weightings) {
        o.weighting = weighting;
        own.factors[weighting] = predictor_factors(own.data.training, own.arx, o);
      }
    }
  });
}

template <class MakeModel>
std::optional<std::vector<Errors>> Folds::errors_of_folds(size_t count, Index states, MakeModel&& make, Index first,
                                                          const std::vector<Computed>& like) const {
  std::vector<Errors> found(count);
  std::vector<char> complete(count, 0);
  parallel_for(0, Index(count), {options_.threads, {}}, [&](Index begin, Index end) {
    for (Index f = begin; f < end; ++f) {
      Model model = make(size_t(f));
      if (model.steps() == 0 || model.states() != states) continue;
      const Ensemble& held_out = folds_[size_t(f)].data.held_out;
      found[size_t(f)] = errors_of(computed_by(std::move(model), held_out, options_.initial_state, first), held_out,
                                   size_t(f) < like.size() ? &like[size_t(f)] : nullptr);
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
  o.state_smoothing = smoothing;
  const Fold& own = folds_[f];
  return from_known_state(realise(own.data.training, own.arx, own.factors.at(weighting), o), options_.initial_state);
}

// Tries increasing orders. Stops when `patience` orders after the best order had no smaller error.
OrderScores Folds::scores(Weighting weighting, double smoothing, Index least, Index most) const {
  OrderScores result;
  result.smoothing = smoothing;
  result.weighting = weighting;
  result.cross_validated = true;
  size_t best = 0;
  std::vector<std::vector<Errors>> of_order;
  for (Index n = least; n <= most && n <= least + Index(best) + patience; ++n) {
    const auto found = errors_of_folds(
        folds_.size(), n, [&](size_t f) { return start(f, n, weighting, smoothing); }, first_);
    if (!found) break;
    of_order.push_back(*found);
    const Errors errors = mean_of(*found);
    result.add(n, errors.one_step, errors.ahead, errors.simulation);
    if (errors.mean() <= result.smallest) best = of_order.size() - 1;
  }
  for (const auto& found : of_order) result.uncertainty.push_back(standard_error(found, of_order[best]));
  result.choose();
  return result;
}

OrderScores Folds::choose_states(std::optional<Index> states, Index most) const {
  const auto among = [&](Weighting weighting, double smoothing, Index least, Index largest) {
    return scores(weighting, smoothing, states.value_or(least), states.value_or(largest));
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

// Log-likelihoods of the held-out experiments of all folds.
class Folds::Likelihood {
 public:
  Likelihood() = default;
  explicit Likelihood(const std::vector<Vector>& folds) {
    for (const Vector& fold : folds) of_experiment_.insert(of_experiment_.end(), fold.begin(), fold.end());
  }

  // -∞ if there is none, or not a finite one.
  double sum() const {
    const double all = std::accumulate(of_experiment_.begin(), of_experiment_.end(), 0.0);
    return of_experiment_.empty() || !std::isfinite(all) ? -std::numeric_limits<double>::infinity() : all;
  }
  double mean() const { return sum() / std::max(1.0, double(of_experiment_.size())); }
  // The difference of the sums, in units of its standard error over the experiments. ±∞ if one sum is not finite.
  double advantage(const Likelihood& other) const {
    if (!std::isfinite(sum())) return -std::numeric_limits<double>::infinity();
    if (!std::isfinite(other.sum())) return std::numeric_limits<double>::infinity();
    const double count = double(of_experiment_.size()), difference = sum() - other.sum();
    double square = 0.0;
    for (size_t i = 0; i < of_experiment_.size(); ++i)
      square += std::pow(of_experiment_[i] - other.of_experiment_[i] - difference / count, 2);
    return difference / std::sqrt(std::max(square * count / std::max(1.0, count - 1), 1e-300));
  }

 private:
  std::vector<double> of_experiment_;
};

namespace {

// The least variance of each output's noise that counts in a likelihood, from one-step predictions. Otherwise an output
// that is exact, or exact up to a few digits, would decide alone.
Vector least_variance(const Computed& start, const Ensemble& data) {
  Vector error = Vector::Zero(data.outputs()), size = error;
  for (Index k = 0; k < data.steps(); ++k)
    for (Index j = 0; j < data.outputs(); ++j) {
      const Eigen::ArrayXd y = data.output(k).col(j), e = y - start.one_step.output(k).col(j).array();
      error(j) += e.isFinite().select(e.square(), 0.0).sum();
      size(j) += e.isFinite().select(y.square(), 0.0).sum() / double(data.steps() * data.experiments());
    }
  const Vector relative = (size.array() > 0).select(error.array() / size.array(), 0.0);
  return least_counted * least_counted * relative.maxCoeff() / double(data.steps() * data.experiments()) * size;
}

// Log-likelihoods of the experiments if the outputs had additional noise with these variances.
Vector log_likelihoods_with(const Vector& variances, Model model, const Ensemble& data) {
  for (Step& step : model.step) step.set_R(step.R() + Matrix(variances.asDiagonal()));
  return log_likelihoods(model, data);
}

}  // namespace

// The cross-validation of EM for one number of states.
class Folds::RefinementSearch {
 public:
  RefinementSearch(const Folds& folds, Index states, const OrderScores& scores, std::vector<Jump> jumps)
      : folds_(folds),
        jumps_(std::move(jumps)),
        count_(std::min(folds.folds_.size(), most_refined)),
        starts_(count_),
        like_(count_),
        least_variance_(count_) {
    choice_.states = states;
    for_each_fold([&](size_t f) {
      starts_[f] = folds_.start(f, states, scores.weighting, scores.smoothing);
      // EM can predict samples after missing samples that subspace models cannot predict. These samples are not
      // compared.
      like_[f] = computed_by(starts_[f], folds_.folds_[f].data.held_out, folds_.options_.initial_state, folds_.first_);
      least_variance_[f] = least_variance(like_[f], folds_.folds_[f].data.held_out);
    });
    choice_.error = errors(starts_, folds.first_).mean();
    choice_.trials.push_back({.states = states, .error = choice_.error});
  }

  // Tries λ, or only the given one. The last stage follows only for the best λ.
  void run(std::optional<double> smoothing_given, bool look_for_jumps) {
    if (folds_.options_.variation.period == 1) smoothing_given = 0.0;
    if (smoothing_given)
      attempt(*smoothing_given);
    else
      choose_smoothing();
    if (!smoothing_given && !empty() && least_error()->error > choice_.error) approach_start();
    if (look_for_jumps && !empty() && !folds_.pooled()) find_jumps();
    continue_best();
  }

  bool empty() const { return attempts_.empty(); }
  // Of the best λ.
  const Likelihood& likelihood() const { return chosen()->likelihood; }
  double smoothing() const { return chosen()->smoothing; }
  double error() const { return chosen()->error; }
  const std::vector<Jump>& jumps() const { return jumps_; }
  const std::vector<RefinementTrial>& trials() const { return choice_.trials; }

  // EM is used if it predicts the samples that subspace models predict, too, clearly better than they do. With unknown
  // initial states, models of EM begin earlier, and may be a little worse at the later steps. If the best attempt is
  // not used, the attempt with the smallest errors may be.
  RefinementChoice choice() && {
    if (empty()) return std::move(choice_);
    choice_.smoothing = smoothing();
    choice_.jumps = jumps_;
    const bool begins_earlier = folds_.first_ > 0 && !folds_.pooled();
    const double limit = choice_.error + std::log(begins_earlier ? most_uncertain : 1 / worth_it);
    for (const Attempt* attempt : {chosen(), least_error()}) {
      const Errors common = errors(attempt->models, folds_.first_, like_);
      if (common.mean() > limit) continue;
      choice_.smoothing = attempt->smoothing;
      choice_.iterations = attempt->iterations;
      choice_.one_step = common.one_step;
      choice_.error = attempt->error;
      break;
    }
    return std::move(choice_);
  }

 private:
  // EM that did not fail.
  struct Attempt {
    double smoothing = 0.0;
    Index iterations = 0;
    double error = 0.0;
    Likelihood likelihood;
    std::vector<Model> models;
  };

  const Attempt* least_error() const {
    const auto smaller = [](const Attempt& a, const Attempt& b) { return a.error < b.error; };
    return &*std::min_element(attempts_.begin(), attempts_.end(), smaller);
  }

  const Attempt* likeliest() const {
    const auto less = [](const Attempt& a, const Attempt& b) { return a.likelihood.sum() < b.likelihood.sum(); };
    return &*std::max_element(attempts_.begin(), attempts_.end(), less);
  }

  // The attempt with the smallest errors of those whose likelihood does not differ significantly from the largest. With
  // few experiments, or noise that is not normal, the likelihood alone would decide too finely. If steps share their
  // matrices, there may be very few experiments. Their initial states would decide the likelihood, so the errors
  // decide.
  const Attempt* chosen() const {
    if (folds_.pooled()) return least_error();
    const Attempt *const most = likeliest(), *best = most;
    for (const Attempt& a : attempts_)
      if (a.error < best->error && most->likelihood.advantage(a.likelihood) < significant) best = &a;
    return best;
  }

  template <class Change>
  void for_each_fold(Change&& change) {
    parallel_for(0, Index(count_), {folds_.options_.threads, {}}, [&](Index begin, Index end) {
      for (Index f = begin; f < end; ++f) change(size_t(f));
    });
  }

  void choose_smoothing() {
    double best = std::clamp(folds_.options_.variation.smoothing, first_least, first_most);
    Likelihood most = attempt(best);
    // The λ of the ARX model may be far from the best λ of EM. The likelihood may then have a second maximum.
    if (std::abs(std::log10(best / usual)) > 0.9) try_smoothing(usual, noticeable, best, most);
    climb(best, most);
  }

  // With one more jump, the best λ may be larger by decades.
  void choose_larger_smoothing(double best) {
    const double before = best;
    Likelihood most = attempt(before);
    for (const double factor : {10.0, 100.0})
      if (before * factor < largest) try_smoothing(before * factor, 0.0, best, most);
    climb(best, most);
  }

  // Makes this λ the best one if it raises the likelihood by more than this number of standard errors.
  bool try_smoothing(double smoothing, double advantage, double& best, Likelihood& most) {
    Likelihood found = attempt(smoothing);
    if (!(found.advantage(most) > advantage)) return false;
    most = std::move(found);
    best = smoothing;
    return true;
  }

  void climb(double best, Likelihood most) {
    for (const double factor : {std::sqrt(10.0), std::sqrt(0.1)}) {
      Index moves = 0;
      while (moves < most_moves && best * factor < largest && try_smoothing(best * factor, noticeable, best, most))
        ++moves;
      if (moves > 0) break;
    }
  }

  // If no attempt predicts better than the subspace models, attempts with less penalty may: they stay closer to them.
  void approach_start() {
    const auto weaker = [](const Attempt& a, const Attempt& b) { return a.smoothing < b.smoothing; };
    double smoothing = std::min_element(attempts_.begin(), attempts_.end(), weaker)->smoothing;
    for (Index moves = 0; moves < most_moves; ++moves) {
      const double least = least_error()->error;
      attempt(smoothing *= std::sqrt(0.1));
      if (!(least_error()->error < least)) return;
    }
  }

  // Adds jumps one by one where the gains of a jump are sharp. Each must raise the likelihood significantly, with the λ
  // that is then the best, and moves to the step of the largest likelihood. At last, jumps that are not needed are
  // removed: one that is a few steps away from the true one may have been found before it.
  void find_jumps() {
    while (jumps_.size() < most_jumps && add_jump()) continue;
    for (size_t i = jumps_.size(); jumps_.size() > 1 && i-- > 0;) {
      const double advantage = take_at_same_smoothing(without_jump(i), -significant);
      if (!(advantage > -significant)) jumps_[i].loss = -advantage;
    }
  }

  bool add_jump() {
    const std::vector<Index> candidates = sharp_steps();
    if (candidates.empty()) return false;
    const double smoothing = chosen()->smoothing;
    // A jump is compared with as many iterations without it.
    Likelihood before = likeliest()->likelihood;
    if (jumps_.empty()) {
      Likelihood longer = refined(*chosen(), jump_stages[0]).likelihood;
      if (longer.sum() > before.sum()) before = std::move(longer);
    }
    const auto search = [&] { choose_larger_smoothing(smoothing); };
    for (Index step : candidates)
      if (take_jumps(with_jump(jumps_, step), before, significant, search) > significant) {
        step = moved_jump(step);
        const auto same = [&](const Jump& jump) { return jump.step == step; };
        std::find_if(jumps_.begin(), jumps_.end(), same)->loss = likeliest()->likelihood.advantage(before);
        return true;
      }
    return false;
  }

  // Moves the jump at this step, while the likelihood rises. Returns its last step.
  Index moved_jump(Index step) {
    const auto at = [&](Index k) {
      return std::any_of(jumps_.begin(), jumps_.end(), [&](const Jump& jump) { return jump.step == k; });
    };
    const auto moves = [&](Index to) {
      if (to < 1 || to >= steps() || at(to)) return false;
      std::vector<Jump> jumps = jumps_;
      std::erase_if(jumps, [&](const Jump& jump) { return jump.step == step; });
      return take_at_same_smoothing(with_jump(std::move(jumps), to), 0.0) > 0.0;
    };
    for (const Index by : {-1, 1}) {
      const Index first = step;
      while (moves(step + by)) step += by;
      if (step != first) break;
    }
    return step;
  }

  static std::vector<Jump> with_jump(std::vector<Jump> jumps, Index step) {
    const auto later = [&](const Jump& jump) { return jump.step > step; };
    jumps.insert(std::find_if(jumps.begin(), jumps.end(), later), Jump{step});
    return jumps;
  }

  std::vector<Jump> without_jump(size_t i) const {
    std::vector<Jump> jumps = jumps_;
    jumps.erase(jumps.begin() + std::ptrdiff_t(i));
    return jumps;
  }

  double take_at_same_smoothing(std::vector<Jump> jumps, double advantage) {
    const Attempt before = *likeliest();
    return take_jumps(std::move(jumps), before.likelihood, advantage, [&] { attempt(before.smoothing); });
  }

  // Searches with other jumps. Keeps them if the likelihood of the best attempt then exceeds `before` by more than
  // `least` standard errors. Returns by how many it does.
  template <class Search>
  double take_jumps(std::vector<Jump> jumps, const Likelihood& before, double least, Search&& search) {
    std::vector<Attempt> attempts = std::exchange(attempts_, {});
    std::swap(jumps, jumps_);
    search();
    const double advantage = (empty() ? Likelihood() : likeliest()->likelihood).advantage(before);
    if (advantage > least) return advantage;
    std::swap(jumps, jumps_);
    attempts_ = std::move(attempts);
    return advantage;
  }

  Index steps() const { return folds_.folds_.front().data.training.steps(); }

  // The steps at which the gain of a jump is the sharpest, for each λ that was tried from the chosen one on, the
  // largest λ first. A model that varies more freely follows a jump by itself, so that its gains are smaller and less
  // sharp.
  std::vector<Index> sharp_steps() {
    std::map<double, const Attempt*, std::greater<>> last;  // for each λ, the attempt with the most iterations
    const double least = chosen()->smoothing;
    for (const Attempt& a : attempts_)
      if (a.smoothing >= least && a.smoothing > 0) last[a.smoothing] = &a;
    std::vector<Index> steps;
    for (const auto& [smoothing, attempt] : last) {
      const std::optional<Index> step = sharpest(jump_gains_of(*attempt));
      if (step && std::find(steps.begin(), steps.end(), *step) == steps.end()) steps.push_back(*step);
    }
    return steps;
  }

  // (T) Summed over the folds.
  Vector jump_gains_of(const Attempt& attempt) {
    std::vector<Vector> gains(count_);
    for_each_fold([&](size_t f) {
      gains[f] = jump_gains(attempt.models[f], folds_.folds_[f].data.training, options(attempt.smoothing));
    });
    return std::accumulate(gains.begin() + 1, gains.end(), gains.front());
  }

  static std::optional<Index> sharpest(const Vector& gains) {
    constexpr Index aside = 2;
    std::vector<double> sorted(gains.begin(), gains.end());
    const auto middle = sorted.begin() + std::ptrdiff_t(sorted.size() / 2);
    std::nth_element(sorted.begin(), middle, sorted.end());
    std::optional<Index> best;
    double most = 0.0;
    for (Index k = aside + 1; k + aside < gains.size(); ++k) {
      const double excess = gains(k) - sharp * std::max(gains(k - aside), gains(k + aside));
      if (gains(k) > above_median * *middle && excess > most) most = excess, best = k;
    }
    return best;
  }

  // The further stages, if EM has not been best before.
  void continue_best() {
    if (empty()) return;
    Attempt now = *chosen();
    const Schedule schedule = schedule_of(options(now.smoothing));
    const auto total = [](Index sum, const Stage& stage) { return sum + stage.iterations; };
    if (now.iterations < std::accumulate(schedule.first.begin(), schedule.first.end(), Index{0}, total)) return;
    for (const Stage& stage : schedule.last) {
      now = refined(std::move(now), stage);
      keep(now);
    }
  }

  // EM with this λ, from subspace models. Returns the largest log-likelihood of the held-out experiments.
  Likelihood attempt(double smoothing) {
    const auto schedule = schedule_of(options(smoothing));
    Likelihood most;
    const auto compare = [&](const Attempt& now) {
      if (now.likelihood.sum() > most.sum()) most = now.likelihood;
      keep(now);
    };
    auto plain = plain_.find(smoothing);
    if (plain == plain_.end()) {
      Attempt now{smoothing, 0, 0.0, {}, starts_};
      for (const Stage& stage : schedule.first) {
        now = refined(std::move(now), stage);
        if (jumps_.empty()) compare(now);
      }
      plain = plain_.emplace(smoothing, std::move(now)).first;
    }
    for (const Stage& stage : schedule.jumping) compare(refined(plain->second, stage));
    return most;
  }

  void keep(const Attempt& attempt) {
    if (std::isfinite(attempt.likelihood.sum())) attempts_.push_back(attempt);
  }

  Attempt refined(Attempt start, const Stage& stage) {
    std::vector<Vector> found(count_);
    for_each_fold([&](size_t f) {
      const Split& data = folds_.folds_[f].data;
      start.models[f] = refined_fold(start.smoothing, stage, data.training, start.models[f]);
      if (start.models[f].steps() > 0)
        found[f] = log_likelihoods_with(least_variance_[f], start.models[f], data.held_out);
    });
    const bool all = std::all_of(found.begin(), found.end(), [](const Vector& fold) { return fold.size() > 0; });
    start.likelihood = all ? Likelihood(found) : Likelihood();
    start.error = (folds_.pooled() ? errors(start.models, folds_.first_, like_) : errors(start.models, 0)).mean();
    start.iterations += stage.iterations;
    choice_.trials.push_back({choice_.states, start.smoothing, start.iterations, start.error, start.likelihood.mean(),
                              stage.jumps ? options(start.smoothing).jumps : std::vector<Index>{}});
    return start;
  }

  RefineOptions options(double smoothing) const {
    RefineOptions o;
    o.smoothing = smoothing;
    o.period = folds_.options_.variation.period;
    o.initial_state = folds_.options_.initial_state;
    o.feedthrough = folds_.options_.feedthrough;
    for (const Jump& jump : jumps_) o.jumps.push_back(jump.step);
    return o;
  }

  // Empty if EM fails: this λ is ruled out.
  Model refined_fold(double smoothing, const Stage& stage, const Ensemble& training, const Model& start) const {
    if (start.steps() == 0) return start;
    try {
      return refined_in(stage, start, training, options(smoothing));
    } catch (const std::runtime_error&) {
      return {};
    }
  }

  Errors errors(const std::vector<Model>& models, Index first, const std::vector<Computed>& like = {}) const {
    const auto found = folds_.errors_of_folds(
        count_, choice_.states, [&](size_t f) { return models[f]; }, first, like);
    constexpr double none = std::numeric_limits<double>::infinity();
    return found ? mean_of(*found) : Errors{none, none, none};
  }

  const Folds& folds_;
  std::vector<Jump> jumps_;  // of all attempts
  size_t count_;
  std::vector<Model> starts_;  // subspace models
  std::vector<Computed> like_;
  std::vector<Vector> least_variance_;  // as in least_variance, of each fold
  std::vector<Attempt> attempts_;
  std::map<double, Attempt> plain_;  // for each λ, the attempt after the stages without jumps
  RefinementChoice choice_;
};

RefinementChoice Folds::choose_refinement(Index states, const OrderRange& orders, const OrderScores& scores,
                                          const StatedRefinement& stated) const {
  std::vector<Jump> stated_jumps;
  for (const Index step : stated.jumps.value_or(std::vector<Index>{})) stated_jumps.push_back({step});
  auto best = std::make_unique<RefinementSearch>(*this, states, scores, stated_jumps);
  best->run(stated.smoothing, !stated.jumps);
  std::vector<RefinementTrial> trials = best->trials();
  // Takes the other number of states if its likelihood has this advantage, in standard errors, and its error is below
  // the present one times `allowed`.
  const auto take_if = [&](std::unique_ptr<RefinementSearch> other, double advantage, double allowed) {
    trials.insert(trials.end(), other->trials().begin(), other->trials().end());
    if (other->empty() || !(other->error() < best->error() + std::log(allowed))) return false;
    if (!pooled() && !(other->likelihood().advantage(best->likelihood()) > advantage)) return false;
    best = std::move(other);
    return true;
  };
  const auto try_order = [&](Index n, double advantage, double allowed) {
    auto other = std::make_unique<RefinementSearch>(*this, n, scores, best->jumps());
    other->run(best->smoothing(), false);
    return take_if(std::move(other), advantage, allowed);
  };
  const double larger = pooled() ? 1 / most_uncertain : 1.0;
  Index n = states;
  while (!best->empty() && n < orders.most && try_order(n + 1, significant, larger)) ++n;
  if (n == states)
    while (!best->empty() && n > orders.fewest && try_order(n - 1, -noticeable, worth_it)) --n;
  if (n != states && !stated.smoothing) {  // the best λ may differ for this number of states
    auto again = std::make_unique<RefinementSearch>(*this, n, scores, best->jumps());
    again->run({}, !stated.jumps && best->jumps().empty());
    take_if(std::move(again), -noticeable, 1.0);
  }
  RefinementChoice choice = std::move(*best).choice();
  choice.trials = std::move(trials);
  return choice;
}

Model refined(Model model, const Ensemble& data, Index iterations, const RefineOptions& options) {
  const Schedule schedule = schedule_of(options);
  Index done = 0;
  for (const auto& stages : {schedule.first, schedule.jumping, schedule.last})
    for (const Stage& stage : stages) {
      if (done >= iterations) return model;
      model = refined_in(stage, model, data, options);
      done += stage.iterations;
    }
  return model;
}

}  // namespace tokid
