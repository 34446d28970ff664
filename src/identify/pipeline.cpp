// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/identify.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iterator>
#include <numeric>
#include <stdexcept>

#include "base/integers.hpp"
#include "base/rounding.hpp"
#include "base/statistics.hpp"
#include "base/words.hpp"
#include "choose/folds.hpp"
#include "data/axes.hpp"
#include "data/channel_sizes.hpp"
#include "data/check.hpp"
#include "diagnose/excitation.hpp"
#include "diagnose/outliers.hpp"
#include "diagnose/repeats.hpp"
#include "identify/identify_stretch.hpp"
#include "identify/realisation.hpp"
#include "model/judged.hpp"
#include "model/outlying_samples.hpp"
#include "tokid/dependence.hpp"
#include "tokid/markov.hpp"
#include "tokid/provenance.hpp"
#include "tokid/remarks.hpp"
#include "tokid/subspace.hpp"
#include "tokid/tvera.hpp"
#include "tokid/version.hpp"

namespace tokid {

namespace {

// Lag orders that a leave-one-out choice looks at.
constexpr Index most_lags = 16;
// Orders that a choice for noisy data looks at, and the experiments that it judges them by.
constexpr Index most_states = 16;
// Coefficients per output and step that a choice for noisy data looks at: its time grows with their cube.
constexpr Index most_regressors = 160;
constexpr Index most_judged = 64;
// Growth of the one-step error that a refined model is not allowed.
constexpr double spoilt = 1.1;
// Steps that the choices for noisy data look at.
constexpr Index most_judged_steps = 256;

void check_options(const IdentifyOptions& o) {
  static constexpr Index most = 1'000'000;
  const auto check_count = [](const char* name, Index value) {
    if (value < 0 || value > most)
      throw std::invalid_argument(fmt::format("{}: {} found, 1 to {} (or automatic) needed", name, value, most));
  };
  check_count("states", o.states);
  check_count("lags", o.lags);
  check_count("rows", o.rows);
  check_count("cols", o.cols);
  if (std::isnan(o.smoothing))
    throw std::invalid_argument(
        "smoothing: nan found, a number from 0 on, infinity or a negative one (automatic) needed");
  if (!(o.hold_out >= 0 && o.hold_out < 1))
    throw std::invalid_argument(fmt::format("hold-out fraction: {} found, 0 <= fraction < 1 needed", o.hold_out));
}

// Are the inputs of the steps k-p … k linearly dependent over the experiments, channels at rest left aside?
bool inputs_dependent(const Ensemble& e, Index k, Index p) {
  const std::vector<Index> rows = e.complete_rows(k, p);
  Matrix inputs(static_cast<Index>(rows.size()), (p + 1) * e.inputs());
  Index used = 0;
  for (Index j = k - p; j <= k; ++j)
    for (Index i = 0; i < e.inputs(); ++i) {
      const Vector u = e.input(j).col(i)(rows);
      if (u.norm() > 0) inputs.col(used++) = u / u.norm();
    }
  if (inputs.rows() < used) return false;  // too few experiments is another matter
  const Matrix zero = Matrix::Zero(inputs.rows(), 1);
  return linalg::minimum_norm(inputs.leftCols(used), zero, 1e-12).rank < used;
}

// Windows of p+1 steps without a gap.
Index whole_windows(const Ensemble& e, Index lags) {
  if (e.missing() == 0) return e.experiments() * std::max<Index>(0, e.steps() - lags);
  Index whole = 0;
  for (Index k = lags; k < e.steps(); ++k) whole += Index(e.complete_rows(k, lags).size());
  return whole;
}

// Steps that share a model depart from one motion: those of the first period stand for all.
void count_in_phases(NominalTest& test, Index period) {
  for (NominalTest::Departure& departure : test.departures) {
    std::vector<Index>& steps = departure.steps;
    for (Index& k : steps) k %= period;
    std::sort(steps.begin(), steps.end());
    steps.erase(std::unique(steps.begin(), steps.end()), steps.end());
  }
}

// The pipeline with its intermediate results.
class Pipeline {
 public:
  Pipeline(const Ensemble& ensemble, const IdentifyOptions& options) : options_(options), data_(&ensemble) {}
  Pipeline(Ensemble&& ensemble, const IdentifyOptions& options)
      : options_(options), data_(&own_), own_(std::move(ensemble)) {}
  Pipeline(const Pipeline&) = delete;
  Pipeline& operator=(const Pipeline&) = delete;

  // `measured`: what single experiments are named by; none: nothing is said of single ones. `rows` are theirs there.
  Identification run(bool validated, const Ensemble* measured, const std::vector<Index>& rows = {});
  Stretch run_settled(const Settled& settled, Index keep_begin, Index keep_end, bool first);

 private:
  void hold_out();
  void remove_nominal();
  void check_method() const;
  bool regress_each_step();
  bool windows_are_scarce(const Ensemble& e) const;
  void check_windows();
  void regress_together();
  void choose_lags();
  void check_size() const;
  std::vector<Index> lag_candidates(const Ensemble& e, InitialState initial, Index period) const;
  const Ensemble& judged() const;
  void decide_initial_state();
  Model completed(Model model) const;
  Index choose_states(const Markov& parameters, const HankelFactors& factors, TveraOptions o);
  Model tvera_model();
  std::vector<Weighting> weightings(const Ensemble& measure) const;
  Folds folds() const;
  Model subspace_model();
  template <class Make>
  Model refined_as_chosen(Model plain, SubspaceOptions& o, Make&& make);
  RefineOptions refine_options() const;
  void realise_model();
  RegressionSurvey survey_regressions(Index begin, Index end) const;
  void warn_of_freedom();
  void warn_of_regressions();
  std::vector<Index> warn_of_excitation(const std::vector<Index>& suspects);
  std::vector<std::string> warn_of_experiments(const Ensemble& whole, const Ensemble& measured,
                                               const std::vector<Index>& rows);
  void warn_of_states();
  void choose_frame();
  void evaluate(std::vector<std::string> misfits, const Ensemble* measured);

  Index experiments_for(Index lags) const {
    return minimum_experiments(data_->inputs(), data_->outputs(), lags) + (nominal_ ? 1 : 0);
  }
  // Has a mean motion been removed that every experiment had its part in?
  bool centred() const { return nominal_ && options_.period == 0; }
  // Experiments less the one that the mean motion costs.
  Index effective_experiments() const { return data_->experiments() - (nominal_ ? 1 : 0); }
  Index step_count() const { return static_cast<Index>(arx_.step.size()); }
  const GtvArxStep& step(Index k) const { return arx_.step[size_t(k)]; }
  void warn(std::string text) { result_.warnings.push_back(std::move(text)); }
  Execution share(double from, double to) const { return tokid::share(options_.execution, from, to); }

  const IdentifyOptions& options_;
  const Ensemble* data_;  // the caller's, or own_ once something of it is changed
  Ensemble own_, held_out_;
  mutable std::optional<Ensemble> judged_;
  std::optional<Nominal> nominal_;
  bool together_ = false;             // all steps in one regression
  const Settled* settled_ = nullptr;  // choices that are made already
  bool from_full_dimension_ = true;   // models of unknown initial states begin where all of the state is seen
  InitialState initial_ = InitialState::zero;
  GtvArx arx_;
  Identification result_;
};

void Pipeline::hold_out() {
  if (options_.hold_out == 0) return;
  Split parts = split(*data_, options_.hold_out, options_.period);
  own_ = std::move(parts.training);
  data_ = &own_;
  held_out_ = std::move(parts.held_out);
  result_.held_out = true;
}

void Pipeline::remove_nominal() {
  if (options_.nominal == NominalChoice::none) return;
  if (options_.nominal == NominalChoice::automatic) {
    result_.nominal_test = test_nominal(options_.period > 0 ? judged() : *data_);
    judged_.reset();
    if (options_.period > 0) count_in_phases(result_.nominal_test, options_.period);
    if (!result_.nominal_test.significant) return;
  }
  if (data_->experiments() < 2 && options_.period == 0)
    throw std::invalid_argument("nominal: one experiment has no mean motion to depart from, at least 2 needed");
  nominal_ = nominal_trajectory(*data_);
  if (options_.period > 0) share_phases(*nominal_, options_.period);
  if (data_ != &own_) own_ = *data_;
  own_ = departures(std::move(own_), *nominal_);
  data_ = &own_;
  // Free responses share a nominal motion of their own; its departures are free responses too.
  FreeResponse& free = own_.free;
  if (free.experiments == 1) {
    warn("a single free response has no mean motion to depart from: it was not used");
    free = {};
  } else if (free.experiments > 1) {
    free = complete(free);
    free.y.rowwise() -= Eigen::RowVectorXd(free.y.colwise().mean());
  }
}

// What orders and weights are judged by: the experiments, of long ones a stretch in the middle; or, where they are too
// few and their steps share a model, stretches of them.
const Ensemble& Pipeline::judged() const {
  const Index period = options_.period, pieces = ceil_div(5, data_->experiments()), steps = data_->steps();
  if (!judged_ && period == 0 && steps > 2 * most_judged_steps)
    judged_ = stretch(*data_, (steps - most_judged_steps) / 2, (steps + most_judged_steps) / 2);
  if (!judged_ && period > 0 && pieces > 1 && steps / pieces >= 2 * std::max(period, options_.lags))
    judged_ = cut(*data_, steps / pieces / period * period);
  return judged_ ? *judged_ : *data_;
}

void Pipeline::check_method() const {
  const bool tvera = options_.method == Method::tvera;
  if (tvera && options_.period > 0)
    throw std::invalid_argument("method: tvera found, subspace needed to pool the steps of a period");
  if (tvera && options_.smoothing > 0)
    throw std::invalid_argument("method: tvera found, subspace needed for regularisation over time");
  if (tvera && options_.weighting) throw std::invalid_argument("method: tvera found, subspace needed for a weighting");
  if (tvera && options_.refine.value_or(false))
    throw std::invalid_argument(
        "method: tvera found, subspace needed for a refinement as far as it helps; refine() goes on from any model");
  if (options_.period == 1 && options_.smoothing >= 0 && !std::isinf(options_.smoothing))
    throw std::invalid_argument(
        fmt::format("smoothing: {} found, none needed where one model serves all steps", options_.smoothing));
  if (options_.period > 1 && options_.period >= data_->steps())
    throw std::invalid_argument(
        fmt::format("period: {} found, less than the {} steps of the data needed", options_.period, data_->steps()));
  const Index most = std::max<Index>(1, data_->steps() - 1) * data_->outputs();
  if (options_.states > most)
    throw std::invalid_argument(fmt::format("states: {} found, {} steps of {} show at most {}", options_.states,
                                            data_->steps(), words::plural(data_->outputs(), "output"), most));
  if (options_.weighting == Weighting::projection && options_.period == 0)
    throw std::invalid_argument("weighting: projection found, needs --time-invariant or --period P to pool steps");
  if (!tvera && options_.period == 0 && options_.smoothing < 0 && data_->experiments() < 2)
    throw std::invalid_argument(
        "experiments: 1 found, at least 2 needed to see how a system varies in time (one record is enough where it is "
        "time-invariant or periodic, if that is stated)");
}

// A regression for each step alone, where the experiments suffice: the paper's, and all that data without noise need.
bool Pipeline::regress_each_step() {
  const Index needed = options_.lags > 0     ? options_.lags
                       : options_.states > 0 ? ceil_div(options_.states, data_->outputs())
                                             : 1;
  const bool together = options_.period > 0 || options_.smoothing > 0;
  if (options_.method != Method::tvera && (together || data_->experiments() < experiments_for(needed))) return false;
  const size_t warnings = result_.warnings.size();
  choose_lags();
  check_size();
  GtvArxOptions arx_options;
  arx_options.lags = {result_.lags};
  arx_options.spent = nominal_ ? 1 : 0;
  arx_options.execution = share(0.1, 0.4);
  arx_ = gtv_arx(*data_, arx_options);
  decide_initial_state();
  if (initial_ == InitialState::unknown) {
    // The regressions of the steps k ≥ p hold whatever the initial state is; the others are of no use.
    arx_.begin_at(result_.lags);
  }
  warn_of_regressions();
  // Regressions that fit any data exactly are no sign of data without noise, unless somebody chose their order.
  Index freedom = 0;
  for (const GtvArxStep& s : arx_.step) freedom += s.freedom;
  const bool judged = freedom > 0 || (data_->missing() == 0 && (options_.lags > 0 || options_.states > 0));
  if (options_.method == Method::tvera || (!result_.noisy && judged)) return true;
  // With noise, steps that share what they know do better: what these regressions lack is of no consequence.
  result_.warnings.resize(warnings);
  result_.condition_max = 0.0;
  result_.rank_deficient_steps = 0;
  result_.lag_order_errors = {};
  if (freedom == 0) arx_ = {};  // what fits any data says nothing of initial states either
  return false;
}

// What the steps leave to be judged, from unknown initial states on, must be half of them, and the windows without a
// gap twice as many as the unknowns. Steps that nothing couples need a degree of freedom each.
std::vector<Index> Pipeline::lag_candidates(const Ensemble& e, InitialState initial, Index period) const {
  if (options_.lags > 0) return {options_.lags};
  const Index needed = options_.states > 0 ? ceil_div(options_.states, data_->outputs()) : 1;
  const Index first = first_judged(initial, 1, period);
  const bool coupled = period > 0 || options_.smoothing != 0;
  std::vector<Index> candidates;
  for (const Index p : {1, 2, 3, 4, 6, 8, 12, 16, 24, 36, 48})
    if (const Index unknowns = minimum_experiments(data_->inputs(), data_->outputs(), p);
        p >= needed && 2 * std::max<Index>(1, first) * p < e.steps() && p + period <= e.steps() &&
        (candidates.empty() || unknowns <= most_regressors) && whole_windows(e, p) >= 2 * unknowns &&
        (coupled || unknowns < effective_experiments()))
      candidates.push_back(p);
  if (candidates.empty()) candidates.push_back(needed);
  return candidates;
}

bool Pipeline::windows_are_scarce(const Ensemble& e) const {
  constexpr double enough = 0.5;
  return e.missing() > 0 &&
         double(whole_windows(e, result_.lags)) < enough * double(e.experiments() * (e.steps() - result_.lags));
}

// Without as many windows as unknowns any model fits.
void Pipeline::check_windows() {
  const Index needed = minimum_experiments(data_->inputs(), data_->outputs(), result_.lags);
  const Index whole = whole_windows(*data_, result_.lags);
  const std::string found = fmt::format("{} of {} successive steps {}", words::plural(whole, "window"),
                                        result_.lags + 1, data_->missing() > 0 ? "without a gap found" : "found");
  if (whole < needed)
    throw std::invalid_argument(
        fmt::format("{}: {}, at least {} needed at lag order {}{}", data_->missing() > 0 ? "missing samples" : "steps",
                    found, needed, result_.lags,
                    result_.lags > 1 ? "; a smaller one takes fewer"
                                     : "; EM from a model of other data (refine) needs no windows"));
  if (whole < 2 * needed)
    warn(fmt::format("{}, which are few for the {} unknowns per output at lag order {}: judge the model by other data",
                     found, needed, result_.lags));
}

// All steps in one regression, coupled over time; p and λ by errors on experiments left out.
void Pipeline::regress_together() {
  together_ = true;
  const Ensemble& measure = judged();
  const bool decided = options_.initial_state || data_->initial_state || !arx_.step.empty();
  if (arx_.step.empty() && decided) decide_initial_state();
  SmoothingOptions o;
  o.period = options_.period;
  o.initial_state = decided && &measure == data_ ? initial_ : InitialState::unknown;
  o.lags = lag_candidates(measure, o.initial_state, o.period);
  o.smoothing = options_.smoothing;
  o.centred = centred();
  o.execution = share(0.4, 0.6);
  const Index regressors = minimum_experiments(data_->inputs(), data_->outputs(), o.lags.back());
  o.folds = regressors > 100 ? 3 : fold_count(measure.experiments());
  o.steps = std::clamp<Index>(Index{256} * 60 * 60 / (regressors * regressors), 64, 256);
  if (o.lags.back() >= measure.steps())
    throw std::invalid_argument(fmt::format("steps: {} found, lag order {} needs at least {}", measure.steps(),
                                            o.lags.back(), o.lags.back() + 1));
  if (options_.choices) {
    result_.lags = o.lags.front();
    result_.variation = options_.choices->variation;
  } else if (measure.experiments() > 1) {
    result_.smoothing_choice = choose_smoothing(measure, o);
    result_.lags = result_.smoothing_choice.lags;
    result_.variation.smoothing = result_.smoothing_choice.smoothing;
  } else {
    result_.lags = o.lags.front();
    result_.variation.smoothing = options_.smoothing >= 0 ? options_.smoothing : options_.period > 1 ? 1.0 : 0.0;
    if (options_.smoothing < 0 && options_.period > 1) warn("the record is too short to choose lambda by: 1 was taken");
  }
  // A few windows without a gap are too few to see variation by; EM, which sees every sample, looks for λ itself.
  if (options_.smoothing < 0 && !options_.choices && std::isinf(result_.variation.smoothing) &&
      windows_are_scarce(measure)) {
    result_.variation.smoothing = 1e3;
    warn(
        "missing samples leave few windows to see variation in time by: lambda = 1000 was taken, and is chosen anew for "
        "EM");
  }
  if (!options_.choices) result_.variation.period = options_.period;
  if (std::isinf(result_.variation.smoothing) || options_.period == 1) {
    if (options_.period == 0 && options_.smoothing < 0)
      warn("the experiments show no variation in time: one model serves all steps");
    result_.variation = {0.0, 1};
    // All steps together bear more lags than each of them does.
    if (options_.period == 0 && measure.experiments() > 1) {
      o.period = 1;
      o.lags = lag_candidates(measure, o.initial_state, o.period);
      SmoothingChoice constant = choose_smoothing(measure, o);
      result_.lags = constant.lags;
      for (SmoothingTrial& trial : constant.trials) {
        trial.smoothing = std::numeric_limits<double>::infinity();
        result_.smoothing_choice.trials.push_back(trial);
      }
    }
  }
  check_windows();
  result_.min_experiments = experiments_for(result_.lags);
  if (result_.variation.period == 0 && result_.variation.smoothing == 0) warn_of_freedom();

  SmoothArxOptions arx_options;
  arx_options.lags = result_.lags;
  arx_options.variation = result_.variation;
  arx_options.execution = share(0.6, 0.7);
  if (!decided && result_.variation.period > 0) {
    // Steps share their residuals, so that none tells of the start.
    initial_ = result_.initial_state_test.decision = InitialState::unknown;
    result_.initial_state_test.reason = "not stated with the data";
  } else if (!decided) {
    arx_ = smooth_arx(*data_, arx_options);
    for (GtvArxStep& s : arx_.step) s.freedom = s.rows;
    decide_initial_state();
  }
  arx_options.initial_state = initial_;
  arx_ = smooth_arx(*data_, arx_options);
  double residual = 0.0, square = 0.0;
  for (Index k = arx_.k_begin; k < step_count(); ++k) {
    residual += arx_.residual_cov(k).trace();
    square += arx_.output_rms(k).squaredNorm();
  }
  // As many unknowns as windows leave no residual of any noise.
  const Index models = result_.variation.smoothing > 0 ? 1 : result_.variation.groups(data_->steps());
  result_.noisy =
      residual > rounding_share * rounding_share * square ||
      whole_windows(*data_, result_.lags) <=
          models * (minimum_experiments(data_->inputs(), data_->outputs(), result_.lags) + data_->outputs());
}

void Pipeline::choose_lags() {
  const Index r = data_->inputs(), m = data_->outputs();
  const Index needed = options_.states > 0 ? ceil_div(options_.states, m) : 1;  // p·m ≥ n
  result_.lags = options_.lags;
  if (options_.lags == 0) {
    LagOrderOptions lag_options;
    lag_options.p_min = needed;
    // An order is judged by what is left over: at least one degree of freedom.
    const Index judged = largest_lag_order(effective_experiments() - 1, r, m);
    lag_options.p_max = std::min({most_lags, judged, (data_->steps() - 1) / 2});
    lag_options.execution = share(0.0, 0.1);
    result_.lags = needed;
    if (lag_options.p_max >= needed && lag_options.p_max >= 1) {
      result_.lag_order_errors = lag_order_errors(*data_, lag_options);
      result_.lags = result_.lag_order_errors.best;
      if (result_.lags == lag_options.p_max && lag_options.p_max == judged && judged < most_lags)
        warn(fmt::format(
            "lag order {} is the largest that {} experiments can judge: more experiments, or a larger order "
            "that is stated, may do better",
            judged, data_->experiments()));
    } else if (judged < needed && data_->experiments() >= experiments_for(needed)) {
      warn(fmt::format("{} experiments leave no degree of freedom to judge lag order {} by: it fits any data exactly",
                       data_->experiments(), needed));
    }
  }
  result_.min_experiments = experiments_for(result_.lags);
}

void Pipeline::check_size() const {
  const Index r = data_->inputs(), m = data_->outputs(), p = result_.lags, found = data_->experiments();
  if (found < result_.min_experiments) {
    const Index would_do = largest_lag_order(effective_experiments(), r, m);
    throw std::invalid_argument(fmt::format(
        "experiments: {} found, lag order {} with {} inputs and {} outputs needs at least {} (r + p(r+m){}); {}{}",
        found, p, r, m, result_.min_experiments, nominal_ ? " + 1 for the mean motion" : "",
        would_do > 0 ? fmt::format("{} would do for lag orders up to {}", found, would_do)
                     : fmt::format("no lag order will do, {} are needed for lag order 1", experiments_for(1)),
        options_.method == Method::tvera ? "; steps that share what they know need fewer (not --method tvera)" : ""));
  }
  if (data_->steps() < p + 1)
    throw std::invalid_argument(
        fmt::format("steps: {} found, lag order {} needs at least {}", data_->steps(), p, p + 1));
}

void Pipeline::decide_initial_state() {
  const Index p = result_.lags, m = data_->outputs(), last = step_count();
  InitialStateTest& test = result_.initial_state_test;
  const auto decide = [&](InitialState state, std::string reason) {
    initial_ = test.decision = state;
    test.reason = std::move(reason);
  };
  if (options_.initial_state) return decide(*options_.initial_state, "as asked");
  if (data_->initial_state) return decide(*data_->initial_state, "as the data say");

  // Residuals of the steps p … that the initial state can't reach, against those of the steps before p.
  Vector later = Vector::Zero(m), square = Vector::Zero(m);
  Index freedom = 0;
  for (Index k = p; k < std::min(last, p + std::max<Index>(10, 3 * p)); ++k) {
    freedom += step(k).freedom;
    later += double(step(k).freedom) * arx_.residual_cov(k).diagonal();
  }
  for (Index k = 0; k < last; ++k) square = square.cwiseMax(arx_.output_rms(k).cwiseAbs2());
  if (freedom > 0) later /= double(freedom);
  later = later.cwiseMax(rounding_share * rounding_share * square);

  test.threshold = std::numeric_limits<double>::infinity();
  for (Index k = 0; k < std::min(p, last); ++k) {
    const Index own = step(k).freedom;
    if (own <= 0) continue;
    for (Index j = 0; j < m; ++j) {
      if (!(later(j) > 0)) continue;
      const double ratio = arx_.residual_cov(k)(j, j) / later(j);
      const double threshold =
          freedom > 0 ? statistics::f_quantile(1 - 0.001 / double(p * m), double(own), double(freedom)) : 1.0;
      // The pair that comes closest to, or goes furthest beyond, its threshold speaks for all.
      if (std::isinf(test.threshold) || ratio / threshold > test.statistic / test.threshold) {
        test.statistic = ratio;
        test.threshold = threshold;
      }
    }
  }
  const bool reached = test.statistic > test.threshold;
  if (freedom > 0)
    decide(
        reached ? InitialState::unknown : InitialState::zero,
        fmt::format("residual variance of the steps before {} is {:.3g} times that of the later ones, threshold {:.3g}",
                    p, test.statistic, test.threshold));
  else if (reached)
    decide(InitialState::unknown,
           "the first steps leave residuals, and no degree of freedom tells noise from initial states");
  else
    decide(InitialState::zero, "the first steps leave no residual");
}

// With all that the regressions tell, from the first usable step on.
Model Pipeline::completed(Model model) const {
  model.dt = data_->dt;
  model.names = data_->names;
  model.initial_state = initial_;
  note_regressions(arx_, model);
  // A state that is not zero at the start can be followed only from where all of it is seen.
  if (initial_ == InitialState::unknown && model.states() > 0 && from_full_dimension_)
    model = from_step(model, model.full_begin());
  return model;
}

// Singular values of noisy data show no rank; what counts is how well the model predicts with the outputs and without.
Index Pipeline::choose_states(const Markov& parameters, const HankelFactors& factors, TveraOptions o) {
  OrderScores& scores = result_.order_scores;
  std::optional<Ensemble> fewer;
  if (data_->experiments() > most_judged) {
    std::vector<Index> rows;
    for (Index n = 0; n < most_judged; ++n) rows.push_back(n * data_->experiments() / most_judged);
    fewer = data_->subset(rows);
  }
  const Ensemble& judged = fewer ? *fewer : *data_;
  // The training errors of an order are too small by about its share of coefficients in the samples.
  scores.price = 2.0 / 3 * double(data_->channels()) / double(data_->outputs() * data_->experiments());
  const Index most = std::min({result_.lags * data_->outputs(), o.cols * data_->inputs(), most_states});
  for (Index n = 1; n <= most; ++n) {
    o.states = n;
    Model model = completed(realise(parameters, factors, o));
    if (model.steps() == 0 || model.states() < n) break;
    const Errors e =
        errors_of(computed_by(std::move(model), judged, initial_, first_judged(initial_, result_.lags, 0)), judged);
    scores.add(n, e.one_step, e.ahead, e.simulation);
  }
  scores.choose();
  return scores.best;
}

Model Pipeline::tvera_model() {
  const Index m = data_->outputs(), r = data_->inputs(), n = options_.states, p = result_.lags;
  TveraOptions o = tvera_options(options_, p, m, result_.noisy);
  o.output_size = settled_ ? settled_->output_size : channel_sizes(*data_, data_->inputs(), m);
  o.input_size = settled_ ? settled_->input_size : channel_sizes(*data_, 0, r);
  o.execution = share(0.7, 0.8);
  const Markov parameters = markov(arx_, o.rows + o.cols - 1, share(0.6, 0.7));
  arx_.forget_noise_shapes();
  if (n > 0 || !result_.noisy) {
    o.states = n;
    return completed(tvera(parameters, data_->free, o));
  }
  const HankelFactors factors = hankel_factors(parameters, data_->free, o);
  o.execution.progress = {};
  o.states = choose_states(parameters, factors, o);
  return completed(realise(parameters, factors, o));
}

// What to choose from: projections need as many windows of twice the length as these have samples.
std::vector<Weighting> Pipeline::weightings(const Ensemble& measure) const {
  if (options_.weighting) return {*options_.weighting};
  std::vector<Weighting> result = {Weighting::one_step};
  const Index period = result_.variation.period, p = result_.lags;
  if (period == 0) return result;
  result.push_back(Weighting::many_steps);
  const Index windows = measure.steps() - 2 * p - period + 1;
  if (windows > 0 && measure.experiments() * windows / period > 2 * p * measure.channels())
    result.push_back(Weighting::projection);
  return result;
}

Folds Pipeline::folds() const {
  const Ensemble& measure = judged();
  return Folds(measure, {.lags = result_.lags,
                         .initial_state = judged_ ? InitialState::unknown : initial_,
                         .variation = result_.variation,
                         .weightings = weightings(measure),
                         .centred = centred(),
                         .threads = options_.execution.threads});
}

RefineOptions Pipeline::refine_options() const {
  RefineOptions o;
  o.period = result_.variation.period;
  o.initial_state = initial_;
  o.execution.threads = options_.execution.threads;
  return o;
}

// Subspace realisation, and EM as far as it does good.
Model Pipeline::subspace_model() {
  SubspaceOptions o;
  o.states = options_.states;
  o.variation = result_.variation;
  o.noisy = result_.noisy;
  o.weighting = options_.weighting.value_or(Weighting::one_step);
  o.execution = share(0.7, 0.8);
  const auto make = [&] {
    return tokid::subspace_model(*data_, arx_, predictor_factors(*data_, arx_, o), o, initial_, from_full_dimension_);
  };
  if (options_.choices && together_) {
    const NoisyChoices& held = *options_.choices;
    o.weighting = held.weighting;
    o.state_smoothing = held.state_smoothing;
    result_.refinement.smoothing = held.refinement_smoothing;
    result_.refinement.iterations = held.refinement_iterations;
    result_.choices = held;
    return refined(make(), *data_, result_.refinement, refine_options());
  }
  if (!result_.noisy || !together_ || judged().experiments() < 2) {
    if (together_) result_.state_smoothing = SubspaceOptions::state_share * result_.variation.smoothing;
    return make();
  }
  const Folds parts = folds();
  const Index most = std::min(result_.lags * data_->outputs(), most_states);
  result_.order_scores = parts.choose_states(o.states, most);
  o.state_smoothing = result_.state_smoothing = result_.order_scores.smoothing;
  o.weighting = result_.order_scores.weighting;
  if (o.states == 0) o.states = result_.order_scores.best;
  Model plain = make();
  o.execution.progress = {};
  if (!options_.refine.value_or(true) || plain.states() == 0 || plain.states() < o.states) return plain;
  // A penalty of the ARX model is not one of EM, but none is none.
  const std::optional<double> stated = options_.smoothing == 0 ? std::optional(0.0) : std::nullopt;
  RefinementChoice& choice = result_.refinement;
  choice = parts.choose_refinement(o.states, result_.order_scores, stated);
  if (choice.iterations == 0) return plain;
  // Windows without a gap may be too few to show all states; EM sees every sample.
  if (options_.states == 0)
    choice = parts.reconsider_states(std::move(choice), result_.order_scores,
                                     windows_are_scarce(judged()) ? most : o.states, stated);
  o.states = choice.states;
  return refined_as_chosen(std::move(plain), o, make);
}

// What EM does with all experiments need not be what it did with those of the folds: then it predicts them worse than
// the models of the folds predicted experiments that they had not seen. And it sees one step only: a model of many
// samples for each coefficient must not lose over more steps what it wins there.
template <class Make>
Model Pipeline::refined_as_chosen(Model plain, SubspaceOptions& o, Make&& make) {
  const Index first = first_judged(initial_, result_.lags, result_.variation.period);
  const double allowed = std::log(spoilt);
  const Computed start = computed_by(plain, *data_, initial_, first);
  const Errors before = errors_of(start, *data_);
  RefinementChoice& choice = result_.refinement;
  // From the subspace model that is as smooth as those of the folds were; if that leads astray, from the plain one.
  std::vector<double> starts{choice.smoothing};
  if (result_.state_smoothing != choice.smoothing) starts.push_back(result_.state_smoothing);
  bool one_step = true;
  Errors best = before;
  std::optional<Model> fallback;
  double fallback_smoothing = 0.0;
  for (const double smoothing : starts) {
    o.state_smoothing = smoothing;
    Model likelier;
    try {
      likelier = refined(make(), *data_, choice, refine_options());
    } catch (const std::runtime_error&) {
      continue;  // hopeless from there
    }
    const Errors after = errors_of(computed_by(likelier, *data_, initial_, first), *data_, &start);
    const bool longer = after.ahead <= before.ahead + allowed && after.simulation <= before.simulation + allowed;
    one_step = after.one_step <= choice.one_step + allowed;
    if (!longer && result_.variation.period > 0) continue;
    if (one_step) {
      result_.state_smoothing = smoothing;
      return likelier;
    }
    if (after.one_step < best.one_step && after.mean() < best.mean() - allowed) {
      best = after;
      fallback = std::move(likelier);
      fallback_smoothing = smoothing;
    }
  }
  if (fallback) {
    warn("EM predicts all experiments worse than it predicted those left out: it may have gone astray");
    result_.state_smoothing = fallback_smoothing;
    return *std::move(fallback);
  }
  warn(fmt::format("the refinement by EM was left out: with all experiments it made the {} worse",
                   one_step ? "simulations" : "predictions"));
  choice.iterations = 0;
  choice.states = result_.order_scores.best;
  choice.error = choice.trials.front().error;
  return plain;
}

void Pipeline::realise_model() {
  const bool exact = !result_.noisy && initial_ == InitialState::zero && !together_;
  const bool tvera =
      settled_ ? settled_->tvera : options_.method == Method::tvera || (options_.method == Method::automatic && exact);
  Model& model = result_.model;
  model = tvera ? tvera_model() : subspace_model();
  if (!tvera && data_->free.experiments > 0)
    warn(fmt::format("{} left aside: the subspace realisation needs none; --method tvera takes them",
                     data_->free.experiments == 1
                         ? "the free response was"
                         : fmt::format("the {} free responses were", data_->free.experiments)));
  if (model.states() == 0)
    warn("no state was found: the outputs answer to the inputs of the same step alone, or not at all");
  if (nominal_) {
    model.u_nominal = nominal_->u;
    model.y_nominal = nominal_->y;
  }
}

RegressionSurvey Pipeline::survey_regressions(Index begin, Index end) const {
  RegressionSurvey survey;
  for (Index k = std::max(begin, arx_.k_begin); k < end; ++k) {
    const Index regressors = arx_.regressors(k);
    survey.condition_max = std::max(survey.condition_max, step(k).condition);
    if (step(k).rank < regressors) ++survey.rank_deficient;
    if (step(k).condition > ill_conditioned) survey.ill.push_back(k);
    if (step(k).rows - (nominal_ ? 1 : 0) < regressors)
      survey.starved.push_back(k);
    else if (step(k).rank < regressors && k >= result_.lags && inputs_dependent(*data_, k, step(k).lags))
      survey.unexcited.push_back(k);
    survey.freedom += step(k).freedom;
    survey.residual += arx_.residual_cov(k).trace();
    survey.square += arx_.output_rms(k).squaredNorm();
  }
  return survey;
}

// Of regressions that nothing couples, although they are done together.
void Pipeline::warn_of_freedom() {
  const RegressionSizes sizes{data_->experiments(), effective_experiments(), data_->inputs(), data_->outputs(),
                              result_.lags};
  RegressionSurvey survey;
  survey.freedom =
      std::max<Index>(0, sizes.effective_experiments - minimum_experiments(sizes.inputs, sizes.outputs, sizes.lags));
  for (std::string& text : warnings_of(survey, sizes, true)) warn(std::move(text));
}

void Pipeline::warn_of_regressions() {
  RegressionSurvey survey = survey_regressions(0, step_count());
  result_.condition_max = survey.condition_max;
  result_.rank_deficient_steps = survey.rank_deficient;
  result_.noisy = survey.noisy();
  const std::vector<Index> named = warn_of_excitation(survey.unexcited);
  std::erase_if(survey.unexcited, [&](Index k) { return std::binary_search(named.begin(), named.end(), k); });
  for (std::string& text : warnings_of(
           survey, {data_->experiments(), effective_experiments(), data_->inputs(), data_->outputs(), result_.lags},
           result_.noisy))
    warn(std::move(text));
}

// The steps that were spoken of.
std::vector<Index> Pipeline::warn_of_excitation(const std::vector<Index>& suspects) {
  Excitation found = excitation(*data_, {.lags = result_.lags,
                                         .period = options_.period,
                                         .centred = options_.period == 0 || nominal_,
                                         .noisy = result_.noisy,
                                         .shared = together_ && options_.period == 0,
                                         .suspects = suspects});
  for (std::string& text : found.warnings) warn(std::move(text));
  return std::move(found.named);
}

// Single experiments: those that repeat others, those with a stuck sensor, and those that do not fit the others.
// Returns their names, or rows where they have none.
std::vector<std::string> Pipeline::warn_of_experiments(const Ensemble& whole, const Ensemble& measured,
                                                       const std::vector<Index>& rows) {
  const bool exact = !result_.noisy && initial_ == InitialState::zero;
  const Index r = whole.inputs(), p = result_.lags;
  // From unknown initial states, and with noise, states vary without the inputs.
  const Index needed = options_.period > 0 ? 0
                       : together_         ? r + result_.model.states()
                       : exact             ? experiments_for(p)
                                           : r * (p + 1);
  for (std::string& text : warnings_of_repeats(whole, needed, p)) warn(std::move(text));
  StuckOutputs stuck = stuck_outputs(measured);
  for (std::string& text : stuck.warnings) warn(std::move(text));
  const OutlierOptions o{.lags = p,
                         .nominal = nominal_.has_value(),
                         .at_rest = initial_ == InitialState::zero,
                         .threads = options_.execution.threads,
                         .period = result_.variation.period,
                         .model = &result_.model};
  result_.outliers = result_.noisy ? outliers(whole, o) : outliers_without_noise(whole, o);
  if (!rows.empty())
    for (Outlier& outlier : result_.outliers) {
      outlier.experiment = rows[size_t(outlier.experiment)];
      outlier.name = measured.experiment_name(outlier.experiment);
    }
  for (std::string& text : warnings_of(result_.outliers, stuck.experiments)) warn(std::move(text));
  std::vector<std::string> misfits;
  for (const Index n : stuck.experiments) misfits.push_back(measured.experiment_label(n));
  for (const Outlier& outlier : result_.outliers) misfits.push_back(measured.experiment_label(outlier.experiment));
  return misfits;
}

void Pipeline::warn_of_states() {
  const Model& model = result_.model;
  const Index unknowns = model.states() + model.inputs;
  if (together_ && result_.variation.period == 0 && result_.variation.smoothing > 0 && data_->experiments() < unknowns)
    warn(
        fmt::format("{} are fewer than the {} unknowns of a row of A and B, or C and D, at every step: the penalty on "
                    "variation stands in for what they don't show; judge the model by other data",
                    words::plural(data_->experiments(), "experiment"), unknowns));
  if (options_.states > 0 && model.states() < options_.states)
    warn(fmt::format("{} states asked for, but the Hankel matrices have at most rank {}: the model has no more",
                     options_.states, model.states()));
  if (options_.states > 0)
    for (std::string& text : warnings_of_hidden_states(model)) warn(std::move(text));
  if (data_->free.experiments > 0 && model.states() > 0 && model.full_begin() > arx_.k_begin)
    warn(fmt::format("the {} free responses don't show all {} states from step {} on, but only from step {}",
                     data_->free.experiments, model.states(), arx_.k_begin, model.full_begin()));
  if (initial_ == InitialState::unknown && model.states() > 0 && model.k_begin > 0)
    warn(fmt::format("initial states are unknown: the model begins at step {}, the first with the full state dimension",
                     model.k_begin));
}

void Pipeline::choose_frame() {
  std::string told;
  result_.model = in_frame(std::move(result_.model), options_, result_.lags, told);
  if (!told.empty()) warn(std::move(told));
}

// `measured`: what the data are a part of, if it is known.
void Pipeline::evaluate(std::vector<std::string> misfits, const Ensemble* measured) {
  ValidateOptions o;
  o.misfits = std::move(misfits);
  o.initial_state = initial_;
  // The model adds the nominal trajectory back, so the training data are needed as they were measured.
  const Ensemble restored = nominal_ ? departures(*data_, {-nominal_->u, -nominal_->y}) : Ensemble();
  const Ensemble& training = nominal_ ? restored : *data_;
  const Ensemble& judged = result_.held_out ? held_out_ : training;
  Validation& validation = result_.validation;
  validation = validate_in_numbers(result_.model, judged, o);
  if (measured) {
    // Of a single record the end is held out.
    const Index first = result_.held_out ? measured->steps() - held_out_.steps() : 0;
    validation.outlying = outlying_in(*measured, judged, first, std::move(validation.outlying));
    if (result_.held_out && validation.noisy) {
      auto more = outlying_in(*measured, training, 0, outlying_samples(result_.model, training, o));
      std::move(more.begin(), more.end(), std::back_inserter(validation.outlying));
    }
  }
  for (std::string& text : warnings_of(validation.outlying, judged.names))
    validation.warnings.push_back(std::move(text));
  for (const std::string& text : validation.warnings) warn(text);
  for (std::string& text : warnings_of_fit(validation.one_step.fit, data_->names)) warn(std::move(text));
}

Stretch Pipeline::run_settled(const Settled& settled, Index keep_begin, Index keep_end, bool first) {
  settled_ = &settled;
  from_full_dimension_ = first;
  initial_ = *options_.initial_state;
  result_.lags = options_.lags;
  remove_nominal();
  Stretch result;
  if (settled.together) {
    regress_together();
  } else {
    check_size();
    GtvArxOptions o;
    o.lags = {result_.lags};
    o.initial_state = initial_;
    o.spent = nominal_ ? 1 : 0;
    o.execution.threads = options_.execution.threads;
    arx_ = gtv_arx(*data_, o);
    result.regressions = survey_regressions(keep_begin, keep_end);
  }
  result_.noisy = settled.noisy;
  realise_model();
  choose_frame();
  check_finite(result_.model);
  result.model = std::move(result_.model);
  result.model.u_nominal.resize(0, 0);
  result.model.y_nominal.resize(0, 0);
  result.nominal = std::move(nominal_);
  result.departures = std::move(own_);
  return result;
}

Identification Pipeline::run(bool validated, const Ensemble* measured, const std::vector<Index>& rows) {
  const auto begin = std::chrono::steady_clock::now();
  const Ensemble& all = *data_;
  check_options(options_);
  Survey samples = checked(*data_);
  if (data_->inputs() == 0 || data_->outputs() == 0)
    throw std::invalid_argument(fmt::format("ensemble: {} inputs and {} outputs found, at least one of each needed",
                                            data_->inputs(), data_->outputs()));
  check_magnitudes(samples, data_->names, data_->inputs());
  if (measured)
    for (std::string& text : remarks(*measured)) warn(std::move(text));
  const bool gaps = samples.missing > 0;
  hold_out();
  if (result_.held_out) samples = survey(*data_, 0, data_->steps());
  const std::string fingerprint = tokid::fingerprint(*data_);
  result_.experiments = data_->experiments();
  result_.steps = data_->steps();
  for (std::string& text : options_.period > 0
                               ? warnings_of_inputs(samples, data_->names, options_.period, data_->steps())
                               : warnings_of_inputs(samples, data_->names))
    warn(std::move(text));
  for (std::string& text : warnings_of_outputs(samples, data_->names)) warn(std::move(text));
  if (measured && options_.period == 0 && gaps)
    for (std::string& text : warnings_of_steps(*measured)) warn(std::move(text));
  for (std::string& text : warnings_of_dependent_outputs(*data_)) warn(std::move(text));
  remove_nominal();
  check_method();
  if (options_.lags > 0 && options_.lags * data_->outputs() < options_.states)
    warn(fmt::format("lag order {} with {} outputs carries at most {} states, {} asked for", options_.lags,
                     data_->outputs(), options_.lags * data_->outputs(), options_.states));
  if (!regress_each_step()) {
    regress_together();
    warn_of_excitation({});
    if (result_.variation.period == 0)
      for (std::string& text : warnings_of_absence(samples, data_->names)) warn(std::move(text));
  }
  realise_model();
  std::vector<std::string> misfits;
  if (measured) misfits = warn_of_experiments(all, *measured, rows);
  warn_of_states();
  choose_frame();
  check_finite(result_.model);
  result_.model.version = version;
  result_.model.options = to_json(options_, result_.experiments);
  note_data(result_.model, fingerprint);
  if (!data_->dt_stated) note_missing_dt(result_.model);
  result_.together = together_;
  result_.nominal = nominal_.has_value();
  result_.singular_value_gap = statistics::median(singular_value_gaps(result_.model));
  if (together_ && result_.noisy && !options_.choices)
    result_.choices = {result_.variation, result_.state_smoothing,
                       options_.weighting.value_or(result_.order_scores.weighting), result_.refinement.smoothing,
                       result_.refinement.iterations};
  if (result_.choices) note_choices(result_.model, *result_.choices);
  if (result_.refinement.iterations > 0)
    note_refinement(result_.model, result_.refinement.smoothing, result_.refinement.iterations);
  arx_ = {};  // the validation takes its room
  if (validated) evaluate(std::move(misfits), measured);
  if (options_.execution.progress) options_.execution.progress(1.0);
  result_.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return std::move(result_);
}

}  // namespace

Identification identify(const Ensemble& ensemble, const IdentifyOptions& options) {
  return with_remark_on_axes(ensemble, [&] {
    UsedExperiments used = used_experiments(ensemble);
    if (used.all(ensemble)) return Pipeline(ensemble, options).run(true, &ensemble);
    ensemble.check();  // what is wrong is reported with the rows of the caller
    const Ensemble own = ensemble.subset(used.rows());
    Identification result = Pipeline(own, options).run(true, &ensemble, used.rows());
    note_data(result.model, fingerprint(ensemble));
    const std::vector<std::string> told = warnings_of(used, ensemble);
    result.warnings.insert(result.warnings.begin(), told.begin(), told.end());
    result.copies = std::move(used.copies);
    result.dependent = std::move(used.dependent);
    return result;
  });
}

Identification identify_part(const Ensemble& ensemble, const IdentifyOptions& options, bool validated) {
  return Pipeline(ensemble, options).run(validated, nullptr);
}

std::vector<std::string> warnings_of_fit(const Vector& one_step_fit, const Channels& names) {
  // Noise alone can be predicted a little on the data of the identification.
  constexpr double next_to_nothing = 5.0;
  std::vector<std::string> result;
  for (Index j = 0; j < one_step_fit.size(); ++j)
    if (one_step_fit(j) < next_to_nothing)
      result.push_back(fmt::format("output {} is predicted no better than by its mean: {:.3g} % fit over one step",
                                   names.output(j), one_step_fit(j)));
  return result;
}

std::vector<std::string> warnings_of_hidden_states(const Model& model, Index origin) {
  std::vector<Index> fewer;
  for (Index k = model.full_begin(), waiting = 0; model.states() > 0 && k < model.k_end(); ++k) {
    if (model.n(k) < model.states()) {
      ++waiting;
      continue;
    }
    for (Index i = k - waiting; i < k; ++i) fewer.push_back(origin + i);
    waiting = 0;
  }
  if (fewer.empty()) return {};
  return {
      fmt::format("the Hankel matrices have a rank below {} at {}: the outputs don't show all states, or the inputs "
                  "don't reach them, and the model has fewer there",
                  model.states(), words::step_list(fewer))};
}

std::vector<double> singular_value_gaps(const Model& model) {
  std::vector<double> gaps;
  const Index n = model.states(), end = std::min(model.full_end(), model.k_end());
  for (Index k = model.full_begin(); n > 0 && k < end; ++k)
    if (const Vector s = model.at(k).singular_values(); s.size() > n) gaps.push_back(s(n - 1) / s(n));
  return gaps;
}

Stretch identify_stretch(Ensemble data, const Settled& settled, Index keep_begin, Index keep_end, bool first) {
  IdentifyOptions options = settled.options;
  options.initial_state = first ? settled.initial_state : InitialState::unknown;
  return Pipeline(std::move(data), options).run_settled(settled, keep_begin, keep_end, first);
}

}  // namespace tokid
