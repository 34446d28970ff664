// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/em.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <stdexcept>

#include "base/statistics.hpp"
#include "data/rows.hpp"
#include "linalg/symmetric.hpp"
#include "model/initial_state.hpp"
#include "model/kalman_step.hpp"
#include "noise/em.hpp"
#include "noise/em/estimator.hpp"
#include "tokid/observer.hpp"

namespace tokid {

namespace {

// A segment with its own noise size has at least this many samples per entry of a covariance.
constexpr double samples_per_entry = 20;

// Noise sizes count as equal if their RMS difference over the segments is smaller than this. Even constant noise seems
// to differ this much if the model has not converged.
constexpr double noise_spread = 0.1;
// The variance that outputs keep if a model predicts them exactly, relative to their mean square.
constexpr double exact = 1e-12;
// The warm-up uses these shares of the penalty, each for a third of the iterations, but at most `warm_up_iterations`.
// It skips penalties below `weak`.
constexpr double warm_up[] = {1.0 / 30, 1.0 / 9, 1.0 / 3}, weak = 0.03;
constexpr Index warm_up_iterations = 15;

constexpr double infinity = std::numeric_limits<double>::infinity();

Matrix mean_innovation_cov(const Model& model) {
  Matrix mean = Matrix::Zero(model.outputs, model.outputs);
  for (const Step& step : model.step) mean += step.innovation_cov() / double(model.steps());
  return mean;
}

Index window_of(const Model& model) { return (model.states() + model.outputs - 1) / model.outputs + 1; }

// The covariance of a state that is estimated from the next few outputs alone, with noise of covariance S; mean over
// the steps. A thousandth of the mean information is added in each direction, because the outputs may hardly depend on
// some directions.
Matrix estimation_covariance(const Model& model, const Matrix& s, Index begin, Index end) {
  const Index n = model.states();
  Matrix w, mean = Matrix::Zero(n, n);
  linalg::inverse_root(s, w);
  for (Index k = begin; k < end; ++k) {
    const Matrix o = observability(model, k, window_of(model));
    Matrix information = Matrix::Zero(n, n);
    for (Index i = 0; i < o.rows(); i += model.outputs)
      information += (w * o.middleRows(i, model.outputs)).transpose() * (w * o.middleRows(i, model.outputs));
    const double trace = information.trace();
    if (!(trace > 0)) continue;
    information.diagonal().array() += 1e-3 * trace / double(n);
    mean += linalg::pseudo_inverse(information) / double(end - begin);
  }
  return mean;
}

// The process noise for the gains of a model of constant state dimension with innovations of covariance S.
Matrix process_noise(const Matrix& s, const Model& model) {
  const std::optional<Matrix> root = linalg::covariance_factor(s);
  if (!root)
    throw std::invalid_argument(
        "innovation_cov: no covariance found, symmetric matrices without negative eigenvalues are needed");
  Matrix q = 1e-3 * estimation_covariance(model, s, 0, model.steps());
  // Computed from square roots. The gains may cancel the common noise of outputs, and are then far larger than their
  // result.
  for (const Step& step : model.step)
    q += kalman::covariance_of((step.G() * *root).transpose()) / double(model.steps());
  q += 0.01 * Matrix(q.diagonal().asDiagonal());
  linalg::symmetrise(q);
  return q;
}

// Are the states of the model in the coordinates of a realisation, which may differ from step to step? The steps of one
// model have the same coordinates already.
bool in_raw_frame(const Model& model) { return model.frame == "raw" && model.method != "known" && model.period != 1; }

void set_noise(const Matrix& s, Model& model) {
  const Matrix q = process_noise(s, model);
  for (Step& step : model.step) {
    step.set_Q(q);
    step.set_R(s);
  }
}

}  // namespace

Model with_constant_states(const Model& model, Index steps) {
  model.check();
  if (steps < 1) throw std::invalid_argument(fmt::format("steps: {} found, at least 1 needed", steps));
  const Index n = model.states();
  const Index begin = model.steps() > 0 ? model.full_begin() : 0;
  Index last = model.steps() > 0 ? model.full_end() - 1 : 0;  // last step whose state has the full dimension
  const bool to_smooth = in_raw_frame(model);
  if (last <= begin)
    throw std::invalid_argument(
        fmt::format("model: no two successive steps with all {} states found, at least two needed", n));
  // Near the end, too few outputs follow a step to determine the frame of its state.
  if (to_smooth) last = std::max(std::min(last, model.k_end() - (n + model.outputs - 1) / model.outputs), begin + 1);
  Model full = to_smooth ? smooth_frame(model, std::max(model.max_lags(), window_of(model) - 1)) : model;

  Model result = full;
  result.step.clear();
  result.k_begin = 0;
  for (Index k = 0; k < steps; ++k) {
    const Step& state = full.at(std::clamp(k, begin, std::min(last, full.k_end() - 1)));
    const Step& transition = full.at(std::clamp(k, begin, last - 1));
    const Step& own = full.at(std::clamp(k, full.k_begin, full.k_end() - 1));
    Step& step = result.step.emplace_back(transition.A(), transition.B(), state.C(), own.D(), transition.G());
    step.take_diagnostics_of(own);
    if (!own.has_Q() || !own.has_R()) continue;
    step.set_Q(transition.Q());
    step.set_R(own.R());
  }
  if (model.k_begin > 0 || model.n(model.k_begin) < n) {
    result.x0_mean.resize(0);
    result.x0_cov.resize(0, 0);
  }
  if (!result.has(&Step::has_Q) && result.has(&Step::has_innovation_cov))
    set_noise(mean_innovation_cov(result), result);
  return result;
}

namespace {

void check(const RefineOptions& o, Index steps) {
  if (!(o.smoothing >= 0))
    throw std::invalid_argument(fmt::format("smoothing: {} found, 0 or more (or infinity) needed", o.smoothing));
  if (o.period.value_or(0) < 0)
    throw std::invalid_argument(fmt::format("period: {} found, 0 or more needed", *o.period));
  if (o.iterations < 0)
    throw std::invalid_argument(fmt::format("iterations: {} found, 0 or more needed", o.iterations));
  if (!(o.tolerance >= 0))
    throw std::invalid_argument(fmt::format("tolerance: {} found, 0 or more needed", o.tolerance));
  for (size_t i = 0; i < o.jumps.size(); ++i)
    if (o.jumps[i] < 1 || o.jumps[i] >= steps || (i > 0 && o.jumps[i] <= o.jumps[i - 1]))
      throw std::invalid_argument(
          fmt::format("jumps: {} found, ascending steps from 1 to {} needed", o.jumps[i], steps - 1));
  if (o.period.value_or(0) > 1 && *o.period >= steps)
    throw std::invalid_argument(
        fmt::format("period: {} found, less than the {} steps of the data needed", *o.period, steps));
}

// Transforms the model to coordinates in which the steps k and k+P can share their matrices. These are the coordinates
// of a period in the middle.
Model in_phase(const Model& model, Index period) {
  const Index rows = window_of(model), middle = std::max<Index>(0, (model.steps() - period) / 2);
  std::vector<Matrix> s;
  for (Index k = 0; k <= model.steps(); ++k) {
    const Index like = middle + (((k - middle) % period) + period) % period;
    Matrix candidate = Matrix::Identity(model.states(), model.states());
    if (k != like && k + rows <= model.steps() && like + rows <= model.steps()) {
      const Matrix change = linalg::pseudo_inverse(observability(model, like, rows)) * observability(model, k, rows);
      const Vector sigma = linalg::singular_values(change);
      if (sigma.size() > 0 && sigma(sigma.size() - 1) > 1e-6 * sigma(0)) candidate = change;
    }
    s.push_back(std::move(candidate));
  }
  return transform(model, s);
}

Index period_of(const Model& model, const RefineOptions& o) {
  return o.smoothing == infinity ? 1 : o.period.value_or(model.period);
}

// The covariance of the innovations, for a model that has none.
Matrix innovation_covariance(const Model& model, const Ensemble& data, InitialState initial) {
  const Prediction prediction = predict(model, data, {1, initial});
  Matrix sum = Matrix::Zero(model.outputs, model.outputs);
  double count = 0;
  for (const Matrix& e : prediction.innovations)
    for (Index i = 0; i < e.rows(); ++i)
      if (e.row(i).allFinite()) sum += e.row(i).transpose() * e.row(i), count += 1;
  const kalman::Samples samples = kalman::samples_of(model, data);
  const Matrix size = samples.y_square.cwiseMax(std::numeric_limits<double>::min()).asDiagonal();
  return count > 0 ? Matrix(sum / count + exact * size) : size;
}

InitialState initial_state_of(const Model& model, const Ensemble& data, const RefineOptions& o) {
  return initial_state_of(model, data, o.initial_state);
}

Model starting_model(const Model& model, const Ensemble& data, const RefineOptions& o, InitialState initial) {
  Model start = with_constant_states(model, data.steps());
  if (!o.feedthrough)
    for (Step& step : start.step) step.D().setZero();
  const Index period = period_of(model, o);
  // Steps that share one set of matrices are in phase already.
  if (period > 0 && model.period != 1 && period < start.steps() && start.states() > 0) start = in_phase(start, period);
  if (!start.has(&Step::has_innovation_cov))
    for (const Matrix covariance = innovation_covariance(start, data, initial); Step & step : start.step)
      step.set_innovation_cov(covariance);
  if (!start.has(&Step::has_Q)) set_noise(mean_innovation_cov(start), start);
  const bool knows_start = has_initial_estimate(start, initial);
  start.initial_state = initial;
  if (initial == InitialState::zero) {
    start.x0_mean = Vector::Zero(start.states());
    start.x0_cov = Matrix::Zero(start.states(), start.states());
  } else if (!knows_start) {
    // A covariance of the initial state that gives outputs of the size of the data.
    const kalman::Samples samples = kalman::samples_of(start, data);
    const Matrix size = samples.y_square.cwiseMax(std::numeric_limits<double>::min()).asDiagonal();
    start.x0_mean = Vector::Zero(start.states());
    start.x0_cov = double(window_of(start)) * estimation_covariance(start, size, 0, 1);
    linalg::symmetrise(start.x0_cov);
  }
  return start;
}

// The length of the segments [phases] within which the noise size counts as constant. It is 0 if the noise size is
// constant over all phases. The test is an analysis of variance of the normalised squared innovations.
Index varying_noise(const Model& model, const kalman::Samples& samples) {
  const Matrix squares = kalman::innovation_squares(model, samples);
  const double n = double(model.states()), m = double(model.outputs);
  const double entries = std::max(n * (n + 1), m * (m + 1)) / 2;
  const double per_step = samples.outputs / m / double(std::max<Index>(1, samples.steps));
  const Index length = Index(std::ceil(samples_per_entry * entries / std::max(per_step, 1e-3)));
  const Index segments = samples.steps / length;
  if (segments < 2) return 0;
  Vector sum = Vector::Zero(segments), count = sum;
  double square = 0.0;
  for (Index t = 0; t < squares.rows(); ++t)
    for (const double value : squares.row(t)) {
      if (std::isnan(value)) continue;
      const Index i = std::min(segments - 1, t / length);
      sum(i) += value;
      count(i) += 1;
      square += value * value;
    }
  const double mean = sum.sum() / count.sum();
  double between = 0.0, within = square;
  Index filled = 0;
  for (Index i = 0; i < segments; ++i) {
    if (count(i) == 0) continue;
    ++filled;
    between += count(i) * (sum(i) / count(i) - mean) * (sum(i) / count(i) - mean);
    within -= sum(i) * sum(i) / count(i);
  }
  const double a = double(filled - 1), b = count.sum() - double(filled);
  if (a < 1 || b < 1 || !(within > 0)) return 0;
  const double variance = within / b, excess = (between / a - variance) / (count.sum() / double(filled));
  const bool significant = between / a > statistics::f_quantile(0.999, a, b) * variance;
  return significant && excess > noise_spread * noise_spread * mean * mean ? length : 0;
}

// One point of the iteration, with the moments that the next M-step needs.
struct Point {
  em::Parameters parameters;
  kalman::Moments moments;
  double log_likelihood = -infinity, penalised = -infinity;
};

// The penalty measures changes of the matrices relative to the covariances of the innovations and of the state. With
// this scaling, a second refinement does not change a refined model.
em::EstimatorOptions estimator_options(const Model& start, const RefineOptions& o, InitialState initial) {
  const bool constant = o.smoothing == infinity;
  return {constant ? 1.0 : o.smoothing,
          period_of(start, o),
          initial == InitialState::unknown,
          o.feedthrough,
          o.estimate_matrices,
          mean_innovation_cov(start),
          o.jumps};
}

class Climb {
 public:
  // `any_coordinates`: the states of the start have no coordinates of their own, so that EM may choose them.
  Climb(const Model& start, const em::Data& data, const RefineOptions& options, InitialState initial,
        bool any_coordinates)
      : options_(options),
        any_coordinates_(any_coordinates),
        silent_{options.execution.threads, {}},
        data_(data),
        samples_(data.summed()),
        smoother_(samples_),
        model_(start),
        estimator_(start, samples_, estimator_options(start, options, initial)) {
    if (!(samples_.outputs > 0)) throw std::invalid_argument("data: no output sample found at the steps of the model");
  }

  Refinement run();

 private:
  Point first_point();
  Point point(em::Parameters parameters);
  Point point_of(em::Parameters parameters, kalman::Smoothed smoothed) const;
  const Model& with(const em::Parameters& parameters);
  bool split_noise(Point& now);
  void report(const Point& now, Refinement& result) const;

  const RefineOptions& options_;
  bool any_coordinates_;
  Execution silent_;
  const em::Data& data_;
  const kalman::Samples& samples_;
  kalman::Smoother smoother_;
  Model model_;  // with the parameters of the last point
  em::Estimator estimator_;
  Index noise_segments_ = 1;
};

// The model with these parameters. The next call changes it.
const Model& Climb::with(const em::Parameters& parameters) {
  estimator_.write(parameters, model_);
  return model_;
}

// The start, with the scales set by its moments, and perhaps in other coordinates.
Point Climb::first_point() {
  const em::Parameters start = estimator_.start();
  kalman::Smoothed smoothed = smoother_.smooth(with(start), silent_, estimator_.phases() == 1);
  estimator_.set_scales(smoothed.moments, samples_);
  Point first = estimator_.start() == start ? point_of(start, std::move(smoothed)) : point(estimator_.start());
  if (!std::isfinite(first.penalised))
    throw std::runtime_error("the likelihood of the starting model is not finite: it does not fit the data at all");
  // Coordinates that were estimated step by step vary so much that the penalty would ruin the model.
  std::optional<em::Parameters> other =
      any_coordinates_ ? estimator_.with_less_penalty(first.parameters) : std::nullopt;
  if (!other) return first;
  Point changed = point(std::move(*other));
  return changed.penalised > first.penalised ? changed : first;
}

Point Climb::point(em::Parameters parameters) {
  if (!parameters.finite()) return {};
  kalman::Smoothed smoothed = smoother_.smooth(with(parameters), silent_, estimator_.phases() == 1);
  return point_of(std::move(parameters), std::move(smoothed));
}

Point Climb::point_of(em::Parameters parameters, kalman::Smoothed smoothed) const {
  Point result;
  result.log_likelihood = smoothed.log_likelihood.sum();
  result.penalised = result.log_likelihood - estimator_.penalty(parameters);
  if (!std::isfinite(result.penalised)) result.penalised = -infinity;
  result.parameters = std::move(parameters);
  result.moments = std::move(smoothed.moments);
  return result;
}

// Gives each segment its own noise scale, at first 1. The iteration continues from the same point.
bool Climb::split_noise(Point& now) {
  if (!estimator_.noise_is_pooled() || estimator_.phases() < samples_.steps) return false;
  const Index length = varying_noise(with(now.parameters), data_.all());
  if (length == 0) return false;
  estimator_.split_noise(length, now.parameters);
  noise_segments_ = now.parameters.process.scale.size();
  return true;
}

void Climb::report(const Point& now, Refinement& result) const {
  using Kind = Finding::Kind;
  const auto add = [&result](Kind kind, std::map<std::string, double> numbers = {}) {
    result.findings.push_back({.kind = kind, .numbers = std::move(numbers)});
  };
  const bool no_process = estimator_.at_floor(now.parameters.process, estimator_.process_floor());
  const bool no_measurement = estimator_.at_floor(now.parameters.measurement, estimator_.measurement_floor());
  if (no_process && no_measurement)
    add(Kind::em_no_noise);
  else if (no_measurement)
    add(Kind::em_no_measurement_noise);
  else if (no_process)
    add(Kind::em_no_process_noise);
  if (!result.converged && options_.iterations > 0)
    add(Kind::em_not_converged,
        {{"iterations", double(result.iterations)},
         {"gain", (result.penalised.back() - result.penalised[result.penalised.size() - 2]) / samples_.outputs}});
  const Index unknowns = result.model.states() + result.model.inputs;
  if (options_.smoothing == 0 && estimator_.phases() == samples_.steps && samples_.experiments < 2 * unknowns)
    add(Kind::em_few_experiments, {{"experiments", double(samples_.experiments)}, {"unknowns", double(unknowns)}});
  else if (estimator_.phases() == samples_.steps && samples_.steps > 1 && std::isfinite(options_.smoothing) &&
           samples_.experiments < unknowns)
    add(Kind::em_fewer_than_unknowns, {{"experiments", double(samples_.experiments)}, {"unknowns", double(unknowns)}});
}

Refinement Climb::run() {
  Refinement result;
  Point now = first_point();
  const auto record = [&] {
    result.log_likelihood.push_back(now.log_likelihood);
    result.penalised.push_back(now.penalised);
  };
  record();
  Vector before;       // coordinates after the plain iteration before
  Index momentum = 0;  // iterations since the last restart of the acceleration; 1 after a plain one
  bool noise_tested = false;
  while (result.iterations < options_.iterations && !result.converged) {
    ++result.iterations;
    em::Parameters plain = estimator_.maximise(now.moments, now.parameters);
    Point next;
    if (options_.accelerate) {
      // Nesterov's momentum. It starts again from zero if it would lower the likelihood.
      Vector reached = estimator_.coordinates(plain);
      if (momentum > 0) {
        const double share = double(momentum) / double(momentum + 3);
        next = point(estimator_.parameters(reached + share * (reached - before), plain));
      }
      before = std::move(reached);
    }
    if (!(next.penalised >= now.penalised)) next = point(std::move(plain)), momentum = 0;
    ++momentum;
    const double gain = next.penalised - now.penalised;
    if (gain >= 0) now = std::move(next);  // otherwise only rounding errors remain
    record();
    // Only a plain iteration tells whether EM has converged: one with momentum may gain little because it overshoots.
    const bool small = gain <= options_.tolerance * samples_.outputs;
    result.converged = small && momentum == 1;
    if (small) momentum = 0;
    if (!noise_tested && (result.converged || 2 * result.iterations >= options_.iterations)) {
      noise_tested = true;
      if (split_noise(now)) {
        momentum = 0;
        result.converged = false;
      }
    }
    if (options_.execution.progress)
      options_.execution.progress({.share = double(result.iterations) / double(options_.iterations)});
  }
  result.noise_segments = noise_segments_;
  result.model = with(now.parameters);
  report(now, result);
  return result;
}

}  // namespace

Refinement refine(const Model& model, const Ensemble& data, const RefineOptions& options) {
  std::optional<em::Data> samples;
  Refinement result = em::refine(model, data, samples, options);
  const Model start = starting_model(model, data, options, initial_state_of(model, data, options));
  result.start_log_likelihood =
      kalman::log_likelihoods(start, samples->summed(), {options.execution.threads, {}}).sum();
  return result;
}

Refinement em::refine(const Model& model, const Ensemble& data, std::optional<Data>& samples,
                      const RefineOptions& options) {
  if (data.steps() < 1) throw std::invalid_argument("data: no step found, at least one needed");
  check(options, data.steps());
  if (period_of(model, options) > 0 && !options.jumps.empty())
    throw std::invalid_argument(
        "jumps: steps found, but the steps share their matrices. Jumps need a model that varies");
  if (period_of(model, options) == 1 && options.smoothing > 0 && std::isfinite(options.smoothing))
    throw std::invalid_argument(
        fmt::format("smoothing: {} found, but one model serves all steps, so that nothing varies. Use 0 or infinity",
                    options.smoothing));
  const InitialState initial = initial_state_of(model, data, options);
  kalman::samples_of(model, data, kalman::Tail::drop, 0);  // checks the channels
  Model start = starting_model(model, data, options, initial);
  if (!samples) samples.emplace(start, data);
  // A strong penalty makes all steps equal if the start has no smooth coordinates, and EM needs many iterations to
  // recover. EM with weaker penalties first avoids this.
  std::vector<RefineOptions> climbs;
  for (const double part : warm_up) {
    if (!options.warm_up || !std::isfinite(options.smoothing) || options.smoothing * part < weak) continue;
    RefineOptions& o = climbs.emplace_back(options);
    o.smoothing *= part;
    o.iterations = std::min(options.iterations / 3, warm_up_iterations);
  }
  climbs.push_back(options);
  double all = 0.0, done = 0.0;
  for (const RefineOptions& o : climbs) all += double(o.iterations);
  Refinement result;
  for (RefineOptions& o : climbs) {
    const double from = done / all;
    done += double(o.iterations);
    o.execution = share(options.execution, from, done / all);
    const bool any_coordinates = &o == &climbs.front() && in_raw_frame(model);
    if (&o != &climbs.front()) start = kalman_observer(std::move(result.model));
    result = Climb(start, *samples, o, initial, any_coordinates).run();
  }
  for (const Step& step : result.model.step)
    if (!linalg::covariance_factor(step.R()) || !linalg::covariance_factor(step.Q()))
      throw std::runtime_error(
          "the covariances of the noise left the range of double precision: the model does not fit "
          "the data at all");
  result.model = kalman_observer(std::move(result.model));
  result.model.method = "em";
  result.model.period = period_of(start, options);
  // Where each step has its own matrices, experiments that are not more than the states do not determine the
  // distribution of initial states beside them. The initial states of other data must be estimated.
  const Index least = result.model.period > 0 ? 2 : result.model.states() + 1;
  if (initial == InitialState::unknown && data.experiments() < least) {
    result.model.x0_mean.resize(0);
    result.model.x0_cov.resize(0, 0);
  }
  if (result.model.period == 0 && data.steps() != model.k_end())
    result.findings.push_back(
        {.kind = data.steps() > model.k_end() ? Finding::Kind::em_extended : Finding::Kind::em_shortened,
         .numbers = {{"steps", double(data.steps())}, {"last", double(model.k_end() - 1)}}});
  if (options.execution.progress) options.execution.progress({.share = 1.0});
  return result;
}

Vector log_likelihoods(const Model& model, const Ensemble& data, const Execution& execution) {
  model.check();
  const auto needed = [&](bool (Step::*part)() const, const char* name) {
    if (!model.has(part))
      throw std::invalid_argument(fmt::format("{}: not known of this model, needed at each step", name));
  };
  needed(&Step::has_Q, "Q");
  needed(&Step::has_R, "R");
  const kalman::Samples samples = kalman::samples_of(model, data);
  const Vector of_row = kalman::log_likelihoods(model, samples, execution);
  Vector result(of_row.size());
  for (Index i = 0; i < result.size(); ++i) result(samples.experiment[size_t(i)]) = of_row(i);
  return result;
}

namespace {

Split fold_of(const Ensemble& data, Index f, Index folds) {
  const std::vector<Index> held_out = fold_rows(data.experiments(), f, folds);
  return {data.subset(other_rows(data.experiments(), held_out)), data.subset(held_out), held_out};
}

// The first candidates, descending by decades. Later, candidates half a decade from the best one are added.
constexpr double coarse[] = {infinity, 3, 0.3, 0.03, 0.003, 0.0003};

class CrossValidation {
 public:
  CrossValidation(const std::vector<Model>& starts, const Ensemble& data, const RefineOptions& options)
      : starts_(starts), options_(options), experiments_(data.experiments()) {
    const Index folds = Index(starts.size());
    for (Index f = 0; f < folds; ++f) folds_.push_back(fold_of(data, f, folds));
    for (Index k = 0; k < data.steps(); ++k) samples_ += double(data.output(k).array().isFinite().count());
  }

  // The pairs of fold and candidate are independent of each other, so that threads may share them in any order.
  void run(const std::vector<double>& smoothing, double from, double to) {
    const Index count = Index(smoothing.size()), folds = Index(folds_.size());
    Matrix found(experiments_, count);
    parallel_for(0, folds * count, share(options_.execution, from, to), [&](Index begin, Index end) {
      for (Index i = begin; i < end; ++i) {
        const Split& part = folds_[size_t(i / count)];
        RefineOptions o = options_;
        o.smoothing = smoothing[size_t(i % count)];
        if (std::isinf(o.smoothing)) o.jumps.clear();  // one model for all steps
        o.execution = {};
        const Model model = refine(starts_[size_t(i / count)], part.training, o).model;
        found(part.held_out_rows, i % count) = log_likelihoods(model, part.held_out);
      }
    });
    for (Index i = 0; i < count; ++i) trials_[smoothing[size_t(i)]] = found.col(i);
  }

  double best() const {
    const auto less = [](const auto& a, const auto& b) { return a.second.sum() < b.second.sum(); };
    return std::max_element(trials_.begin(), trials_.end(), less)->first;
  }

  LikelihoodChoice choice() const {
    LikelihoodChoice choice;
    choice.best = best();
    for (const auto& [smoothing, likelihood] : trials_) {
      const Vector difference = likelihood - trials_.at(choice.best);
      const double square = (difference.array() - difference.mean()).square().sum() / double(experiments_ - 1);
      choice.smoothing.push_back(smoothing);
      choice.log_likelihood.push_back(likelihood.sum() / std::max(1.0, samples_));
      choice.error.push_back(std::sqrt(double(experiments_) * square) / std::max(1.0, samples_));
    }
    const size_t likeliest = size_t(std::distance(trials_.begin(), trials_.find(choice.best)));
    if (choice.log_likelihood[0] + choice.error[0] >= choice.log_likelihood[likeliest]) choice.best = infinity;
    return choice;
  }

 private:
  const std::vector<Model>& starts_;
  const RefineOptions& options_;
  Index experiments_;
  std::vector<Split> folds_;
  double samples_ = 0.0;
  std::map<double, Vector, std::greater<>> trials_;  // λ → log-likelihood of each held-out experiment
};

}  // namespace

LikelihoodChoice choose_smoothing(const std::vector<Model>& starts, const Ensemble& data,
                                  const RefineOptions& options) {
  const Index folds = Index(starts.size()), experiments = data.experiments();
  if (folds < 2) throw std::invalid_argument(fmt::format("starts: {} found, at least 2 folds needed", folds));
  if (experiments < folds)
    throw std::invalid_argument(
        fmt::format("experiments: {} found, at least as many as the {} folds needed", experiments, folds));
  CrossValidation trials(starts, data, options);
  std::vector<double> candidates(std::begin(coarse), std::end(coarse));
  const Index unknowns = starts[0].states() + starts[0].inputs;
  if (experiments - experiments / folds >= 2 * unknowns) candidates.push_back(0);
  trials.run(candidates, 0.0, 0.75);
  const double best = trials.best();
  if (best > 0 && best < infinity) trials.run({best * 10 / 3, best / 3}, 0.75, 1.0);
  return trials.choice();
}

}  // namespace tokid
