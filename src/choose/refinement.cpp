// SPDX-License-Identifier: BSD-3-Clause
#include "choose/refinement.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <set>
#include <stdexcept>
#include <utility>

#include "base/words.hpp"
#include "choose/ahead_errors.hpp"
#include "noise/em.hpp"

namespace tokid {

namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

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
// Attempts whose errors are larger by this factor are given up. Attempts with another λ converge at another rate, so
// that smaller differences after few iterations tell nothing.
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

bool is_shared(const RefineOptions& o) { return o.period.value_or(0) > 0; }

// The most iterations of an attempt before the best ones go on. If steps share their matrices, EM needs many
// iterations, but an iteration takes less time, and no attempt goes on. With a jump, a large λ shows only after more
// iterations that it is the best.
Index first_end(const RefineOptions& o) {
  return is_shared(o) ? 4 * warmed_up : o.jumps.empty() ? warmed_up : 2 * warmed_up;
}

Refinement refined_in(const Stage& stage, const Model& start, const Ensemble& data, std::optional<em::Data>& samples,
                      RefineOptions o) {
  o.iterations = stage.iterations;
  o.warm_up = stage.warm_up;
  return em::refine(start, data, samples, o);
}

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

// The log-likelihoods of held-out experiments; empty if EM failed. -∞ without a finite sum.
double sum_of(const Vector& likelihood) {
  return likelihood.size() > 0 && likelihood.allFinite() ? likelihood.sum() : -infinity;
}

// The difference of the sums, in units of its standard error over the experiments. ±∞ if one sum is not finite.
double advantage(const Vector& a, const Vector& b) {
  if (std::isinf(sum_of(a))) return -infinity;
  if (std::isinf(sum_of(b))) return infinity;
  const Eigen::ArrayXd difference = a - b;
  const double count = double(difference.size()), square = (difference - difference.mean()).square().sum();
  return difference.sum() / std::sqrt(std::max(square * count / std::max(1.0, count - 1), 1e-300));
}

// EM of all folds with one λ, after so many iterations.
struct Attempt {
  double smoothing = 0.0;
  Index iterations = 0;
  bool converged = false;  // on all folds
  HeldOutError errors;
  Vector likelihood;  // as in sum_of()
  std::vector<Model> models;

  double error() const { return errors.value; }
  double sum() const { return sum_of(likelihood); }
};

double advantage(const Attempt& a, const Attempt& b) { return advantage(a.likelihood, b.likelihood); }

const Attempt& likeliest(const std::vector<Attempt>& attempts) {
  const auto less = [](const Attempt& a, const Attempt& b) { return a.sum() < b.sum(); };
  return *std::max_element(attempts.begin(), attempts.end(), less);
}

const Attempt& least_error(const std::vector<Attempt>& attempts) {
  const auto smaller = [](const Attempt& a, const Attempt& b) { return a.error() < b.error(); };
  return *std::min_element(attempts.begin(), attempts.end(), smaller);
}

// The models of the folds without EM, which predict from step 0 on, and what they say about held-out experiments.
class WithoutEm {
 public:
  WithoutEm(Index states, std::vector<Model> models, const RefinementSettings& settings)
      : settings_(settings),
        states_(states),
        models_(std::move(models)),
        like_(models_.size()),
        least_variance_(models_.size()) {
    for_each_fold([&](size_t f) {
      // EM can predict samples after missing samples that subspace models cannot predict. These samples are not
      // compared.
      const Ensemble& held_out = settings_.data[f]->held_out;
      like_[f] = predicted_by(models_[f], held_out, *settings_.em.initial_state, from_start());
      least_variance_[f] = least_variance(like_[f].front(), held_out);
    });
    error_ = errors(models_, states, from_start());
    ahead_ = errors(models_, states, settings_.ahead);
  }

  template <class Change>
  void for_each_fold(Change&& change) const {
    parallel_for(0, Index(models_.size()), {settings_.threads, {}}, [&](Index begin, Index end) {
      for (Index f = begin; f < end; ++f) change(size_t(f));
    });
  }
  Ahead from_start() const { return {0, settings_.ahead.horizons, settings_.ahead.every}; }
  // The number of held-out experiments.
  Index experiments() const {
    Index count = 0;
    for (size_t f = 0; f < models_.size(); ++f) count += settings_.data[f]->held_out.experiments();
    return count;
  }

  // Of any models of the folds. Infinite if one has another number of states.
  HeldOutError errors(const std::vector<Model>& models, Index states, const Ahead& ahead) const {
    for (const Model& model : models)
      if (model.steps() == 0 || model.states() != states) return infinite_error(ahead, experiments());
    std::vector<Squares> squares(models.size());
    for_each_fold([&](size_t f) {
      const Ensemble& held_out = settings_.data[f]->held_out;
      squares[f] =
          squares_of(predicted_by(models[f], held_out, *settings_.em.initial_state, ahead), held_out, ahead, &like_[f]);
    });
    return held_out_error(joined(squares), settings_.output_weights);
  }
  AheadCertainty certainty(const std::vector<Model>& models) const {
    std::vector<const Ensemble*> held_out;
    for (size_t f = 0; f < models.size(); ++f) held_out.push_back(&settings_.data[f]->held_out);
    return ahead_certainty(models, held_out, settings_.folds, *settings_.em.initial_state, settings_.threads);
  }

  const Vector& least_variance_of(size_t fold) const { return least_variance_[fold]; }
  const HeldOutError& error() const { return error_; }  // from step 0 on
  const HeldOutError& ahead() const { return ahead_; }  // of settled observers

  RefinementOfFolds result() const {
    RefinementOfFolds result{{}, models_};
    result.choice.states = states_;
    result.choice.error = error_.value;
    result.choice.ahead = result.choice.ahead_without_em = certainty(models_);
    return result;
  }

 private:
  const RefinementSettings& settings_;
  Index states_;
  std::vector<Model> models_;
  std::vector<Predicted> like_;
  std::vector<Vector> least_variance_;  // as in least_variance, of each fold
  HeldOutError error_, ahead_;
};

// The cross-validation of EM with one number of states.
class Search {
 public:
  // `trials`: of all searches, to which this one adds its own.
  Search(std::vector<Model> starts, Index states, std::vector<Index> jumps, const WithoutEm& without_em,
         const RefinementSettings& settings, SearchProgress& work, std::vector<RefinementTrial>& trials)
      : settings_(settings),
        without_em_(without_em),
        states_(states),
        jumps_(std::move(jumps)),
        starts_(std::move(starts)),
        work_(work),
        trials_(trials),
        samples_(starts_.size()) {}

  // EM with the λ that is stated; without one, with those of a search.
  void run() {
    begin();
    if (settings_.em.period == 1)
      attempt(0.0);
    else if (settings_.stated)
      attempt(*settings_.stated);
    else
      search();
    finish(nullptr);
  }

  // EM with the λ of a search with more states, until it suffices. It is given up at the end of a stage that leaves it
  // no chance against them. After the first stages, it goes on if it does not suffice yet.
  void run_beside(const Search& more) {
    begin();
    bool excluded = false;
    attempt(more.chosen().smoothing,
            [&](const Attempt& now) { return (excluded = more.excludes(now)) || suffices_for(more); });
    if (excluded)
      attempts_.clear();
    else if (!suffices_for(more))
      finish(&more);
  }

  // Ends the first stages, after they sufficed beside more states.
  void complete() {
    begin();
    improve(attempts_.back(), [](const Attempt&) { return false; });
  }

  // Gives EM up if it is lost. Otherwise drops needless jumps, and lets the attempts go on. `more`: the search with
  // more states that these are to suffice for.
  void finish(const Search* more) {
    if (lost()) attempts_.clear();
    if (attempts_.empty() || shared() || raced_) return;
    drop_needless_jumps();
    race(more);
    raced_ = true;
  }

  Index states() const { return states_; }
  const std::vector<Index>& jumps() const { return jumps_; }
  // Are the errors smaller than those of the subspace models?
  bool helps() const { return !attempts_.empty() && chosen().error() < without_em_.error().value; }
  bool suffices_for(const Search& more) const {
    return !attempts_.empty() && chosen().error() < more.chosen().error() + std::log(most_uncertain) &&
           (shared() || advantage(chosen(), more.chosen()) > -noticeable);
  }

  // EM is used if it improves on the subspace models. If the best attempt does not, the attempt with the smallest
  // errors may.
  std::optional<RefinementOfFolds> improved() const {
    if (attempts_.empty()) return std::nullopt;
    for (const Attempt* a : {&chosen(), &least_error(attempts_)}) {
      const HeldOutError after = without_em_.errors(a->models, states_, settings_.ahead);
      if (!improves(*a, after)) continue;
      RefinementOfFolds result = without_em_.result();
      result.models = a->models;
      result.choice.states = states_;
      result.choice.smoothing = a->smoothing;
      result.choice.iterations = a->iterations;
      result.choice.error = a->error();
      result.choice.one_step = after.of_horizon(0);
      for (const Index step : jumps_) result.choice.jumps.push_back({step});
      result.choice.ahead = without_em_.certainty(a->models);
      return result;
    }
    return std::nullopt;
  }
  // The λ of the best attempt.
  std::optional<double> smoothing() const {
    return attempts_.empty() ? std::nullopt : std::optional(chosen().smoothing);
  }

 private:
  bool shared() const { return is_shared(settings_.em); }
  void begin() { work_.begin(words::plural(states_, "state")); }

  // Does EM predict clearly better than the subspace models, and not clearly worse by one step? EM that has spoiled its
  // start needs more iterations. From unknown initial states it may also be better in the first steps alone. `after`:
  // the errors after them.
  bool improves(const Attempt& attempt, const HeldOutError& after) const {
    const HeldOutError& before = without_em_.ahead();
    const double gain = before.value - after.value, from_start = without_em_.error().value - attempt.error();
    return after.of_horizon(0) <= before.of_horizon(0) + std::log(most_uncertain) &&
           gain >= -std::log(most_uncertain) && std::max(gain, from_start) >= std::log(worth_it);
  }

  // Is the attempt with fewer states surely worse than the one with the same λ and as many iterations? If steps share
  // their matrices, the errors decide, see chosen().
  bool excludes(const Attempt& fewer) const {
    const double enough = errors_to_give_up(without_em_.experiments());
    return std::any_of(attempts_.begin(), attempts_.end(), [&](const Attempt& own) {
      return same_smoothing(own.smoothing, fewer.smoothing) && own.iterations == fewer.iterations &&
             (shared() ? clearly_smaller(own.errors, fewer.errors, enough) : advantage(fewer, own) < -enough);
    });
  }

  // Beside another attempt after as many iterations.
  bool is_hopeless(const Attempt& now) const {
    return std::any_of(attempts_.begin(), attempts_.end(), [&](const Attempt& other) {
      return other.iterations == now.iterations && now.error() > other.error() + std::log(hopeless);
    });
  }

  // The attempt with the smallest errors of those whose likelihood does not differ significantly from the largest. With
  // few experiments, or noise that is not normal, the likelihood alone would decide too finely. If steps share their
  // matrices, there may be very few experiments. Their initial states would decide the likelihood, so the errors
  // decide.
  const Attempt& chosen() const {
    if (shared()) return least_error(attempts_);
    const Attempt* best = &likeliest(attempts_);
    for (const Attempt& a : attempts_)
      if (a.error() < best->error() && likely(a)) best = &a;
    return *best;
  }

  // Is its likelihood not significantly below the largest?
  bool likely(const Attempt& now) const { return advantage(now, likeliest(attempts_)) > -significant; }

  // Almost without noise, EM may spoil each start.
  bool lost() const {
    return !attempts_.empty() && least_error(attempts_).error() > without_em_.error().value + std::log(hopeless);
  }

  // Moves from λ to λ while the likelihood rises.
  void search() {
    double best = std::clamp(settings_.smoothing, first_least, first_most);
    Vector most = attempt(best);
    // The λ of the ARX model may be far from the best λ of EM. The likelihood may then have a second maximum.
    if (std::abs(std::log10(best / usual)) > 0.9)
      if (Vector found = attempt(usual); advantage(found, most) > noticeable) most = std::move(found), best = usual;
    if (!lost()) climb(best, std::move(most));
    approach_start();
  }

  // The likelihood may not change over half a decade and then rise again, so one larger λ that is not worse is passed
  // over.
  void climb(double best, Vector most) {
    for (const double factor : {half_decade, 1 / half_decade}) {
      Index moves = 0;
      bool flat = false;
      for (double next = best * factor; moves < most_moves && next < largest; next *= factor) {
        Vector found = attempt(next);
        const double gain = advantage(found, most);
        if (gain > noticeable) {
          most = std::move(found);
          flat = false;
          ++moves;
        } else if (factor < 1 || flat || gain < -noticeable) {
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
    if (attempts_.empty() || least_error(attempts_).error() <= without_em_.error().value) return;
    const auto weaker = [](const Attempt& a, const Attempt& b) { return a.smoothing < b.smoothing; };
    double smoothing = std::min_element(attempts_.begin(), attempts_.end(), weaker)->smoothing;
    for (Index moves = 0; moves < most_moves; ++moves) {
      const double least = least_error(attempts_).error();
      attempt(smoothing /= half_decade);
      if (!(least_error(attempts_).error() < least)) return;
    }
  }

  // Of jumps at two successive steps, the matrices need both only if the likelihood is significantly lower with one.
  void drop_needless_jumps() {
    for (size_t i = 0; i + 1 < jumps_.size();) {
      if (jumps_[i] + 1 != jumps_[i + 1]) {
        ++i;
        continue;
      }
      const double smoothing = chosen().smoothing;
      const Vector both = attempt(smoothing);
      const std::vector<Index> all = jumps_;
      std::optional<Attempt> best;
      std::vector<Index> needed;
      for (const size_t without : {i, i + 1}) {
        jumps_ = all;
        jumps_.erase(jumps_.begin() + std::ptrdiff_t(without));
        Attempt one = started(smoothing);
        while (one.iterations < first_end(options(smoothing))) one = refined(std::move(one));
        if (!best || one.sum() > best->sum()) best = std::move(one), needed = jumps_;
      }
      if (advantage(best->likelihood, both) > -significant) {
        jumps_ = std::move(needed);
        attempts_ = {std::move(*best)};
      } else {
        jumps_ = all;
        ++i;
      }
    }
  }

  // EM with this λ from the subspace models, unless it was tried before, in the first stages, see improve(). Returns
  // the largest likelihood with this λ.
  Vector attempt(double smoothing) {
    return attempt(smoothing, [&](const Attempt& now) { return jumps_.empty() && is_hopeless(now); });
  }
  template <class Ends>
  Vector attempt(double smoothing, Ends&& ends) {
    const auto same = [&](double other) { return same_smoothing(other, smoothing); };
    if (std::none_of(tried_.begin(), tried_.end(), same)) {
      tried_.push_back(smoothing);
      improve(started(smoothing), ends);
    }
    Vector most;
    for (const Attempt& a : attempts_)
      if (same(a.smoothing) && a.sum() > sum_of(most)) most = a.likelihood;
    return most;
  }

  // EM with this λ, before its first iteration.
  Attempt started(double smoothing) const {
    Attempt result;
    result.smoothing = smoothing;
    result.models = starts_;
    return result;
  }

  // Goes on with the first stages of an attempt, and keeps each, until one of them does not improve it, until EM has
  // converged, or until `ends` says so. If steps share their matrices, the errors alone tell, see chosen().
  template <class Ends>
  void improve(Attempt now, Ends&& ends) {
    for (bool better = true; better && !now.converged && now.iterations < first_end(options(now.smoothing));) {
      const double error = now.error(), likelihood = now.sum();
      now = refined(std::move(now));
      keep(now);
      better = now.error() < error || (!shared() && now.sum() > likelihood);
      if (ends(now)) return;
    }
  }

  // The attempts go on until EM converges, until neither the likelihood nor the errors of a likely attempt improve, or
  // until `most_iterations`. Before each stage, those are left out that are significantly less likely than another one
  // that goes on. `more`: attempts with fewer states are likely only if they are beside those with more.
  void race(const Search* more) {
    std::vector<Attempt> racing;
    for (const Attempt& a : attempts_)
      if (a.iterations == first_end(options(a.smoothing)) && !a.converged) racing.push_back(a);
    while (!racing.empty()) {
      const Attempt& most = likeliest(racing);
      std::vector<Attempt> improved;
      for (const Attempt& a : racing) {
        if (advantage(a, most) < -significant) continue;
        Attempt next = refined(a);
        keep(next);
        const bool better =
            next.sum() > a.sum() || (next.error() < a.error() && likely(next) && (!more || more->likely(next)));
        if (better && !next.converged && next.iterations < most_iterations) improved.push_back(std::move(next));
      }
      racing = std::move(improved);
    }
  }

  void keep(const Attempt& attempt) {
    if (std::isfinite(attempt.sum())) attempts_.push_back(attempt);
  }

  // After the next stage.
  Attempt refined(Attempt now) {
    const Stage stage = stage_after(now.iterations, shared());
    std::vector<Vector> likelihoods(starts_.size());
    std::vector<char> converged(starts_.size());
    without_em_.for_each_fold([&](size_t f) {
      Refinement fold = refined_fold(now.smoothing, stage, f, now.models[f]);
      now.models[f] = std::move(fold.model);
      converged[f] = fold.converged;
      if (now.models[f].steps() > 0)
        likelihoods[f] =
            log_likelihoods_with(without_em_.least_variance_of(f), now.models[f], settings_.data[f]->held_out);
    });
    const auto all = [](const auto& folds, auto&& holds) { return std::all_of(folds.begin(), folds.end(), holds); };
    now.likelihood.resize(0);
    if (all(likelihoods, [](const Vector& fold) { return fold.size() > 0; })) now.likelihood = stacked(likelihoods);
    now.converged = all(converged, [](char fold) { return fold != 0; });
    now.errors = without_em_.errors(now.models, states_, without_em_.from_start());
    now.iterations += stage.iterations;
    trials_.push_back({states_, now.smoothing, now.iterations, now.error(),
                       now.sum() / std::max(1.0, double(now.likelihood.size()))});
    return now;
  }

  static Vector stacked(const std::vector<Vector>& parts) {
    Vector whole;
    for (const Vector& part : parts) {
      whole.conservativeResize(whole.size() + part.size());
      whole.tail(part.size()) = part;
    }
    return whole;
  }

  // With an empty model if EM fails: this λ is ruled out.
  Refinement refined_fold(double smoothing, const Stage& stage, size_t f, const Model& start) {
    if (start.steps() == 0) return {};
    try {
      RefineOptions o = options(smoothing);
      o.execution.progress = work_.counted();
      return refined_in(stage, start, settings_.data[f]->training, samples_[f], o);
    } catch (const std::runtime_error&) {
      return {};
    }
  }

  RefineOptions options(double smoothing) const {
    RefineOptions o = settings_.em;
    o.smoothing = smoothing;
    o.jumps = jumps_;
    return o;
  }

  const RefinementSettings& settings_;
  const WithoutEm& without_em_;
  Index states_;
  std::vector<Index> jumps_;
  std::vector<Model> starts_;
  SearchProgress& work_;
  std::vector<RefinementTrial>& trials_;
  std::vector<std::optional<em::Data>> samples_;  // of the training data of each fold
  std::vector<Attempt> attempts_;                 // that did not fail
  std::vector<double> tried_;                     // λ of all attempts, also of those that failed
  bool raced_ = false;
};

}  // namespace

RefinementOfFolds choose_refinement(Index states, std::vector<Model> models, bool or_fewer, const FoldStarts& starts,
                                    const RefinementSettings& settings, SearchProgress& work) {
  const WithoutEm without_em(states, std::move(models), settings);
  std::vector<RefinementTrial> trials{{.states = states, .error = without_em.error().value}};
  const auto search = [&](Index n, const std::vector<Index>& jumps) {
    return std::make_shared<Search>(starts(n), n, jumps, without_em, settings, work, trials);
  };
  const std::shared_ptr<Search> plain = search(states, settings.em.jumps);
  plain->run();
  std::shared_ptr<Search> best = plain;
  if (or_fewer && plain->helps()) {
    std::set<Index> too_few;
    const auto suffice = [&](Index n) {
      if (n < 1 || too_few.contains(n)) return false;
      const std::shared_ptr<Search> fewer = search(n, best->jumps());
      fewer->run_beside(*plain);
      const bool does = fewer->suffices_for(*plain);
      if (does)
        best = fewer;
      else
        too_few.insert(n);
      return does;
    };
    Index few = 0;  // that do not suffice
    while (best->states() - few > 1) {
      const Index n = (few + best->states()) / 2;
      if (!suffice(n)) few = n;
    }
    // One number that does not suffice may split a pair of eigenvalues.
    while (suffice(best->states() - 1) || suffice(best->states() - 2)) continue;
  }
  if (best != plain) best->complete();
  best->finish(nullptr);
  std::optional<RefinementOfFolds> result = best->improved();
  if (!result && best != plain) result = plain->improved();
  if (!result) {
    result = without_em.result();
    if (plain->smoothing()) result->choice.smoothing = *plain->smoothing();
  }
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
    Stage stage = stage_after(from, is_shared(options));
    stage.iterations = std::min(stage.iterations, to - from);
    model = refined_in(stage, model, data, samples, options).model;
    from += stage.iterations;
  }
  return model;
}

Index next_stage_end(Index iterations) { return iterations + stage_after(iterations, false).iterations; }

bool stopped_early(Index iterations, const RefineOptions& options) { return iterations < first_end(options); }

}  // namespace tokid
