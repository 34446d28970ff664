// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/design.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "base/nan.hpp"
#include "base/words.hpp"
#include "data/subjects.hpp"
#include "design/forecast.hpp"
#include "design/inputs.hpp"
#include "design/optimise.hpp"
#include "tokid/identify.hpp"

namespace tokid {

const char* to_string(InputKind kind) {
  switch (kind) {
    case InputKind::gaussian:
      return "gaussian";
    case InputKind::binary:
      return "binary";
    case InputKind::multisine:
      return "multisine";
    case InputKind::orthogonal:
      return "orthogonal";
    case InputKind::optimised:
      return "optimised";
  }
  return "";
}

namespace {

// Squares and ratios of amplitudes and noise must stay within the range of double precision.
constexpr double smallest_size = 1e-60, largest_size = 1e60;

// The effort of a plan: memory, and operations. A thread does about 1e10 operations per second.
struct Effort {
  double bytes = 0.0, operations = 0.0;
  bool within(const Effort& limit) const { return bytes <= limit.bytes && operations <= limit.operations; }
  std::string text() const { return fmt::format("{:.3g} GB of memory and {:.3g} s", bytes / 1e9, operations / 1e10); }
};
constexpr Effort most{8e9, 1e12};     // of any plan
constexpr Effort unasked{4e8, 1e11};  // of a plan whose number of experiments follows from the noise alone
constexpr double window_work = 1e11;  // operations that the condition numbers of the inputs may take
constexpr double optimised = 0.8;     // progress when the descent has ended

class Planner {
 public:
  Planner(PlanOptions options, const Model* model) : options_(std::move(options)), model_(model) {}

  ExperimentPlan run() {
    if (model_ != nullptr) take_from_model();
    check();
    count();
    draw();
    forecast_inputs();
    if (model_ != nullptr) forecast_windows();
    check_plan();
    return std::move(plan_);
  }

 private:
  void take_from_model() {
    model_->check();
    const auto take = [](const char* name, Index& stated, Index known) {
      if (stated == 0) stated = known;
      if (stated != known)
        throw std::invalid_argument(fmt::format("{}: {} found, the model has {}", name, stated, known));
    };
    take("states", options_.states, model_->states());
    take("inputs", options_.inputs, model_->inputs);
    take("outputs", options_.outputs, model_->outputs);
    if (options_.steps == 0) options_.steps = model_->k_end();
    if (options_.steps > model_->k_end())
      throw std::invalid_argument(fmt::format("steps: {} found, at most {} needed, because the model ends there",
                                              options_.steps, model_->k_end()));
    if (options_.dt == 0) options_.dt = model_->dt;
    if (!(std::abs(options_.dt - model_->dt) <= 1e-9 * model_->dt))
      throw std::invalid_argument(fmt::format("dt: {} s found, the model has {} s", options_.dt, model_->dt));
    if (!options_.initial_state) options_.initial_state = model_->initial_state;
    options_.names = model_->names;
    if (model_->u_nominal.size() > 0) report(Finding::Kind::plan_of_departures);
  }

  void check() {
    PlanOptions& o = options_;
    for (const auto& [name, value] : {std::pair{"states", o.states}, std::pair{"inputs", o.inputs},
                                      std::pair{"outputs", o.outputs}, std::pair{"steps", o.steps}})
      if (value < 1) throw std::invalid_argument(fmt::format("{}: {} found, at least 1 needed", name, value));
    const Index smallest = (o.states + o.outputs - 1) / o.outputs;
    if (o.lags == 0) o.lags = smallest;
    if (o.lags < smallest)
      throw std::invalid_argument(
          fmt::format("lags: {} found, at least {} needed: {} outputs times the lag order p must be at least {} states",
                      o.lags, smallest, o.outputs, o.states));
    unknown_ = o.initial_state.value_or(InitialState::zero) == InitialState::unknown;
    first_ = forecast_ = unknown_ ? o.lags : 0;
    full_ = o.lags;
    if (model_ != nullptr && model_->k_begin > 0) forecast_ = full_ = model_->k_begin + o.lags;
    if (o.steps <= full_)
      throw std::invalid_argument(
          fmt::format("steps: {} found, at least {} needed for lag order {}{}", o.steps, full_ + 1, o.lags,
                      full_ > o.lags ? fmt::format(" with a model that begins at step {}", model_->k_begin) : ""));
    if (o.experiments < 0)
      throw std::invalid_argument(fmt::format("experiments: {} found, 0 (automatic) or more needed", o.experiments));
    for (const double a : o.amplitude)
      if (!(a >= smallest_size && a <= largest_size))
        throw std::invalid_argument(
            fmt::format("amplitude: {} found, {:.0e} to {:.0e} needed", a, smallest_size, largest_size));
    if (o.amplitude.size() == 1) o.amplitude.resize(size_t(o.inputs), o.amplitude.front());
    if (static_cast<Index>(o.amplitude.size()) != o.inputs)
      throw std::invalid_argument(fmt::format("amplitude: {} limits found, one or {} (one for each input) needed",
                                              o.amplitude.size(), o.inputs));
    amplitude_ = Eigen::Map<const Vector>(o.amplitude.data(), o.inputs);
    if (o.noise)
      for (const double sd : {o.noise->input, o.noise->output})
        if (!(sd == 0 || (sd >= smallest_size && sd <= largest_size)))
          throw std::invalid_argument(
              fmt::format("noise: a standard deviation of {} found, 0 or {:.0e} to {:.0e} needed", sd, smallest_size,
                          largest_size));
    if (!(o.excess > 0 && o.markov_error > 0 && o.white_condition > 1))
      throw std::invalid_argument(
          fmt::format("excess, markov_error, white_condition: {}, {}, {} found, above 0, 0 and 1 needed", o.excess,
                      o.markov_error, o.white_condition));
    dt_stated_ = o.dt != 0 && (model_ == nullptr || model_->provenance.dt_stated);
    if (o.dt == 0) o.dt = 1.0;
    if (!(o.dt > 0 && std::isfinite(o.dt)))
      throw std::invalid_argument(fmt::format("dt: {} found, a positive time in seconds needed", o.dt));
    if (o.hold < 0 || o.iterations < 0)
      throw std::invalid_argument(
          fmt::format("hold, iterations: {}, {} found, 0 or more needed", o.hold, o.iterations));
    plan_.kind = o.kind.value_or(model_ != nullptr ? InputKind::optimised : InputKind::orthogonal);
    if (plan_.kind == InputKind::optimised && model_ == nullptr)
      throw std::invalid_argument(
          "kind: optimised found, but no preliminary model, which it needs. State a model or another kind");
  }

  bool noisy() const { return options_.noise && (options_.noise->input > 0 || options_.noise->output > 0); }

  // A preliminary model with D = 0 as a known fact is identified again without feedthrough.
  bool feedthrough() const { return !model_ || has_feedthrough(model_->provenance); }

  // Minimum and recommended number of experiments, each with its reason.
  void count() {
    const PlanOptions& o = options_;
    const Index r = o.inputs, m = o.outputs, p = o.lags, L = minimum_experiments(r, m, p, feedthrough()),
                mean = o.nominal ? 1 : 0;
    plan_.lags = p;
    plan_.unknowns = L;
    plan_.minimum = L + mean;
    plan_.reasons.push_back(fmt::format(
        "minimum {}: every output has {} = {} unknowns at every step, and lag order p = {} is {} "
        "with which p·m = {} reaches n = {} states{}",
        plan_.minimum,
        feedthrough() ? fmt::format("r + p(r+m) = {} + {}·{}", r, p, r + m) : fmt::format("p(r+m) = {}·{}", p, r + m),
        L, p, p * m < o.states + m ? "the smallest" : "one", p * m, o.states,
        o.nominal ? "; one more for the mean motion" : ""));

    if (o.experiments > 0 && o.experiments < plan_.minimum)
      throw std::invalid_argument(fmt::format("experiments: {} found, at least {} needed ({}{} at lag order {})",
                                              o.experiments, plan_.minimum, feedthrough() ? "r + p(r+m)" : "p(r+m)",
                                              o.nominal ? " + 1 for the mean motion" : "", p));
    const Index least = o.experiments > 0 ? o.experiments : plan_.minimum;
    if (const Effort needed = effort(least); !needed.within(most))
      throw std::invalid_argument(
          fmt::format("sizes: {} experiments of {} steps with {} inputs and {} unknowns for every output and step need "
                      "about {}, but a plan may need at most {}. Use smaller sizes",
                      least, o.steps, r, L, needed.text(), most.text()));

    const double c = o.white_condition, ratio = (c + 1) / (c - 1);
    const Index white = with_freedom(double(L) * (ratio * ratio - 1)),
                accurate = with_freedom(1 + double(L) / o.excess);
    plan_.recommended = white;
    std::string reason = fmt::format(
        "windows of N = {:.3g} L white rows have a condition number near (√N + √L) / (√N - √L) = {:.3g}, and those "
        "of N = L rows have no bound; planned inputs are about as good as white ones, the effect of the states depends "
        "on the system",
        ratio * ratio, c);
    if (noisy()) {
      plan_.recommended = std::max(white, accurate);
      reason = share_of_noise();
    }
    if (noisy() && model_ != nullptr) {
      // A draw without optimisation suffices, because only the second moments of the windows matter.
      const Matrix u = kind_inputs(plan_.kind == InputKind::optimised ? InputKind::orthogonal : plan_.kind, accurate);
      const design::NoisyRegression noise =
          design::noisy_regression(*model_, design::response(*model_, u), p, full_, *o.noise);
      const double share = noise.markov_error / o.markov_error;
      if (const Index exact = with_freedom(1 + share * share); exact > plan_.recommended) {
        plan_.recommended = exact;
        reason = fmt::format(
            "the expected error of the first Markov parameters falls with 1/√(N - L - 1), here to {:.3g} % of them",
            100 * o.markov_error);
        if (const Effort needed = effort(exact); o.experiments == 0 && !needed.within(unasked))
          throw std::invalid_argument(fmt::format(
              "experiments: {} recommended, but a plan of so many takes about {}. Reason: {}. State a smaller "
              "number (--experiments), at least {}",
              exact, needed.text(), reason, plan_.minimum));
      }
    }
    plan_.reasons.push_back(fmt::format("recommended {}: {}", plan_.recommended, reason));
    if (!o.noise) plan_.reasons.push_back(fmt::format("with noise {}: {}", accurate, share_of_noise()));
  }

  std::string share_of_noise() const {
    return fmt::format(
        "estimated coefficients add the share L / (N - L - 1) to the mean square of the best one-step error, here "
        "{:.3g} %",
        100 * options_.excess);
  }

  // The number of experiments that leaves `freedom` degrees of freedom, limited to a number that double represents
  // exactly.
  Index with_freedom(double freedom) const {
    constexpr double countable = 1e15;
    const double number = double(plan_.minimum) + std::ceil(freedom - 1e-9);
    return static_cast<Index>(number < countable ? number : countable);
  }

  // Number of input columns in a window.
  Index window_inputs() const { return options_.inputs * (options_.lags + 1); }

  // Operations for the condition number of the inputs in a window: a triangular factor, and a Jacobi method. The Jacobi
  // method is fast where columns are orthogonal.
  double window_effort(double N) const {
    const auto q = double(window_inputs());
    return q * q * (2 * N + (plan_.kind == InputKind::orthogonal ? 4 : 100) * q);
  }

  Index descents(double N) const {
    // The limit is about ten seconds of work, because further iterations improve a large plan only little.
    const auto L = double(plan_.unknowns);
    return static_cast<Index>(
        std::min(double(options_.iterations), 1 + 5e9 / (20 * double(options_.steps) * N * L * L)));
  }

  // The effort of a plan with N experiments, to a factor of about two.
  Effort effort(Index experiments) const {
    const auto N = double(experiments), T = double(options_.steps), r = double(options_.inputs),
               m = double(options_.outputs), L = double(plan_.unknowns), q = double(window_inputs());
    Effort e{5 * N * T * r, std::max(window_effort(N), std::min(window_work, T * window_effort(N)))};
    switch (plan_.kind) {
      case InputKind::gaussian:
        break;
      case InputKind::binary:
        e.operations += 30 * T * r * N * std::min(N, 2 * q);
        break;
      case InputKind::multisine: {
        const double lines = std::min(512.0, T);
        e.bytes += N * r * (2 * T + lines);
        e.operations += 2 * lines * N * r * T;
        break;
      }
      case InputKind::orthogonal:
      case InputKind::optimised:
        e.bytes += 2 * N * std::min(N, std::max(256.0, 2 * L));
        e.operations += 70 * N * std::min(N, std::max(256.0, 2 * L));
    }
    if (model_ != nullptr) {
      e.bytes += 4 * N * T * (r + m);
      e.operations += 3 * T * L * L * (2 * N + 6 * L);
      if (noisy()) e.operations += 2 * T * L * L * (12 * L + N);
      if (plan_.kind == InputKind::optimised) {
        e.bytes += N * T * ((8 + 2 * std::min(10.0, double(descents(N)))) * r + L);
        e.operations += T * L * L * (160 * N * double(descents(N)) + 300 * L);
      }
    }
    e.bytes *= 8;
    return e;
  }

  Matrix kind_inputs(InputKind kind, Index experiments) const {
    const PlanOptions& o = options_;
    const design::InputSizes sizes{experiments, o.steps, o.states, o.inputs, o.outputs, o.lags};
    RandomNumbers random(o.seed);
    Matrix u;
    switch (kind) {
      case InputKind::gaussian:
        u = design::gaussian_inputs(sizes, random);
        break;
      case InputKind::binary:
        u = design::binary_inputs(sizes, random);
        break;
      case InputKind::multisine:
        u = design::multisine_inputs(sizes, random);
        break;
      case InputKind::orthogonal:
      case InputKind::optimised:
        u = design::orthogonal_inputs(sizes, o.nominal, o.hold, random);
        break;
    }
    return u * amplitude_.replicate(o.steps, 1).asDiagonal();
  }

  void draw() {
    const PlanOptions& o = options_;
    const Index N = o.experiments > 0 ? o.experiments : plan_.recommended;
    inputs_ = kind_inputs(plan_.kind, N);
    if (model_ != nullptr && !design::response(*model_, inputs_).samples().allFinite())
      throw std::invalid_argument(
          fmt::format("steps: {} found, but within them the outputs of the model overflow. Use fewer steps", o.steps));
    if (plan_.kind == InputKind::optimised) {
      Matrix better = design::optimise(*model_, inputs_, amplitude_, {o.lags, forecast_, o.nominal},
                                       descents(double(N)), {o.execution.threads, part(0.0, optimised)});
      const double start = worst(conditions(inputs_));
      if (worst(conditions(better)) < start) inputs_ = std::move(better);
      plan_.start_condition = start;
    }
    const Matrix limit = amplitude_.transpose().replicate(N, o.steps);
    inputs_ = inputs_.cwiseMin(limit).cwiseMax(-limit);  // removes excess by rounding
  }

  GtvArx conditions(const Matrix& inputs) const {
    GtvArxOptions options;
    options.lags = {options_.lags};
    options.initial_state = unknown_ ? InitialState::unknown : InitialState::zero;
    options.feedthrough = feedthrough();
    options.noise_shape = false;
    options.execution = {options_.execution.threads, {}};
    Ensemble e = design::response(*model_, inputs);
    if (options_.nominal) {
      const Nominal mean = nominal_trajectory(e);
      e = departures(std::move(e), mean);
    }
    return gtv_arx(e, options);
  }

  double worst(const GtvArx& arx) const {
    double condition = 0.0;
    for (Index k = forecast_; k < arx.steps(); ++k) condition = std::max(condition, arx.step[size_t(k)].condition);
    return condition;
  }

  // Progress of a part of the work.
  Progress part(double begin, double end) const { return share(options_.execution, begin, end).progress; }

  // Evaluates the inputs alone, without a model.
  void forecast_inputs() {
    const PlanOptions& o = options_;
    const Index N = inputs_.rows(), r = o.inputs, steps = o.steps;
    Ensemble& e = plan_.inputs;
    e = Ensemble(N, steps, r, 0, o.dt);
    e.dt_stated = dt_stated_;
    for (Index k = 0; k < steps; ++k) e.input(k) = inputs_.middleCols(k * r, r);
    e.names.input_names = o.names.input_names;
    e.names.input_units = o.names.input_units;
    e.initial_state = unknown_ ? InitialState::unknown : InitialState::zero;

    plan_.peak.resize(r);
    plan_.rms.resize(r);
    for (Index i = 0; i < r; ++i) {
      const auto channel = inputs_(Eigen::all, Eigen::seqN(i, steps, r));
      plan_.peak(i) = channel.cwiseAbs().maxCoeff();
      plan_.rms(i) = std::sqrt(channel.squaredNorm() / double(N * steps));
    }
    plan_.first_step = first_;
    const Index freedom = N - plan_.minimum;
    plan_.excess = freedom > 1 ? double(plan_.unknowns) / double(freedom - 1) : std::numeric_limits<double>::infinity();

    // Evaluates all windows. If this takes too long, it evaluates some evenly spread windows, including the last one.
    const Index windows = steps - first_;
    const Index sampled = std::clamp<Index>(static_cast<Index>(window_work / window_effort(double(N))), 1, windows);
    if (sampled < windows)
      report(Finding::Kind::plan_windows_sampled,
             {{"inputs", double(window_inputs())}, {"sampled", double(sampled)}, {"windows", double(windows)}});
    plan_.input_condition.assign(size_t(steps), nan);
    const double ready = plan_.kind == InputKind::optimised ? optimised : 0.0;
    parallel_for(0, sampled, {o.execution.threads, part(ready, 1.0)}, [&](Index begin, Index end) {
      for (Index j = begin; j < end; ++j) {
        const Index k = first_ + (j + 1) * windows / sampled - 1, p = std::min(o.lags, k);
        Matrix w = inputs_.middleCols((k - p) * r, (p + 1) * r);
        if (o.nominal) w.rowwise() -= w.colwise().mean().eval();
        for (auto column : w.colwise())
          if (const double norm = column.norm(); norm > 0) column /= norm;
        const Vector s = linalg::singular_values(linalg::triangular_factor(w));
        plan_.input_condition[size_t(k)] = s(0) / s(s.size() - 1);
      }
    });
  }

  // Evaluates the windows that the preliminary model expects.
  void forecast_windows() {
    const PlanOptions& o = options_;
    const GtvArx arx = conditions(inputs_);
    plan_.first_forecast = forecast_;
    plan_.condition.assign(size_t(o.steps), nan);
    plan_.rank.assign(size_t(o.steps), 0);
    for (Index k = forecast_; k < o.steps; ++k) {
      plan_.condition[size_t(k)] = arx.step[size_t(k)].condition;
      plan_.rank[size_t(k)] = arx.step[size_t(k)].rank;
    }
    const Ensemble known = design::response(*model_, inputs_);
    plan_.output_peak = Vector::Zero(o.outputs);
    for (Index k = 0; k < o.steps; ++k)
      plan_.output_peak = plan_.output_peak.cwiseMax(known.output(k).cwiseAbs().colwise().maxCoeff().transpose());
    if (model_->k_begin > 0)
      report(Finding::Kind::plan_late_forecasts, {{"step", double(model_->k_begin)}, {"first", double(forecast_)}});
    else if (unknown_)
      report(Finding::Kind::plan_unknown_states);
    check_model(known);
    if (!noisy()) return;
    const design::NoisyRegression noise = design::noisy_regression(*model_, known, o.lags, full_, *o.noise);
    const Index freedom = inputs_.rows() - plan_.minimum;
    plan_.noise_floor = noise.floor;
    plan_.markov_error = freedom > 1 ? noise.markov_error / std::sqrt(double(freedom - 1)) : nan;
  }

  // Is the model accurate enough for an optimisation? The bound comes from experience (docs/evidence.md).
  void check_model(const Ensemble& known) {
    constexpr double noise = 0.025;
    if (plan_.kind != InputKind::optimised || !model_->has(&Step::has_innovation_cov)) return;
    double innovations = 0.0, outputs = 0.0;
    for (Index k = forecast_; k < known.steps(); ++k) {
      innovations += model_->at(k).innovation_cov().trace();
      outputs += known.output(k).squaredNorm() / double(known.experiments());
    }
    if (const double share = std::sqrt(innovations / outputs); share > noise)
      report(Finding::Kind::plan_model_uncertain, {{"share", double(100 * share)}, {"bound", double(100 * noise)}});
  }

  void check_plan() {
    const PlanOptions& o = options_;
    const Index N = inputs_.rows(), p = o.lags;
    if (unknown_)
      plan_.reasons.push_back(fmt::format(
          "unknown initial states: steps 0 to {} have no regression and serve only as lags, so a model of the "
          "data begins at step {}",
          first_ - 1, first_));
    else
      plan_.reasons.push_back(
          fmt::format("zero initial states: {} can have moved {} from step {} on; windows before step {} have a lower "
                      "rank, because the inputs have not yet moved all states",
                      words::plural(o.inputs, "input"), words::plural(o.states, "state"),
                      (o.states + o.inputs - 1) / o.inputs, p + (o.states + o.inputs - 1) / o.inputs));
    if (N == plan_.minimum)
      report(Finding::Kind::plan_no_freedom, {{"experiments", double(N)}});
    else if (noisy() && N < plan_.recommended)
      report(Finding::Kind::plan_below_recommendation,
             {{"experiments", double(N)}, {"recommended", double(plan_.recommended)}});
    if (p * o.outputs > o.states)
      report(Finding::Kind::plan_rank_by_noise, {{"lags_outputs", double(p * o.outputs)},
                                                 {"states", double(o.states)},
                                                 {"rank", double(o.inputs * (p + 1) + o.states)},
                                                 {"unknowns", double(plan_.unknowns)}});
    if (o.noise && o.noise->input > 0)
      for (Index i = 0; i < o.inputs; ++i)
        if (o.noise->input > 0.1 * plan_.rms(i))
          plan_.findings.push_back(
              {.kind = Finding::Kind::plan_noisy_input,
               .channels = {input_channel(o.names, i)},
               .numbers = {{"share", 100 * o.noise->input / plan_.rms(i)},
                           {"bias", 100 * (1 - 1 / (1 + std::pow(o.noise->input / plan_.rms(i), 2)))}}});
    constexpr double ill = 1e6;
    const auto count = [&](const std::vector<double>& condition) {
      return std::count_if(condition.begin(), condition.end(), [](double c) { return c > ill; });
    };
    if (const auto steps = count(plan_.input_condition); steps > 0)
      report(Finding::Kind::plan_inputs_dependent, {{"windows", double(steps)}, {"condition", double(ill)}});
    else if (const auto windows = count(plan_.condition); windows > 0)
      report(Finding::Kind::plan_ill_conditioned, {{"windows", double(windows)}, {"condition", double(ill)}});
  }

  void report(Finding::Kind kind, std::map<std::string, double> numbers = {}) {
    plan_.findings.push_back({.kind = kind, .numbers = std::move(numbers)});
  }

  PlanOptions options_;
  const Model* model_;
  Vector amplitude_;
  bool unknown_ = false;  // initial states
  bool dt_stated_ = false;
  Index first_ = 0;     // first step with a regression
  Index forecast_ = 0;  // first step with a regression that the model forecasts
  Index full_ = 0;      // first step with a regression of p lags in the model
  Matrix inputs_;       // (N × T·r)
  ExperimentPlan plan_;
};

}  // namespace

ExperimentPlan plan(const PlanOptions& options) { return Planner(options, nullptr).run(); }

ExperimentPlan plan(const Model& preliminary, const PlanOptions& options) {
  return Planner(options, &preliminary).run();
}

}  // namespace tokid
