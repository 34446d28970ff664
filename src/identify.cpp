// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/identify.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "statistics.hpp"
#include "tokid/markov.hpp"
#include "tokid/tvera.hpp"
#include "tokid/version.hpp"
#include "words.hpp"

namespace tokid {

namespace {

// Residuals below this share of the outputs are errors of arithmetic: the data are free of noise.
constexpr double arithmetic = 1e-9;
// Windows worse conditioned than this leave fewer than eight digits to the coefficients.
constexpr double ill_conditioned = 1e8;
// Lag orders that a leave-one-out choice looks at.
constexpr Index most_lags = 16;
// Orders that a choice for noisy data looks at, and the experiments that it judges them by.
constexpr Index most_states = 16;
constexpr Index most_judged = 64;
// Block columns of H_k for noisy data: twice as many gained nothing in any system tried, half as many lost.
constexpr Index noisy_columns = 48;

Index ceil_div(Index a, Index b) { return (a + b - 1) / b; }

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
  if (!(o.hold_out >= 0 && o.hold_out < 1))
    throw std::invalid_argument(fmt::format("hold-out fraction: {} found, 0 <= fraction < 1 needed", o.hold_out));
}

// Squares and ratios of samples must stay within the range of double precision, ratios of their squares too.
void check_magnitudes(const Ensemble& e) {
  constexpr double largest = 1e60, smallest = 1e-60;
  for (Index c = 0; c < e.channels(); ++c) {
    const ChannelSummary s = channel_summary(e, c);
    const double magnitude = std::max(std::abs(s.min), std::abs(s.max));
    if (magnitude > largest || (magnitude > 0 && magnitude < smallest))
      throw std::invalid_argument(
          fmt::format("{}: values up to {:.3g} found, {:.0e} to {:.0e} can be handled: choose another unit",
                      c < e.inputs() ? "input " + e.names.input(c) : "output " + e.names.output(c - e.inputs()),
                      magnitude, smallest, largest));
  }
}

// Inputs that are the same in every experiment identify nothing at those steps.
void warn_of_constant_inputs(const Ensemble& e, std::vector<std::string>& warnings) {
  for (Index i = 0; i < e.inputs(); ++i) {
    std::vector<Index> zero, constant;
    for (Index k = 0; k < e.steps(); ++k) {
      const auto u = e.input(k).col(i);
      // The range of the samples that are there; steps without any say nothing.
      double least = std::numeric_limits<double>::infinity(), most = -least;
      for (const double value : u)
        if (!std::isnan(value)) least = std::min(least, value), most = std::max(most, value);
      if (least == most) (least == 0 ? zero : constant).push_back(k);
    }
    const auto warn = [&](const char* what, const std::vector<Index>& steps) {
      if (steps.empty()) return;
      warnings.push_back(fmt::format("input {} is {} in every experiment at {}: its effect there can't be identified",
                                     e.names.input(i), what, words::step_list(steps)));
    };
    warn("zero", zero);
    warn("constant", constant);
  }
}

// Root mean squares of `count` channels from channel `first` on; 1 for those that rest.
Vector channel_sizes(const Ensemble& e, Index first, Index count) {
  Vector sizes(count);
  for (Index c = 0; c < count; ++c) {
    const ChannelSummary s = channel_summary(e, first + c);
    const double square = s.mean * s.mean + s.std * s.std;
    sizes(c) = square > 0 ? std::sqrt(square) : 1.0;
  }
  return sizes;
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

// The pipeline with its intermediate results.
class Pipeline {
 public:
  Pipeline(const Ensemble& ensemble, const IdentifyOptions& options) : options_(options), data_(ensemble) {}

  Identification run();

 private:
  void hold_out();
  void remove_nominal();
  void choose_lags();
  void check_size() const;
  void decide_initial_state();
  Model model_of(const Markov& parameters, const HankelFactors& factors, TveraOptions o, Index states) const;
  Index choose_states(const Markov& parameters, const HankelFactors& factors, const TveraOptions& o);
  void realise_model();
  void warn_of_regressions();
  void warn_of_states();
  void choose_frame();
  void check_finite() const;
  void evaluate();

  Index experiments_for(Index lags) const {
    return minimum_experiments(data_.inputs(), data_.outputs(), lags) + (nominal_ ? 1 : 0);
  }
  // Experiments less the one that the mean motion costs.
  Index effective_experiments() const { return data_.experiments() - (nominal_ ? 1 : 0); }
  Index step_count() const { return static_cast<Index>(arx_.step.size()); }
  const GtvArxStep& step(Index k) const { return arx_.step[size_t(k)]; }
  void warn(std::string text) { result_.warnings.push_back(std::move(text)); }
  Execution share(double from, double to) const;
  std::string options_json() const;

  const IdentifyOptions& options_;
  Ensemble data_, held_out_;
  std::optional<Nominal> nominal_;
  InitialState initial_ = InitialState::zero;
  GtvArx arx_;
  Identification result_;
};

// The part of the whole progress that one stage takes.
Execution Pipeline::share(double from, double to) const {
  Execution execution{options_.execution.threads, {}};
  if (options_.execution.progress)
    execution.progress = [report = options_.execution.progress, from, to](double done) {
      report(from + (to - from) * done);
    };
  return execution;
}

void Pipeline::hold_out() {
  if (options_.hold_out == 0) return;
  Split parts = split(data_, options_.hold_out);
  data_ = std::move(parts.training);
  held_out_ = std::move(parts.held_out);
  result_.held_out = true;
}

void Pipeline::remove_nominal() {
  if (options_.nominal == NominalChoice::none) return;
  if (options_.nominal == NominalChoice::automatic) {
    result_.nominal_test = test_nominal(data_);
    if (!result_.nominal_test.significant) return;
  }
  if (data_.experiments() < 2)
    throw std::invalid_argument("nominal: one experiment has no mean motion to depart from, at least 2 needed");
  nominal_ = nominal_trajectory(data_);
  data_ = departures(std::move(data_), *nominal_);
  // Free responses share a nominal motion of their own; its departures are free responses too.
  FreeResponse& free = data_.free;
  if (free.experiments == 1) {
    warn("a single free response has no mean motion to depart from: it was not used");
    free = {};
  } else if (free.experiments > 1) {
    free = complete(free);
    free.y.rowwise() -= Eigen::RowVectorXd(free.y.colwise().mean());
  }
}

void Pipeline::choose_lags() {
  const Index r = data_.inputs(), m = data_.outputs();
  const Index needed = options_.states > 0 ? ceil_div(options_.states, m) : 1;  // p·m ≥ n
  result_.lags = options_.lags;
  if (options_.lags == 0) {
    LagOrderOptions lag_options;
    lag_options.p_min = needed;
    // An order is judged by what is left over: at least one degree of freedom.
    const Index judged = largest_lag_order(effective_experiments() - 1, r, m);
    lag_options.p_max = std::min({most_lags, judged, (data_.steps() - 1) / 2});
    lag_options.execution = share(0.0, 0.1);
    result_.lags = needed;
    if (lag_options.p_max >= needed && lag_options.p_max >= 1) {
      result_.lag_order_errors = lag_order_errors(data_, lag_options);
      result_.lags = result_.lag_order_errors.best;
      if (result_.lags == lag_options.p_max && lag_options.p_max == judged && judged < most_lags)
        warn(fmt::format(
            "lag order {} is the largest that {} experiments can judge: more experiments, or a larger order "
            "that is stated, may do better",
            judged, data_.experiments()));
    } else if (judged < needed && data_.experiments() >= experiments_for(needed)) {
      warn(fmt::format("{} experiments leave no degree of freedom to judge lag order {} by: it fits any data exactly",
                       data_.experiments(), needed));
    }
  } else if (options_.lags < needed) {
    warn(fmt::format("lag order {} with {} outputs carries at most {} states, {} asked for", options_.lags, m,
                     options_.lags * m, options_.states));
  }
  result_.min_experiments = experiments_for(result_.lags);
}

void Pipeline::check_size() const {
  const Index r = data_.inputs(), m = data_.outputs(), p = result_.lags, found = data_.experiments();
  if (found < result_.min_experiments) {
    const Index would_do = largest_lag_order(effective_experiments(), r, m);
    throw std::invalid_argument(fmt::format(
        "experiments: {} found, lag order {} with {} inputs and {} outputs needs at least {} (r + p(r+m){}); {}", found,
        p, r, m, result_.min_experiments, nominal_ ? " + 1 for the mean motion" : "",
        would_do > 0 ? fmt::format("{} would do for lag orders up to {}", found, would_do)
                     : fmt::format("no lag order will do, {} are needed for lag order 1", experiments_for(1))));
  }
  if (data_.steps() < p + 1)
    throw std::invalid_argument(
        fmt::format("steps: {} found, lag order {} needs at least {}", data_.steps(), p, p + 1));
}

void Pipeline::decide_initial_state() {
  const Index p = result_.lags, m = data_.outputs(), last = step_count();
  InitialStateTest& test = result_.initial_state_test;
  const auto decide = [&](InitialState state, std::string reason) {
    initial_ = test.decision = state;
    test.reason = std::move(reason);
  };
  if (options_.initial_state) return decide(*options_.initial_state, "as asked");
  if (data_.initial_state) return decide(*data_.initial_state, "as the data say");

  // Residuals of the steps p … that the initial state can't reach, against those of the steps before p.
  Vector later = Vector::Zero(m), square = Vector::Zero(m);
  Index freedom = 0;
  for (Index k = p; k < std::min(last, p + std::max<Index>(10, 3 * p)); ++k) {
    freedom += step(k).freedom;
    later += double(step(k).freedom) * step(k).residual_cov.diagonal();
  }
  for (Index k = 0; k < last; ++k) square = square.cwiseMax(step(k).output_rms.cwiseAbs2());
  if (freedom > 0) later /= double(freedom);
  later = later.cwiseMax(arithmetic * arithmetic * square);

  test.threshold = std::numeric_limits<double>::infinity();
  for (Index k = 0; k < std::min(p, last); ++k) {
    const Index own = step(k).freedom;
    if (own <= 0) continue;
    for (Index j = 0; j < m; ++j) {
      if (!(later(j) > 0)) continue;
      const double ratio = step(k).residual_cov(j, j) / later(j);
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

// The model of one order, from its first usable step on.
Model Pipeline::model_of(const Markov& parameters, const HankelFactors& factors, TveraOptions o, Index states) const {
  o.states = states;
  Model model = realise(parameters, factors, o);
  model.dt = data_.dt;
  model.names = data_.names;
  model.initial_state = initial_;
  for (Index k = model.k_begin; k < model.k_end(); ++k) {
    model.innovation_cov.push_back(step(k).residual_cov);
    model.condition.push_back(step(k).condition);
    model.rank.push_back(step(k).rank);
    model.lags.push_back(step(k).lags);
  }
  // A state that is not zero at the start can be followed only from where all of it is seen.
  if (initial_ == InitialState::unknown && model.states() > 0) model = from_step(model, model.full_begin());
  return model;
}

// Singular values of noisy data show no rank; what counts is how well the model predicts with the outputs and without.
Index Pipeline::choose_states(const Markov& parameters, const HankelFactors& factors, const TveraOptions& o) {
  OrderScores& scores = result_.order_scores;
  Ensemble judged = data_;
  if (data_.experiments() > most_judged) {
    std::vector<Index> rows;
    for (Index n = 0; n < most_judged; ++n) rows.push_back(n * data_.experiments() / most_judged);
    judged = data_.subset(rows);
  }
  ValidateOptions validate_options;
  validate_options.initial_state = initial_;
  validate_options.whiteness_lags = 0;
  const Matrix zero = Matrix::Zero(data_.steps(), data_.outputs());  // errors are compared with the departures
  const Index most = std::min({result_.lags * data_.outputs(), o.cols * data_.inputs(), most_states});
  for (Index n = 1; n <= most; ++n) {
    Model model = model_of(parameters, factors, o, n);
    model.y_nominal = zero;
    model.u_nominal = Matrix::Zero(data_.steps(), data_.inputs());
    if (model.steps() == 0 || model.states() < n) break;
    const Validation v = validate(model, judged, validate_options);
    // A simulation that is worse than none says no more than that.
    const auto score = [](const Vector& fit) {
      return (1 - fit.array() / 100).isFinite().select((1 - fit.array() / 100).max(1e-12), 1e12).log().mean();
    };
    scores.states.push_back(n);
    scores.one_step.push_back(score(v.one_step.fit));
    scores.simulation.push_back(std::min(score(v.simulation.fit), std::log(2.0)));
  }
  // The training errors of an order are too small by about its share of coefficients in the samples: n (r+m) against N
  // m.
  const double price = double(data_.channels()) / double(data_.outputs() * data_.experiments());
  const auto total = [&](size_t i) {
    return scores.one_step[i] + scores.simulation[i] + 2 * price * double(scores.states[i]);
  };
  double smallest = std::numeric_limits<double>::infinity();
  for (size_t i = 0; i < scores.states.size(); ++i) smallest = std::min(smallest, total(i));
  for (size_t i = scores.states.size(); i-- > 0;)
    if (total(i) <= smallest + std::log(1.02)) scores.best = scores.states[i];
  return scores.best;
}

void Pipeline::realise_model() {
  const Index m = data_.outputs(), r = data_.inputs(), n = options_.states, p = result_.lags;
  TveraOptions o;
  o.rows = options_.rows > 0 ? options_.rows : std::max(p + 1, ceil_div(n, m) + 1);
  // A single input, or a single direction of the inputs, may have to reach every state by itself: n columns, as n input
  // steps always suffice. With noise, more columns show the states better, slow and unstable ones above all.
  const Index most = result_.noisy ? noisy_columns : n > 0 ? n : p * m;
  o.cols = options_.cols > 0 ? options_.cols : std::max(p, most);
  o.output_size = channel_sizes(data_, data_.inputs(), m);
  o.input_size = channel_sizes(data_, 0, r);
  o.execution = share(0.7, 0.8);
  const Markov parameters = markov(arx_, o.rows + o.cols - 1, share(0.6, 0.7));
  const HankelFactors factors = hankel_factors(parameters, data_.free, o);
  o.execution.progress = {};
  Model& model = result_.model;
  model = model_of(parameters, factors, o, n == 0 && result_.noisy ? choose_states(parameters, factors, o) : n);
  if (model.states() == 0)
    warn("no state was found: the outputs answer to the inputs of the same step alone, or not at all");
  if (nominal_) {
    model.u_nominal = nominal_->u;
    model.y_nominal = nominal_->y;
  }
}

void Pipeline::warn_of_regressions() {
  std::vector<Index> ill, starved, unexcited;
  double residual = 0.0, square = 0.0;
  Index freedom = 0;
  for (Index k = arx_.k_begin; k < step_count(); ++k) {
    const Index regressors = step(k).coefficients.cols();
    result_.condition_max = std::max(result_.condition_max, step(k).condition);
    if (step(k).rank < regressors) ++result_.rank_deficient_steps;
    if (step(k).condition > ill_conditioned) ill.push_back(k);
    if (step(k).rows - (nominal_ ? 1 : 0) < regressors)
      starved.push_back(k);
    else if (step(k).rank < regressors && k >= result_.lags && inputs_dependent(data_, k, step(k).lags))
      unexcited.push_back(k);
    freedom += step(k).freedom;
    residual += step(k).residual_cov.trace();
    square += step(k).output_rms.squaredNorm();
  }
  result_.noisy = residual > arithmetic * arithmetic * square;
  if (!ill.empty())
    warn(fmt::format("ill-conditioned windows (condition above {:.0e}) at {}: expect few digits there", ill_conditioned,
                     words::step_list(ill)));
  if (!starved.empty())
    warn(
        fmt::format("missing samples leave fewer experiments than the {} unknowns at {}: the solution of smallest "
                    "norm stands in there",
                    data_.inputs() + result_.lags * data_.channels(), words::step_list(starved)));
  if (!unexcited.empty())
    warn(fmt::format(
        "the inputs of neighbouring steps and channels are linearly dependent over the experiments at {}: their "
        "effects there can't be told apart",
        words::step_list(unexcited)));
  const Index unknowns = minimum_experiments(data_.inputs(), data_.outputs(), result_.lags);
  if (freedom == 0)
    warn(fmt::format(
        "{} experiments leave no degree of freedom at lag order {}: the regressions fit any data exactly, and "
        "nothing shows how noisy they are; {} or more would tell",
        data_.experiments(), result_.lags, 2 * unknowns));
  else if (result_.noisy && effective_experiments() < 2 * unknowns)
    warn(
        fmt::format("{} experiments are few for the {} unknowns per output and step at lag order {}: noise enters the "
                    "coefficients almost undamped; {} or more would be better, and {} carry lag orders up to {} at all",
                    data_.experiments(), unknowns, result_.lags, 3 * unknowns, data_.experiments(),
                    largest_lag_order(effective_experiments(), data_.inputs(), data_.outputs())));
}

void Pipeline::warn_of_states() {
  const Model& model = result_.model;
  if (options_.states > 0 && model.states() < options_.states)
    warn(fmt::format("{} states asked for, but the Hankel matrices have at most rank {}", options_.states,
                     model.states()));
  if (data_.free.experiments > 0 && model.states() > 0 && model.full_begin() > arx_.k_begin)
    warn(fmt::format("the {} free responses don't show all {} states from step {} on, but only from step {}",
                     data_.free.experiments, model.states(), arx_.k_begin, model.full_begin()));
  if (initial_ == InitialState::unknown && model.states() > 0)
    warn(fmt::format("initial states are unknown: the model begins at step {}, the first with the full state dimension",
                     model.k_begin));
}

void Pipeline::choose_frame() {
  Model& model = result_.model;
  const Index rows = std::max<Index>(result_.lags, ceil_div(std::max<Index>(1, model.states()), model.outputs));
  if (options_.frame == Frame::smooth) model = smooth_frame(model, rows);
  if (options_.frame == Frame::reference) {
    FramedModel framed =
        reference_frame(model, options_.reference_step >= 0 ? options_.reference_step : model.full_begin(), rows);
    warn(fmt::format("reference frame of step {}: steps {} to {} are in it, the others keep their own coordinates",
                     options_.reference_step >= 0 ? options_.reference_step : model.full_begin(), framed.begin,
                     framed.end - 1));
    model = std::move(framed.model);
  }
}

void Pipeline::check_finite() const {
  const Model& model = result_.model;
  for (const auto* list : {&model.A, &model.B, &model.C, &model.D, &model.G, &model.innovation_cov})
    for (const Matrix& a : *list)
      if (!a.allFinite())
        throw std::overflow_error(
            "the model is not finite: samples or their ratios are beyond the range of double precision; scale the "
            "data");
}

void Pipeline::evaluate() {
  ValidateOptions o;
  o.initial_state = initial_;
  if (result_.held_out) {
    result_.validation = validate(result_.model, held_out_, o);
  } else {
    // The model adds the nominal trajectory back, so the training data are needed as they were measured.
    Ensemble measured = data_;
    if (nominal_) measured = departures(std::move(measured), {-nominal_->u, -nominal_->y});
    result_.validation = validate(result_.model, measured, o);
  }
  for (const std::string& text : result_.validation.warnings) warn(text);
}

std::string Pipeline::options_json() const {
  static constexpr const char* nominal[] = {"auto", "none", "mean"};
  static constexpr const char* frame[] = {"raw", "reference", "smooth"};
  const auto number = [](Index value) { return value > 0 ? nlohmann::json(value) : nlohmann::json("auto"); };
  return nlohmann::json{{"states", number(options_.states)},
                        {"lags", number(options_.lags)},
                        {"initial_state", options_.initial_state ? to_string(*options_.initial_state) : "auto"},
                        {"nominal", nominal[static_cast<size_t>(options_.nominal)]},
                        {"frame", frame[static_cast<size_t>(options_.frame)]},
                        {"reference_step", options_.reference_step >= 0 ? nlohmann::json(options_.reference_step)
                                                                        : nlohmann::json("auto")},
                        {"hold_out", options_.hold_out},
                        {"experiments", result_.experiments},
                        {"rows", number(options_.rows)},
                        {"cols", number(options_.cols)}}
      .dump();
}

Identification Pipeline::run() {
  const auto begin = std::chrono::steady_clock::now();
  check_options(options_);
  data_.check();
  if (data_.inputs() == 0 || data_.outputs() == 0)
    throw std::invalid_argument(fmt::format("ensemble: {} inputs and {} outputs found, at least one of each needed",
                                            data_.inputs(), data_.outputs()));
  check_magnitudes(data_);
  hold_out();
  result_.experiments = data_.experiments();
  result_.steps = data_.steps();
  warn_of_constant_inputs(data_, result_.warnings);
  remove_nominal();
  choose_lags();
  check_size();

  GtvArxOptions arx_options;
  arx_options.lags = {result_.lags};
  arx_options.spent = nominal_ ? 1 : 0;
  arx_options.execution = share(0.1, 0.6);
  arx_ = gtv_arx(data_, arx_options);
  decide_initial_state();
  if (initial_ == InitialState::unknown) {
    // The regressions of the steps k ≥ p hold whatever the initial state is; the others are of no use.
    arx_.k_begin = result_.lags;
    std::fill_n(arx_.step.begin(), arx_.k_begin, GtvArxStep{});
  }
  warn_of_regressions();
  realise_model();
  warn_of_states();
  choose_frame();
  check_finite();
  result_.model.version = version;
  result_.model.options = options_json();
  evaluate();
  if (options_.execution.progress) options_.execution.progress(1.0);
  result_.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  return std::move(result_);
}

}  // namespace

Identification identify(const Ensemble& ensemble, const IdentifyOptions& options) {
  return Pipeline(ensemble, options).run();
}

}  // namespace tokid
