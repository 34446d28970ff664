// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>

#include <fmt/format.h>

#include "base/statistics.hpp"
#include "base/words.hpp"
#include "choose/ahead_errors.hpp"
#include "choose/first_steps.hpp"
#include "choose/folds.hpp"
#include "noise/em.hpp"
#include "tokid/em.hpp"

namespace tokid {

namespace {

// A larger order must raise the likelihood by `significant` standard errors, and a smaller order may reduce it by
// `noticeable` ones. The search for λ goes on while the likelihood rises by more than `noticeable` ones.
constexpr double significant = 2.0, noticeable = 1.0;
const double half_decade = std::sqrt(10.0);
// A usual λ of EM, bounds of the first λ of a search without a ladder, and the largest λ. With a larger one EM does not
// converge in these stages.
constexpr double usual = 3.0, first_least = 1e-2, first_most = 1e2, largest = 320.0;
// The first λ of the ladder, and the number of experiments for each unknown of a step from which on EM climbs it. With
// fewer, the weak penalties of the first rungs spoil the models so much that stronger ones may not repair them.
constexpr double enough_for_ladder = 8.0;
const double gentle = NoisyChoices{}.refinement_first;
// Instead of the first λ: EM does not climb.
constexpr double no_ladder = 0.0;
// The search comes to a λ on several ways, with different rounding errors.
bool same_smoothing(double a, double b) { return std::abs(a - b) <= 1e-6 * std::max(a, b); }

// EM runs in stages. Each has a λ, a number of iterations, and ends with an evaluation.
struct Stage {
  Index iterations = 0;
  double smoothing = 0.0;
  bool warm_up = false;
};
constexpr Index pooled_iterations[] = {10, 30, 100}, apart_iterations[] = {3, 5, 40}, rung_iterations = 12, longer = 48,
                longest = 120;

// For every λ the stages `first`. Only for the best λ the stages `last`.
struct Schedule {
  std::vector<Stage> first, last;

  std::vector<Stage> all() const {
    std::vector<Stage> stages = first;
    stages.insert(stages.end(), last.begin(), last.end());
    return stages;
  }
};

// The λ of the rung below, on a ladder that begins with `first`.
std::optional<double> below(double smoothing, double first) {
  if (smoothing <= 0 || same_smoothing(smoothing, first)) return std::nullopt;
  double rung = first;
  while (rung * 10 < smoothing && !same_smoothing(rung * 10, smoothing)) rung *= 10;
  return rung;
}

// If steps share their matrices, EM needs many iterations, but an iteration takes less time.
// With enough experiments, EM climbs a ladder of decades of λ up to its own. A weak penalty leaves the coordinates of
// the subspace model as they are, and a stronger one makes them smooth little by little. From the start on, it would
// make all steps equal, and EM would need many iterations to recover. The rungs are the first stages of smaller λ, so
// that each is computed once. With fewer experiments, each λ has its own warm-up, and few iterations are often the
// best.
Schedule schedule_of(const RefineOptions& o, double first) {
  Schedule schedule;
  if (o.period.value_or(0) > 0) {
    for (const Index count : pooled_iterations) schedule.first.push_back({count, o.smoothing, true});
    return schedule;
  }
  if (first == no_ladder)
    for (const Index count : apart_iterations) schedule.first.push_back({count, o.smoothing, true});
  else
    for (std::optional<double> next = o.smoothing; next; next = below(*next, first))
      schedule.first.push_back({rung_iterations, *next});
  if (first != no_ladder) std::reverse(schedule.first.begin(), schedule.first.end());
  if (first != no_ladder || !o.jumps.empty()) schedule.last = {{longer, o.smoothing}};
  schedule.last.push_back({longest, o.smoothing});
  return schedule;
}

Model refined_in(const Stage& stage, const Model& start, const Ensemble& data, std::optional<em::Data>& samples,
                 RefineOptions o) {
  o.smoothing = stage.smoothing;
  o.iterations = stage.iterations;
  o.warm_up = stage.warm_up;
  return em::refine(start, data, samples, o).model;
}
// The most half decades that a search goes in one direction.
constexpr Index most_moves = 6;
// A number of states whose errors are larger by this factor than those of the best number so far does not go on to the
// last stage.
constexpr double hopeless = 2.0;
// After as many iterations, a number of states is given up if its likelihood is lower than that of the best one, and
// chance would do that with less than this probability: five standard errors of many experiments, and more of few.
constexpr double hopeless_probability = 3e-7;

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
  bool hopelessly_below(const Likelihood& other) const {
    const double freedom = double(of_experiment_.size()) - 1.0;
    return freedom > 0 && advantage(other) < -statistics::student_quantile(1 - hopeless_probability, freedom);
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
    const Index inputs = folds_.folds_.front().data.training.inputs();
    if (double(folds_.experiments_) < enough_for_ladder * double(states + inputs)) first_ = no_ladder;
    for_each_fold([&](size_t f) {
      starts_[f] = folds_.start(f, states, scores.weighting, scores.smoothing);
      const Split& data = folds_.folds_[f].data;
      without_em_[f] = with_first_steps(starts_[f], data.training, folds_.options_.initial_state, 1);
      // EM can predict samples after missing samples that subspace models cannot predict. These samples are not
      // compared.
      like_[f] = computed_by(without_em_[f], data.held_out, folds_.options_.initial_state, 0);
      least_variance_[f] = least_variance(like_[f], data.held_out);
    });
    choice_.error = errors(without_em_, 0).mean();
    trials_.push_back({.states = states, .error = choice_.error});
  }

  // Tries λ, or only the given one. A longer stage follows only for the best λ.
  void run(std::optional<double> smoothing_given) {
    if (folds_.options_.variation.period == 1) smoothing_given = 0.0;
    work_.begin(words::plural(choice_.states, "state"));
    if (smoothing_given)
      attempt(*smoothing_given);
    else
      choose_smoothing();
    if (!smoothing_given && !empty() && least_error()->error() > choice_.error) approach_start();
    if (all_lost()) attempts_.clear();
    if (empty()) return;
    if (!folds_.pooled()) drop_needless_jumps();
    if (!climbs() || !jumps_.empty())
      continue_best();
    else
      smoothing_given ? go_on(chosen()->smoothing) : choose_longer();
  }

  // Tries the λ of a search for another number of states, and the λ around it, unless this number is clearly worse.
  void run_beside(const RefinementSearch& other) {
    first_ = other.first_;
    rival_ = &other;
    search_beside(other);
    rival_ = nullptr;
  }

  // The last stages of the number of states that was chosen.
  void finish() {
    if (!empty()) continue_best();
  }

  bool empty() const { return attempts_.empty(); }
  // Are the errors smaller than those of the subspace models?
  bool helps() const { return !empty() && error() < choice_.error; }
  Index states() const { return choice_.states; }
  // Of the best λ.
  const Likelihood& likelihood() const { return chosen()->likelihood; }
  double smoothing() const { return chosen()->smoothing; }
  double error() const { return chosen()->error(); }
  const std::vector<Index>& jumps() const { return jumps_; }

  // The subspace models without EM.
  RefinementOfFolds without_em() {
    RefinementOfFolds result{choice_, without_em_};
    result.choice.ahead = result.choice.ahead_without_em = certainty(without_em_);
    if (!empty()) result.choice.smoothing = smoothing();
    return result;
  }

  // EM is used if it improves on its start and on these subspace models, which it replaces. If the best attempt does
  // not, the attempt with the smallest errors may.
  std::optional<RefinementOfFolds> better_than(const RefinementSearch& plain) {
    if (empty()) return std::nullopt;
    choice_.ahead_without_em = certainty(plain.without_em_);
    for (const Attempt* attempt : {chosen(), least_error()}) {
      const Errors after = errors(attempt->models, folds_.first_);
      if (!improves(*attempt, after, *this) || (&plain != this && !improves(*attempt, after, plain))) continue;
      choice_.smoothing = attempt->smoothing;
      choice_.first_smoothing = first_;
      choice_.iterations = attempt->iterations;
      for (const Index step : jumps_) choice_.jumps.push_back({step});
      choice_.one_step = after.one_step;
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
    Errors errors;
    Likelihood likelihood;
    std::vector<Model> models;

    double error() const { return errors.mean(); }
  };

  // The attempts at the ends of the first stages of a λ that belong to this λ.
  struct Way {
    double smoothing = 0.0;
    std::vector<Attempt> stages;
  };

  // Does EM predict clearly better than these subspace models, and not clearly worse by one step? EM that has spoiled
  // its start needs more iterations. From unknown initial states it may also be better in the first steps alone.
  // `after`: the errors after them.
  bool improves(const Attempt& attempt, const Errors& after, const RefinementSearch& on) const {
    const Errors before = on.errors(on.without_em_, folds_.first_);
    const double gain = before.mean() - after.mean(), from_start = on.choice_.error - attempt.error();
    return after.one_step <= before.one_step + std::log(most_uncertain) && gain >= -std::log(most_uncertain) &&
           std::max(gain, from_start) >= std::log(worth_it);
  }

  const Attempt* least_error() const {
    const auto smaller = [](const Attempt& a, const Attempt& b) { return a.error() < b.error(); };
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
      if (a.error() < best->error() && most->likelihood.advantage(a.likelihood) < significant) best = &a;
    return best;
  }

  template <class Change>
  void for_each_fold(Change&& change) {
    parallel_for(0, Index(count_), {folds_.options_.execution.threads, {}}, [&](Index begin, Index end) {
      for (Index f = begin; f < end; ++f) change(size_t(f));
    });
  }

  void search_beside(const RefinementSearch& other) {
    const double from = other.smoothing();
    work_.begin(words::plural(choice_.states, "state"));
    Likelihood most = attempt(from);
    if (empty() || least_error()->error() > other.error() + std::log(hopeless)) return;
    if (!folds_.pooled() && behind(other, attempts_.back())) return;
    if (!climbs() || !jumps_.empty()) return continue_best();
    climb(from, std::move(most));
    go_on(chosen()->smoothing);
  }

  void choose_smoothing() {
    if (climbs()) return climb_ladder();
    double best = std::clamp(folds_.options_.variation.smoothing, first_least, first_most);
    Likelihood most = attempt(best);
    // The λ of the ARX model may be far from the best λ of EM. The likelihood may then have a second maximum.
    if (std::abs(std::log10(best / usual)) > 0.9) try_smoothing(usual, noticeable, best, most);
    if (!all_lost()) climb(best, std::move(most));
  }

  bool climbs() const { return first_ != no_ladder && !folds_.pooled(); }

  void climb_ladder() {
    double best = first_;
    Likelihood most = attempt(best);
    for (double next = 10 * best; next < largest && (empty() || !lost(attempts_.back())); next *= 10)
      try_smoothing(next, 0.0, best, most);
    if (!all_lost()) climb(best, std::move(most));
  }

  // Is the error of this attempt larger by the factor `hopeless` than that of the best attempt, or without EM?
  bool lost(const Attempt& attempt) const {
    return attempt.error() > std::min(least_error()->error(), choice_.error) + std::log(hopeless);
  }
  // Almost without noise, EM may spoil each start.
  bool all_lost() const { return !empty() && lost(*least_error()); }

  // Makes this λ the best one if it raises the likelihood by more than this number of standard errors.
  void try_smoothing(double smoothing, double advantage, double& best, Likelihood& most) {
    Likelihood found = attempt(smoothing);
    if (!(found.advantage(most) > advantage)) return;
    most = std::move(found);
    best = smoothing;
  }

  // Moves from λ to λ while the likelihood rises. It may not change over half a decade and then rise again, so one
  // larger λ that is not worse is passed over.
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
      const double smoothing = chosen()->smoothing;
      const std::vector<Index> all = jumps_;
      const Attempt from = way_to(smoothing).stages.back();
      const Likelihood both = attempt(smoothing);
      std::optional<Attempt> best;
      std::vector<Index> needed;
      for (const size_t without : {i, i + 1}) {
        if (all[i] + 1 != all[i + 1]) break;
        jumps_ = all;
        jumps_.erase(jumps_.begin() + std::ptrdiff_t(without));
        Attempt one = refined(from, {longer, smoothing});
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

  // Is the likelihood hopelessly lower than that of `rival` after as many iterations with the same λ?
  static bool behind(const RefinementSearch& rival, const Attempt& own) {
    return std::any_of(rival.attempts_.begin(), rival.attempts_.end(), [&](const Attempt& other) {
      return same_smoothing(other.smoothing, own.smoothing) && other.iterations == own.iterations &&
             own.likelihood.hopelessly_below(other.likelihood);
    });
  }

  // With a stronger penalty, EM needs more iterations. It is therefore compared with the best λ once more when both
  // have had more of them.
  void choose_longer() {
    for (double best = chosen()->smoothing;; best *= half_decade) {
      go_on(best);
      if (best * half_decade >= largest) return;
      go_on(best * half_decade);
      if (!same_smoothing(chosen()->smoothing, best * half_decade)) return;
    }
  }

  // The first of the last stages of this λ.
  void go_on(double smoothing) {
    const Attempt& first = way_to(smoothing).stages.back();
    const auto known = [&](const Attempt& a) {
      return same_smoothing(a.smoothing, smoothing) && a.iterations > first.iterations;
    };
    if (std::none_of(attempts_.begin(), attempts_.end(), known)) keep(refined(first, {longer, smoothing}));
  }

  // The further stages, if EM has not been best before.
  void continue_best() {
    const Attempt best = *chosen();
    const auto farther = [&](const Attempt& a) {
      return same_smoothing(a.smoothing, best.smoothing) && a.iterations > best.iterations;
    };
    if (std::any_of(attempts_.begin(), attempts_.end(), farther)) return;
    Attempt now = best;
    Index end = 0;
    for (const Stage& stage : schedule_of(options(best.smoothing), first_).all())
      if (end += stage.iterations; end > best.iterations) keep(now = refined(std::move(now), stage));
  }

  // EM with this λ, from subspace models, unless it was tried before. Returns the largest log-likelihood of the
  // held-out experiments.
  Likelihood attempt(double smoothing) {
    const auto same = [&](double other) { return same_smoothing(other, smoothing); };
    if (std::none_of(tried_.begin(), tried_.end(), same)) {
      tried_.push_back(smoothing);
      for (const Attempt& stage : way_to(smoothing).stages) keep(stage);
      if (!jumps_.empty())
        go_on(smoothing);  // with a jump, a large λ shows that it is the best only after more iterations
    }
    Likelihood most;
    for (const Attempt& a : attempts_)
      if (same(a.smoothing) && a.likelihood.sum() > most.sum()) most = a.likelihood;
    return most;
  }

  // The first stages of this λ. Those of smaller λ, which its ladder shares, are not repeated.
  Way& way_to(double smoothing) {
    for (Way& known : ways_)
      if (same_smoothing(known.smoothing, smoothing)) return known;
    const std::vector<Stage> stages = schedule_of(options(smoothing), first_).first;
    Way way{smoothing, {}};
    Attempt now{smoothing, 0, {}, {}, starts_};
    size_t known = 0;
    if (const auto lower = climbs() ? below(smoothing, first_) : std::nullopt) {
      now = way_to(*lower).stages.back();
      now.smoothing = smoothing;
      known = stages.size() - 1;
    }
    for (size_t i = known; i < stages.size(); ++i) {
      way.stages.push_back(now = refined(std::move(now), stages[i]));
      if (!climbs() && !folds_.pooled() && rival_ && behind(*rival_, now)) break;
    }
    return ways_.emplace_back(std::move(way));
  }

  void keep(const Attempt& attempt) {
    if (std::isfinite(attempt.likelihood.sum())) attempts_.push_back(attempt);
  }

  Attempt refined(Attempt start, const Stage& stage) {
    std::vector<Vector> found(count_);
    for_each_fold([&](size_t f) {
      const Split& data = folds_.folds_[f].data;
      start.models[f] = refined_fold(start.smoothing, stage, f, start.models[f]);
      if (start.models[f].steps() > 0)
        found[f] = log_likelihoods_with(least_variance_[f], start.models[f], data.held_out);
    });
    const bool all = std::all_of(found.begin(), found.end(), [](const Vector& fold) { return fold.size() > 0; });
    start.likelihood = all ? Likelihood(found) : Likelihood();
    start.errors = errors(start.models, 0);
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
        return ahead_by(model, held_out, folds_.options_.initial_state);
      };
      std::vector<Ensemble> by_others;
      for (size_t g = 0; g < count_; ++g)
        if (g != f) by_others.push_back(predicted_by(models[g]));
      errors[f] = ahead_errors(models[f], predicted_by(models[f]), by_others, Index(folds_.folds_.size()), held_out,
                               OrderScores::horizon);
    });
    AheadErrors sum;
    for (const AheadErrors& fold : errors) sum += fold;
    return {sum.ratio(), sum.model_share()};
  }

  // Empty if EM fails: this λ is ruled out.
  Model refined_fold(double smoothing, const Stage& stage, size_t f, const Model& start) {
    if (start.steps() == 0) return start;
    try {
      RefineOptions o = options(smoothing);
      o.execution.progress = work_.counted();
      return refined_in(stage, start, folds_.folds_[f].data.training, samples_[f], o);
    } catch (const std::runtime_error&) {
      return {};
    }
  }

  // From step `first` on. Before, the observers have not settled.
  Errors errors(const std::vector<Model>& models, Index first) const {
    const auto found = folds_.errors_of_folds(
        count_, choice_.states, [&](size_t f) { return models[f]; }, first, folds_.options_.execution, like_);
    constexpr double none = std::numeric_limits<double>::infinity();
    return found ? mean_of(*found) : Errors{none, none, none};
  }

  const Folds& folds_;
  SearchProgress& work_;
  std::vector<RefinementTrial>& trials_;
  std::vector<Index> jumps_;
  size_t count_;
  std::vector<Model> starts_;                     // subspace models
  std::vector<Model> without_em_;                 // the same, which predict from step 0 on
  std::vector<std::optional<em::Data>> samples_;  // of the training data of each fold
  std::vector<Computed> like_;
  std::vector<Vector> least_variance_;  // as in least_variance, of each fold
  std::vector<Attempt> attempts_;
  std::vector<double> tried_;                // λ of all attempts, also of those that failed
  double first_ = gentle;                    // λ with which EM begins
  const RefinementSearch* rival_ = nullptr;  // while another number of states is compared with it
  std::deque<Way> ways_;
  RefinementChoice choice_;
};

// The search for the number of states of EM.
class Folds::OrderSearch {
 public:
  OrderSearch(const Folds& folds, const OrderRange& orders, const OrderScores& scores, std::optional<double> smoothing,
              SearchProgress& work)
      : folds_(folds), orders_(orders), scores_(scores), smoothing_(smoothing), work_(work) {}

  RefinementOfFolds run(Index states) {
    const Index fewest = orders_.fewest < orders_.most ? scores_.fewest_within(most_uncertain) : states;
    const Search plain = begun(states), first = fewest < states ? begun(fewest) : plain;
    best_ = refined(first);
    if (first != plain && !fewer_suffice(*first, *refined(plain))) best_ = plain;
    if (best_->helps()) {
      if (best_ == plain) try_more();
      if (best_->states() <= states) try_fewer(fewest, first);
    }
    best_->finish();
    std::optional<RefinementOfFolds> result = best_->better_than(*plain);
    if (!result && best_ != plain) result = plain->better_than(*plain);
    if (!result) result = plain->without_em();
    result->choice.trials = std::move(trials_);
    return std::move(*result);
  }

 private:
  using Search = std::shared_ptr<RefinementSearch>;

  // Before EM.
  Search begun(Index n) {
    return std::make_shared<RefinementSearch>(folds_, n, scores_,
                                              best_ ? best_->jumps() : folds_.options_.variation.jumps, work_, trials_);
  }

  // With EM: at the λ of the best search and around it, if there is one.
  Search refined(const Search& search) {
    if (smoothing_ || !best_ || best_->empty())
      search->run(smoothing_);
    else
      search->run_beside(*best_);
    return search;
  }

  bool fewer_suffice(const RefinementSearch& fewer, const RefinementSearch& more) const {
    return !fewer.empty() && fewer.error() < more.error() + std::log(worth_it) &&
           (folds_.pooled() || fewer.likelihood().advantage(more.likelihood()) > -noticeable);
  }

  bool more_help(const RefinementSearch& more, const RefinementSearch& fewer) const {
    const double allowed = folds_.pooled() ? 1 / most_uncertain : worth_it;
    return !more.empty() && more.error() < fewer.error() + std::log(allowed) &&
           (folds_.pooled() || more.likelihood().advantage(fewer.likelihood()) > significant);
  }

  void try_more() {
    while (!best_->empty() && best_->states() < orders_.most) {
      const Search more = refined(begun(best_->states() + 1));
      if (!more_help(*more, *best_)) return;
      best_ = more;
    }
  }

  // Passes over one number of states that does not suffice: it may split a pair of eigenvalues.
  void try_fewer(Index fewest, const Search& first) {
    Index failed = 0;
    for (Index n = best_->states() - 1; !best_->empty() && n >= orders_.fewest && failed < 2; --n) {
      ++failed;
      if (error_of(n) > error_of(best_->states()) + std::log(hopeless)) continue;
      const Search fewer = n == fewest ? first : refined(begun(n));
      if (fewer_suffice(*fewer, *best_)) best_ = fewer, failed = 0;
    }
  }

  // Of the subspace models; -∞ if it is not known.
  double error_of(Index n) const {
    const auto at = std::find(scores_.states.begin(), scores_.states.end(), n);
    return at == scores_.states.end() ? -std::numeric_limits<double>::infinity()
                                      : scores_.mean(size_t(at - scores_.states.begin()));
  }

  const Folds& folds_;
  const OrderRange& orders_;
  const OrderScores& scores_;
  std::optional<double> smoothing_;
  SearchProgress& work_;
  Search best_;
  std::vector<RefinementTrial> trials_;  // of all searches
};

RefinementOfFolds Folds::choose_refinement(Index states, const OrderRange& orders, const OrderScores& scores,
                                           std::optional<double> smoothing, SearchProgress& work) const {
  return OrderSearch(*this, orders, scores, smoothing, work).run(states);
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

Model refined(Model model, const Ensemble& data, Index from, Index to, const RefineOptions& options, double first) {
  if (const Index steps = refined_steps(data, options.period.value_or(0)); steps < data.steps()) {
    model.step.resize(size_t(std::min(steps, model.steps())));
    return continued(refined(std::move(model), stretch(data, 0, steps), from, to, options, first), data.steps());
  }
  std::optional<em::Data> samples;
  Index end = 0;
  Stage last;
  for (const Stage& stage : schedule_of(options, first).all()) {
    end += stage.iterations;
    last = stage;
    if (end <= from) continue;
    if (from >= to) return model;
    model = refined_in(stage, model, data, samples, options);
    from = end;
  }
  for (; from < to; from += last.iterations) model = refined_in(last, model, data, samples, options);
  return model;
}

Index next_stage_end(Index iterations, const RefineOptions& options, double first) {
  Index end = 0, last = 0;
  for (const Stage& stage : schedule_of(options, first).all()) {
    end += last = stage.iterations;
    if (end > iterations) return end;
  }
  return iterations + last;
}

bool stopped_early(Index iterations, const RefineOptions& options, double first) {
  Index least = 0;
  for (const Stage& stage : schedule_of(options, first).first) least += stage.iterations;
  return iterations < least;
}

}  // namespace tokid
