// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/design.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

#include "design/forecast.hpp"
#include "design/inputs.hpp"
#include "design/optimise.hpp"

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

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

class Planner {
 public:
  Planner(PlanOptions options, const Model* model) : options_(std::move(options)), model_(model) {}

  Plan run() {
    if (model_ != nullptr) take_from_model();
    check();
    count();
    draw();
    forecast();
    judge();
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
      throw std::invalid_argument(
          fmt::format("steps: {} found, the model ends after {}", options_.steps, model_->k_end()));
    options_.dt = model_->dt;
    options_.names = model_->names;
    if (model_->u_nominal.size() > 0)
      warn("the inputs are departures: add the nominal trajectory of the model to them");
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
          fmt::format("lags: {} found, at least {} needed: {} outputs times p must reach {} states", o.lags, smallest,
                      o.outputs, o.states));
    first_ = o.initial_state == InitialState::zero ? 0 : o.lags;
    if (model_ != nullptr && model_->k_begin > 0) first_ = model_->k_begin + o.lags;
    if (o.steps <= std::max(o.lags, first_))
      throw std::invalid_argument(fmt::format("steps: {} found, at least {} needed for lag order {}", o.steps,
                                              std::max(o.lags, first_) + 1, o.lags));
    if (o.experiments < 0) throw std::invalid_argument(fmt::format("experiments: {} found", o.experiments));
    for (const double a : o.amplitude)
      if (!(a > 0) || !std::isfinite(a))
        throw std::invalid_argument(fmt::format("amplitude: {} found, a positive number needed", a));
    if (o.amplitude.size() == 1) o.amplitude.resize(size_t(o.inputs), o.amplitude.front());
    if (static_cast<Index>(o.amplitude.size()) != o.inputs)
      throw std::invalid_argument(fmt::format("amplitude: {} limits found, one or {} (one for each input) needed",
                                              o.amplitude.size(), o.inputs));
    amplitude_ = Eigen::Map<const Vector>(o.amplitude.data(), o.inputs);
    if (o.noise && !(o.noise->input >= 0 && o.noise->output >= 0 && std::isfinite(o.noise->input + o.noise->output)))
      throw std::invalid_argument(fmt::format("noise: standard deviations {} and {} found, none may be negative",
                                              o.noise->input, o.noise->output));
    if (!(o.excess > 0 && o.markov_error > 0 && o.white_condition > 1))
      throw std::invalid_argument(
          fmt::format("excess, markov_error, white_condition: {}, {}, {} found, above 0, 0 and 1 needed", o.excess,
                      o.markov_error, o.white_condition));
    if (!(o.dt > 0)) throw std::invalid_argument(fmt::format("dt: {} found, a positive time in seconds needed", o.dt));
    if (o.hold < 0 || o.iterations < 0)
      throw std::invalid_argument(fmt::format("hold, iterations: {}, {} found", o.hold, o.iterations));
    plan_.kind = o.kind.value_or(model_ != nullptr ? InputKind::optimised : InputKind::orthogonal);
    if (plan_.kind == InputKind::optimised && model_ == nullptr)
      throw std::invalid_argument("kind: optimised found, which needs a preliminary model");
  }

  bool noisy() const { return options_.noise && (options_.noise->input > 0 || options_.noise->output > 0); }

  // Minimum and recommended number of experiments, each with its reason.
  void count() {
    const PlanOptions& o = options_;
    const Index r = o.inputs, m = o.outputs, p = o.lags, L = minimum_experiments(r, m, p), mean = o.nominal ? 1 : 0;
    plan_.lags = p;
    plan_.unknowns = L;
    plan_.minimum = L + mean;
    plan_.reasons.push_back(fmt::format(
        "minimum {}: every output has r + p(r+m) = {} + {}·{} = {} unknowns at every step, and lag order p = {} is {} "
        "with which p·m = {} reaches n = {} states{}",
        plan_.minimum, r, p, r + m, L, p, p * m < o.states + m ? "the smallest" : "one", p * m, o.states,
        o.nominal ? "; one more for the mean motion" : ""));

    const double c = o.white_condition, ratio = (c + 1) / (c - 1);
    const auto whole = [&](double freedom) {  // experiments with so many degrees of freedom
      const double number = double(L + mean) + std::ceil(freedom - 1e-9);
      if (number > 1e9) throw std::invalid_argument("noise: more than a thousand million experiments would be needed");
      return static_cast<Index>(number);
    };
    const Index white = whole(double(L) * (ratio * ratio - 1)), accurate = whole(1 + double(L) / o.excess);
    plan_.recommended = white;
    if (!noisy()) {
      plan_.reasons.push_back(
          fmt::format("recommended {}: windows of N = {:.3g} L random rows have a condition number near (√N + √L) / "
                      "(√N - √L) = {:.3g}, and seldom a much larger one; square ones have no bound",
                      white, ratio * ratio, c));
      if (!o.noise)
        plan_.reasons.push_back(
            fmt::format("with noise {}: estimated coefficients add the share L / (N - L - 1) to the mean square of the "
                        "best one-step error, here {:.3g} %",
                        accurate, 100 * o.excess));
      return;
    }
    plan_.recommended = std::max(white, accurate);
    std::string reason = fmt::format(
        "recommended {}: estimated coefficients add the share L / (N - L - 1) to the mean square of the best one-step "
        "error, here {:.3g} %",
        plan_.recommended, 100 * o.excess);
    if (model_ != nullptr) {
      // A draw that is not optimised will do: only the second moments of the windows matter.
      const Matrix u = kind_inputs(plan_.kind == InputKind::optimised ? InputKind::orthogonal : plan_.kind, accurate);
      const design::NoisyRegression noise =
          design::noisy_regression(*model_, design::response(*model_, u), p, first_full(), *o.noise);
      const double share = noise.markov_error / o.markov_error;
      if (const Index exact = whole(1 + share * share); exact > plan_.recommended) {
        plan_.recommended = exact;
        reason = fmt::format(
            "recommended {}: the expected error of the first Markov parameters falls with 1/√(N - L - 1), here to "
            "{:.3g} % of them",
            exact, 100 * o.markov_error);
      }
    }
    plan_.reasons.push_back(reason);
  }

  Index first_full() const { return std::max(first_, options_.lags + (model_ != nullptr ? model_->k_begin : 0)); }

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
    if (N < plan_.minimum)
      throw std::invalid_argument(
          fmt::format("experiments: {} found, at least {} needed (r + p(r+m){} at lag order {})", N, plan_.minimum,
                      o.nominal ? " + 1 for the mean motion" : "", o.lags));
    inputs_ = kind_inputs(plan_.kind, N);
    if (model_ != nullptr && !design::response(*model_, inputs_).samples().allFinite())
      throw std::invalid_argument(
          fmt::format("steps: {} found, on which the outputs of the model grow beyond all numbers", o.steps));
    if (plan_.kind == InputKind::optimised) {
      // About ten seconds of work: large plans have little to gain.
      const double work = 20 * double(o.steps) * double(N) * double(plan_.unknowns) * double(plan_.unknowns);
      const Index iterations = std::min(o.iterations, Index(1 + 5e9 / work));
      Matrix better =
          design::optimise(*model_, inputs_, amplitude_, {o.lags, first_, o.nominal}, iterations, o.execution);
      const double start = worst(conditions(inputs_));
      if (worst(conditions(better)) < start) inputs_ = std::move(better);
      plan_.start_condition = start;
    }
    const Matrix limit = amplitude_.transpose().replicate(N, o.steps);
    inputs_ = inputs_.cwiseMin(limit).cwiseMax(-limit);  // what rounding has carried beyond
  }

  GtvArx conditions(const Matrix& inputs) const {
    GtvArxOptions options;
    options.lags = {options_.lags};
    options.initial_state = options_.initial_state;
    options.execution = options_.execution;
    options.execution.progress = {};
    Ensemble e = design::response(*model_, inputs);
    if (options_.nominal) {
      const Nominal mean = nominal_trajectory(e);
      e = departures(std::move(e), mean);
    }
    return gtv_arx(e, options);
  }

  double worst(const GtvArx& arx) const {
    double largest = 0.0;
    for (Index k = first_; k < arx.steps(); ++k) largest = std::max(largest, arx.step[size_t(k)].condition);
    return largest;
  }

  // What the inputs promise by themselves, and what the preliminary model expects of them.
  void forecast() {
    const PlanOptions& o = options_;
    const Index N = inputs_.rows(), r = o.inputs, steps = o.steps;
    Ensemble& e = plan_.inputs;
    e = Ensemble(N, steps, r, 0, o.dt);
    for (Index k = 0; k < steps; ++k) e.input(k) = inputs_.middleCols(k * r, r);
    e.names.input_names = o.names.input_names;
    e.names.input_units = o.names.input_units;
    e.initial_state = o.initial_state;

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

    plan_.input_condition.assign(size_t(steps), nan);
    parallel_for(first_, steps, {o.execution.threads, {}}, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) {
        const Index p = std::min(o.lags, k);
        Matrix w = inputs_.middleCols((k - p) * r, (p + 1) * r);
        if (o.nominal) w.rowwise() -= w.colwise().mean().eval();
        for (auto column : w.colwise())
          if (const double norm = column.norm(); norm > 0) column /= norm;
        const Vector s = linalg::singular_values(linalg::triangular_factor(w));
        plan_.input_condition[size_t(k)] = s(0) / s(s.size() - 1);
      }
    });

    if (model_ == nullptr) return;
    const GtvArx arx = conditions(inputs_);
    plan_.condition.assign(size_t(steps), nan);
    plan_.rank.assign(size_t(steps), 0);
    for (Index k = first_; k < steps; ++k) {
      plan_.condition[size_t(k)] = arx.step[size_t(k)].condition;
      plan_.rank[size_t(k)] = arx.step[size_t(k)].rank;
    }
    const Ensemble known = design::response(*model_, inputs_);
    plan_.output_peak = Vector::Zero(o.outputs);
    for (Index k = 0; k < steps; ++k)
      plan_.output_peak = plan_.output_peak.cwiseMax(known.output(k).cwiseAbs().colwise().maxCoeff().transpose());
    if (!noisy()) return;
    const design::NoisyRegression noise = design::noisy_regression(*model_, known, o.lags, first_full(), *o.noise);
    plan_.noise_floor = noise.floor;
    plan_.markov_error = freedom > 1 ? noise.markov_error / std::sqrt(double(freedom - 1)) : nan;
  }

  void judge() {
    const PlanOptions& o = options_;
    const Index N = inputs_.rows(), p = o.lags;
    if (o.initial_state == InitialState::unknown)
      plan_.reasons.push_back(fmt::format(
          "unknown initial states: steps 0 to {} serve as lags only, the model begins at step {}", p - 1, p));
    else
      plan_.reasons.push_back(fmt::format(
          "zero initial states: {} inputs move all of {} states from step {} on; the windows before step {} have a "
          "lower "
          "rank, which is as it must be",
          o.inputs, o.states, (o.states + o.inputs - 1) / o.inputs, p + (o.states + o.inputs - 1) / o.inputs));
    if (N == plan_.minimum)
      warn(
          fmt::format("{} experiments leave no degree of freedom: the regressions will fit any data exactly, and "
                      "errors can't be judged; noise needs more",
                      N));
    else if (noisy() && N < plan_.recommended)
      warn(fmt::format("{} experiments found, {} recommended at this noise", N, plan_.recommended));
    if (p * o.outputs > o.states)
      warn(
          fmt::format("p·m = {} exceeds n = {}: without noise the windows have rank {} at most, of {} columns, and "
                      "noise alone determines the rest",
                      p * o.outputs, o.states, o.inputs * (p + 1) + o.states, plan_.unknowns));
    if (o.noise && o.noise->input > 0)
      for (Index i = 0; i < o.inputs; ++i)
        if (o.noise->input > 0.1 * plan_.rms(i))
          warn(
              fmt::format("the noise on {} is {:.3g} % of its RMS: if it is the record of the input that is noisy, the "
                          "coefficients come out too small by {:.3g} %",
                          o.names.input(i), 100 * o.noise->input / plan_.rms(i),
                          100 * (1 - 1 / (1 + std::pow(o.noise->input / plan_.rms(i), 2)))));
    constexpr double ill = 1e6;
    const auto count = [&](const std::vector<double>& condition) {
      return std::count_if(condition.begin(), condition.end(), [](double c) { return c > ill; });
    };
    if (const auto steps = count(plan_.input_condition); steps > 0)
      warn(
          fmt::format("the inputs of {} windows are nearly dependent (condition above {:.0e}): another kind, another "
                      "seed or more experiments",
                      steps, ill));
    else if (const auto windows = count(plan_.condition); windows > 0)
      warn(fmt::format("the model expects {} windows with a condition number above {:.0e}", windows, ill));
  }

  void warn(std::string text) { plan_.warnings.push_back(std::move(text)); }

  PlanOptions options_;
  const Model* model_;
  Vector amplitude_;
  Index first_ = 0;  // step with a regression
  Matrix inputs_;    // (N × T·r)
  Plan plan_;
};

}  // namespace

Plan plan(const PlanOptions& options) { return Planner(options, nullptr).run(); }

Plan plan(const Model& preliminary, const PlanOptions& options) { return Planner(options, &preliminary).run(); }

}  // namespace tokid
