// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>

#include "base/words.hpp"
#include "choose/ahead_errors.hpp"
#include "choose/first_steps.hpp"
#include "choose/folds.hpp"
#include "noise/em.hpp"
#include "tokid/em.hpp"

namespace tokid {

namespace {

// An attempt may have smaller errors than the likeliest one if its likelihood is lower by less than `significant`
// standard errors. The search for λ goes on while the likelihood rises by more than `noticeable` ones. Fewer states may
// lower it by less than that.
constexpr double significant = 2.0, noticeable = 1.0;
const double half_decade = std::sqrt(10.0);
// A usual λ of EM, bounds of the first λ of a search, and the largest λ. With a larger one EM does not converge in
// these stages.
constexpr double usual = 3.0, first_least = 1e-2, first_most = 1e2, largest = 320.0;
// The most half decades that a search goes in one direction.
constexpr Index most_moves = 6;
// Attempts whose errors are larger by this factor are given up.
constexpr double hopeless = 2.0;
// The search comes to a λ on several ways, with different rounding errors.
bool same_smoothing(double a, double b) { return std::abs(a - b) <= 1e-6 * std::max(a, b); }

// EM runs in stages, which double its iterations. Each ends with an evaluation.
struct Stage {
  Index iterations = 0;
  bool warm_up = false;
};
constexpr Index first_iterations = 3, warmed_up = 48;

// The stage that follows so many iterations. Models whose steps share their matrices have few coefficients, so EM with
// few iterations is not better than EM with many.
Stage stage_after(Index done, bool shared) {
  return {std::max(shared ? warmed_up : first_iterations, done), done < warmed_up};
}

// All attempts have the stages up to here. If steps do not share their matrices, the best attempts then go on. If steps
// share their matrices, EM needs many iterations, but an iteration takes less time. With a jump, a large λ shows only
// after more iterations that it is the best.
Index first_end(const RefineOptions& o) {
  return o.period.value_or(0) > 0 ? 4 * warmed_up : o.jumps.empty() ? warmed_up : 2 * warmed_up;
}

Refinement refined_in(const Stage& stage, const Model& start, const Ensemble& data, std::optional<em::Data>& samples,
                      RefineOptions o) {
  o.iterations = stage.iterations;
  o.warm_up = stage.warm_up;
  return em::refine(start, data, samples, o);
}

}  // namespace

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

  bool surely_below(const Likelihood& other) const {
    return advantage(other) < -errors_to_give_up(Index(of_experiment_.size()));
  }

 private:
  std::vector<double> of_experiment_;
};

namespace {

// The least variance of each output's noise that counts in a likelihood, from one-step predictions. Otherwise an output
// that is exact, or exact up to a few digits, would decide alone.
Vector least_variance(const Matrix& predicted, const Ensemble& data) {
  Vector error = Vector::Zero(data.outputs()), size = error;
  for (Index k = 0; k < data.steps(); ++k)
    for (Index j = 0; j < data.outputs(); ++j) {
      const Eigen::ArrayXd y = data.output(k).col(j), e = y - predicted.col(k * data.outputs() + j).array();
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

// The cross-validation of EM with one number of states.
class Folds::RefinementSearch {
 public:
  // `trials`: of all searches, to which this one adds its own.
  RefinementSearch(const Folds& folds, Index states, const OrderScores& scores, std::vector<Index> jumps,
                   SearchProgress& work, std::vector<RefinementTrial>& trials)
      : folds_(folds),
        work_(work),
        trials_(trials),
        jumps_(std::move(jumps)),
        count_(size_t(refined_folds(folds.experiments_))),
        starts_(count_),
        without_em_(count_),
        samples_(count_),
        like_(count_),
        least_variance_(count_) {
    choice_.states = states;
    for_each_fold([&](size_t f) {
      starts_[f] = folds_.start(f, states, scores.weighting, scores.smoothing);
      const Split& data = folds_.folds_[f].data;
      without_em_[f] = with_first_steps(starts_[f], data.training, folds_.options_.initial_state, 1);
      // EM can predict samples after missing samples that subspace models cannot predict. These samples are not
      // compared.
      like_[f] =
          predicted_by(without_em_[f], data.held_out, folds_.options_.initial_state, {0, folds_.ahead_.horizons});
      least_variance_[f] = least_variance(like_[f].front(), data.held_out);
    });
    choice_.error = errors(without_em_, 0).value;
    trials_.push_back({.states = states, .error = choice_.error});
  }

  // EM with this λ; without one, with those of a search.
  void run(std::optional<double> smoothing) {
    if (folds_.options_.variation.period == 1) smoothing = 0.0;
    work_.begin(words::plural(choice_.states, "state"));
    if (smoothing)
      attempt(*smoothing);
    else
      search();
    finish();
  }

  // EM with the λ of a search with more states. It is given up at the end of a stage that leaves it no chance against
  // them, and goes on if it does not suffice yet.
  void run_beside(const RefinementSearch& more) {
    work_.begin(words::plural(choice_.states, "state"));
    tried_.push_back(more.smoothing());
    bool excluded = false;
    in_first_stages(more.smoothing(), [&](const Attempt& now) {
      keep(now);
      return !(excluded = more.excludes(now));
    });
    if (excluded)
      attempts_.clear();
    else if (!suffices_for(more))
      finish(&more);
  }

  // Gives EM up if it is lost. Otherwise drops needless jumps, and lets the attempts go on. `more`: the search with
  // more states that these are to suffice for.
  void finish(const RefinementSearch* more = nullptr) {
    if (lost()) attempts_.clear();
    if (attempts_.empty() || folds_.pooled() || raced_) return;
    drop_needless_jumps();
    race(more);
    raced_ = true;
  }

  const std::vector<Index>& jumps() const { return jumps_; }
  double smoothing() const { return chosen()->smoothing; }
  // Are the errors smaller than those of the subspace models?
  bool helps() const { return !attempts_.empty() && chosen()->error() < choice_.error; }
  bool suffices_for(const RefinementSearch& more) const {
    return !attempts_.empty() && chosen()->error() < more.chosen()->error() + std::log(most_uncertain) &&
           (folds_.pooled() || chosen()->likelihood.advantage(more.chosen()->likelihood) > -noticeable);
  }

  // The subspace models without EM.
  RefinementOfFolds without_em() {
    RefinementOfFolds result{choice_, without_em_};
    result.choice.ahead = result.choice.ahead_without_em = certainty(without_em_);
    if (!attempts_.empty()) result.choice.smoothing = smoothing();
    return result;
  }

  // EM is used if it improves on its start and on these subspace models, which it replaces. If the best attempt does
  // not, the attempt with the smallest errors may.
  std::optional<RefinementOfFolds> better_than(const RefinementSearch& plain) {
    if (attempts_.empty()) return std::nullopt;
    choice_.ahead_without_em = certainty(plain.without_em_);
    for (const Attempt* attempt : {chosen(), least_error()}) {
      const HeldOutError after = errors(attempt->models, folds_.ahead_.from);
      if (!improves(*attempt, after, *this) || (&plain != this && !improves(*attempt, after, plain))) continue;
      choice_.smoothing = attempt->smoothing;
      choice_.iterations = attempt->iterations;
      for (const Index step : jumps_) choice_.jumps.push_back({step});
      choice_.one_step = after.of_horizon(0);
      choice_.error = attempt->error();
      choice_.ahead = certainty(attempt->models);
      return RefinementOfFolds{choice_, attempt->models};
    }
    return std::nullopt;
  }

 private:
  // EM that did not fail.
  struct Attempt {
    double smoothing = 0.0;
    Index iterations = 0;
    bool converged = false;  // on all folds
    HeldOutError errors;
    Likelihood likelihood;
    std::vector<Model> models;

    double error() const { return errors.value; }
  };

  // Does EM predict clearly better than these subspace models, and not clearly worse by one step? EM that has spoiled
  // its start needs more iterations. From unknown initial states it may also be better in the first steps alone.
  // `after`: the errors after them.
  bool improves(const Attempt& attempt, const HeldOutError& after, const RefinementSearch& on) const {
    const HeldOutError before = on.errors(on.without_em_, folds_.ahead_.from);
    const double gain = before.value - after.value, from_start = on.choice_.error - attempt.error();
    return after.of_horizon(0) <= before.of_horizon(0) + std::log(most_uncertain) &&
           gain >= -std::log(most_uncertain) && std::max(gain, from_start) >= std::log(worth_it);
  }

  // Is the attempt clearly worse than the one with the same λ and as many iterations?
  bool excludes(const Attempt& fewer) const {
    return std::any_of(attempts_.begin(), attempts_.end(), [&](const Attempt& own) {
      return same_smoothing(own.smoothing, fewer.smoothing) && own.iterations == fewer.iterations &&
             (folds_.pooled() ? fewer.error() > own.error() + std::log(hopeless)
                              : fewer.likelihood.surely_below(own.likelihood));
    });
  }

  const Attempt* least_error() const {
    const auto smaller = [](const Attempt& a, const Attempt& b) { return a.error() < b.error(); };
    return &*std::min_element(attempts_.begin(), attempts_.end(), smaller);
  }

  static const Attempt* likeliest(const std::vector<Attempt>& attempts) {
    const auto less = [](const Attempt& a, const Attempt& b) { return a.likelihood.sum() < b.likelihood.sum(); };
    return &*std::max_element(attempts.begin(), attempts.end(), less);
  }

  // The attempt with the smallest errors of those whose likelihood does not differ significantly from the largest. With
  // few experiments, or noise that is not normal, the likelihood alone would decide too finely. If steps share their
  // matrices, there may be very few experiments. Their initial states would decide the likelihood, so the errors
  // decide.
  const Attempt* chosen() const {
    if (folds_.pooled()) return least_error();
    const Attempt* best = likeliest(attempts_);
    for (const Attempt& a : attempts_)
      if (a.error() < best->error() && likely(a)) best = &a;
    return best;
  }

  // Is its likelihood not significantly below the largest?
  bool likely(const Attempt& now) const {
    return likeliest(attempts_)->likelihood.advantage(now.likelihood) < significant;
  }

  bool hopeless_beside_others(const Attempt& now) const {
    return std::any_of(attempts_.begin(), attempts_.end(), [&](const Attempt& other) {
      return other.iterations == now.iterations && now.error() > other.error() + std::log(hopeless);
    });
  }

  // Almost without noise, EM may spoil each start.
  bool lost() const { return !attempts_.empty() && least_error()->error() > choice_.error + std::log(hopeless); }

  template <class Change>
  void for_each_fold(Change&& change) {
    parallel_for(0, Index(count_), {folds_.options_.execution.threads, {}}, [&](Index begin, Index end) {
      for (Index f = begin; f < end; ++f) change(size_t(f));
    });
  }

  // Moves from λ to λ while the likelihood rises.
  void search() {
    double best = std::clamp(folds_.options_.variation.smoothing, first_least, first_most);
    Likelihood most = attempt(best);
    // The λ of the ARX model may be far from the best λ of EM. The likelihood may then have a second maximum.
    if (std::abs(std::log10(best / usual)) > 0.9)
      if (Likelihood found = attempt(usual); found.advantage(most) > noticeable) most = std::move(found), best = usual;
    if (!lost()) climb(best, std::move(most));
    approach_start();
  }

  // The likelihood may not change over half a decade and then rise again, so one larger λ that is not worse is passed
  // over.
  void climb(double best, Likelihood most) {
    for (const double factor : {half_decade, 1 / half_decade}) {
      Index moves = 0;
      bool flat = false;
      for (double next = best * factor; moves < most_moves && next < largest; next *= factor) {
        Likelihood found = attempt(next);
        const double advantage = found.advantage(most);
        if (advantage > noticeable) {
          most = std::move(found);
          flat = false;
          ++moves;
        } else if (factor < 1 || flat || advantage < -noticeable) {
          break;
        } else {
          flat = true;
        }
      }
      if (moves > 0) break;
    }
  }

  // If no attempt predicts better than the subspace models, attempts with less penalty may: they stay closer to them.
  void approach_start() {
    if (attempts_.empty() || least_error()->error() <= choice_.error) return;
    const auto weaker = [](const Attempt& a, const Attempt& b) { return a.smoothing < b.smoothing; };
    double smoothing = std::min_element(attempts_.begin(), attempts_.end(), weaker)->smoothing;
    for (Index moves = 0; moves < most_moves; ++moves) {
      const double least = least_error()->error();
      attempt(smoothing /= half_decade);
      if (!(least_error()->error() < least)) return;
    }
  }

  // Of jumps at two successive steps, the matrices need both only if the likelihood is significantly lower with one.
  void drop_needless_jumps() {
    for (size_t i = 0; i + 1 < jumps_.size();) {
      if (jumps_[i] + 1 != jumps_[i + 1]) {
        ++i;
        continue;
      }
      const double smoothing = chosen()->smoothing;
      const Likelihood both = attempt(smoothing);
      const std::vector<Index> all = jumps_;
      std::optional<Attempt> best;
      std::vector<Index> needed;
      for (const size_t without : {i, i + 1}) {
        jumps_ = all;
        jumps_.erase(jumps_.begin() + std::ptrdiff_t(without));
        Attempt one = in_first_stages(smoothing, [](const Attempt&) { return true; });
        if (!best || one.likelihood.sum() > best->likelihood.sum()) best = std::move(one), needed = jumps_;
      }
      if (best && best->likelihood.advantage(both) > -significant) {
        jumps_ = std::move(needed);
        attempts_ = {std::move(*best)};
      } else {
        jumps_ = all;
        ++i;
      }
    }
  }

  // EM with this λ, from the subspace models, unless it was tried before. Returns the largest log-likelihood of the
  // held-out experiments.
  Likelihood attempt(double smoothing) {
    const auto same = [&](double other) { return same_smoothing(other, smoothing); };
    if (std::none_of(tried_.begin(), tried_.end(), same)) {
      tried_.push_back(smoothing);
      double likelihood = -std::numeric_limits<double>::infinity(), error = -likelihood;
      in_first_stages(smoothing, [&](const Attempt& now) {
        keep(now);
        const bool better = now.likelihood.sum() > likelihood || now.error() < error;
        likelihood = now.likelihood.sum(), error = now.error();
        return better && !now.converged && (!jumps_.empty() || !hopeless_beside_others(now));
      });
    }
    Likelihood most;
    for (const Attempt& a : attempts_)
      if (same(a.smoothing) && a.likelihood.sum() > most.sum()) most = a.likelihood;
    return most;
  }

  // EM with this λ from the subspace models, in the first stages. After each stage, `go_on` decides whether it
  // continues.
  template <class GoOn>
  Attempt in_first_stages(double smoothing, GoOn&& go_on) {
    Attempt now;
    now.smoothing = smoothing;
    now.models = starts_;
    while (now.iterations < first_end(options(0.0)))
      if (now = refined(std::move(now), stage_after(now.iterations, folds_.pooled())); !go_on(now)) break;
    return now;
  }

  // The attempts go on until EM converges, until neither the likelihood nor the errors of a likely attempt improve, or
  // until `most_iterations`. Before each stage, those are left out that are significantly less likely than another one
  // that goes on. `more`: attempts with fewer states are likely only if they are beside those with more.
  void race(const RefinementSearch* more) {
    std::vector<Attempt> racing;
    for (const Attempt& a : attempts_)
      if (a.iterations == first_end(options(0.0)) && !a.converged) racing.push_back(a);
    while (!racing.empty()) {
      const Likelihood most = likeliest(racing)->likelihood;
      std::vector<Attempt> improved;
      for (const Attempt& a : racing) {
        if (most.advantage(a.likelihood) > significant) continue;
        Attempt next = refined(a, stage_after(a.iterations, folds_.pooled()));
        keep(next);
        const bool better = next.likelihood.sum() > a.likelihood.sum() ||
                            (next.error() < a.error() && likely(next) && (!more || more->likely(next)));
        if (better && !next.converged && next.iterations < most_iterations) improved.push_back(std::move(next));
      }
      racing = std::move(improved);
    }
  }

  void keep(const Attempt& attempt) {
    if (std::isfinite(attempt.likelihood.sum())) attempts_.push_back(attempt);
  }

  Attempt refined(Attempt start, const Stage& stage) {
    std::vector<Vector> found(count_);
    std::vector<char> converged(count_);
    for_each_fold([&](size_t f) {
      const Split& data = folds_.folds_[f].data;
      Refinement fold = refined_fold(start.smoothing, stage, f, start.models[f]);
      start.models[f] = std::move(fold.model);
      converged[f] = fold.converged;
      if (start.models[f].steps() > 0)
        found[f] = log_likelihoods_with(least_variance_[f], start.models[f], data.held_out);
    });
    const bool all = std::all_of(found.begin(), found.end(), [](const Vector& fold) { return fold.size() > 0; });
    start.likelihood = all ? Likelihood(found) : Likelihood();
    start.errors = errors(start.models, 0);
    start.converged = std::all_of(converged.begin(), converged.end(), [](char fold) { return fold != 0; });
    start.iterations += stage.iterations;
    trials_.push_back({choice_.states, start.smoothing, start.iterations, start.error(), start.likelihood.mean()});
    return start;
  }

  RefineOptions options(double smoothing) const {
    RefineOptions o;
    o.smoothing = smoothing;
    o.period = folds_.options_.variation.period;
    o.initial_state = folds_.options_.initial_state;
    o.feedthrough = folds_.options_.feedthrough;
    o.jumps = jumps_;
    return o;
  }

  AheadCertainty certainty(const std::vector<Model>& models) {
    std::vector<AheadErrors> errors(count_);
    for_each_fold([&](size_t f) {
      const Ensemble& held_out = folds_.folds_[f].data.held_out;
      const auto predicted_by = [&](const Model& model) {
        const Index h = std::min(AheadCertainty::horizon, std::max<Index>(1, held_out.steps() - 1));
        return predict(of_departures(model, held_out), held_out, {h, folds_.options_.initial_state}).y;
      };
      std::vector<Ensemble> by_others;
      for (size_t g = 0; g < count_; ++g)
        if (g != f) by_others.push_back(predicted_by(models[g]));
      errors[f] = ahead_errors(models[f], predicted_by(models[f]), by_others, Index(folds_.folds_.size()), held_out,
                               AheadCertainty::horizon);
    });
    AheadErrors sum;
    for (const AheadErrors& fold : errors) sum += fold;
    return {sum.ratio(), sum.model_share()};
  }

  // With an empty model if EM fails: this λ is ruled out.
  Refinement refined_fold(double smoothing, const Stage& stage, size_t f, const Model& start) {
    if (start.steps() == 0) return {};
    try {
      RefineOptions o = options(smoothing);
      o.execution.progress = work_.counted();
      return refined_in(stage, start, folds_.folds_[f].data.training, samples_[f], o);
    } catch (const std::runtime_error&) {
      return {};
    }
  }

  // From step `first` on. Before, the observers have not settled.
  HeldOutError errors(const std::vector<Model>& models, Index first) const {
    return folds_.error_of(
        count_, choice_.states, [&](size_t f) { return models[f]; }, {first, folds_.ahead_.horizons},
        folds_.options_.execution, like_);
  }

  const Folds& folds_;
  SearchProgress& work_;
  std::vector<RefinementTrial>& trials_;
  std::vector<Index> jumps_;
  size_t count_;
  std::vector<Model> starts_;                     // subspace models
  std::vector<Model> without_em_;                 // the same, which predict from step 0 on
  std::vector<std::optional<em::Data>> samples_;  // of the training data of each fold
  std::vector<Predicted> like_;
  std::vector<Vector> least_variance_;  // as in least_variance, of each fold
  std::vector<Attempt> attempts_;
  std::vector<double> tried_;  // λ of all attempts, also of those that failed
  bool raced_ = false;
  RefinementChoice choice_;
};

RefinementOfFolds Folds::choose_refinement(Index states, bool or_fewer, const OrderScores& scores,
                                           std::optional<double> smoothing, SearchProgress& work) const {
  std::vector<RefinementTrial> trials;
  const auto begun = [&](Index n, const std::vector<Index>& jumps) {
    return std::make_shared<RefinementSearch>(*this, n, scores, jumps, work, trials);
  };
  const std::shared_ptr<RefinementSearch> plain = begun(states, options_.variation.jumps);
  plain->run(smoothing);
  std::shared_ptr<RefinementSearch> best = plain;
  // One number that does not suffice may split a pair of eigenvalues.
  if (or_fewer && plain->helps())
    for (Index n = states - 1, failed = 0; n > 0 && failed < 2; --n) {
      const std::shared_ptr<RefinementSearch> fewer = begun(n, best->jumps());
      fewer->run_beside(*best);
      if (fewer->suffices_for(*best))
        best = fewer, failed = 0;
      else
        ++failed;
    }
  best->finish();
  std::optional<RefinementOfFolds> result = best->better_than(*plain);
  if (!result && best != plain) result = plain->better_than(*plain);
  if (!result) result = plain->without_em();
  result->choice.trials = std::move(trials);
  return std::move(*result);
}

namespace {

// EM of models whose steps share their matrices uses the first steps of long records alone.
constexpr double enough_refined = 50000;

}  // namespace

Index refined_steps(const Ensemble& data, Index period) {
  if (period == 0) return data.steps();
  const double enough = enough_refined * double(period) / double(std::max<Index>(1, data.experiments()));
  return double(data.steps()) > enough ? std::max(Index(enough), std::min(data.steps(), 2 * period + 1)) : data.steps();
}

Model refined(Model model, const Ensemble& data, Index from, Index to, const RefineOptions& options) {
  if (const Index steps = refined_steps(data, options.period.value_or(0)); steps < data.steps()) {
    model.step.resize(size_t(std::min(steps, model.steps())));
    return continued(refined(std::move(model), stretch(data, 0, steps), from, to, options), data.steps());
  }
  std::optional<em::Data> samples;
  while (from < to) {
    Stage stage = stage_after(from, options.period.value_or(0) > 0);
    stage.iterations = std::min(stage.iterations, to - from);
    model = refined_in(stage, model, data, samples, options).model;
    from += stage.iterations;
  }
  return model;
}

Index next_stage_end(Index iterations) { return iterations + stage_after(iterations, false).iterations; }

bool stopped_early(Index iterations, const RefineOptions& options) { return iterations < first_end(options); }

}  // namespace tokid
