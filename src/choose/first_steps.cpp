// SPDX-License-Identifier: BSD-3-Clause
#include "choose/first_steps.hpp"

#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>

#include "choose/held_out_error.hpp"
#include "choose/refinement.hpp"
#include "linalg/symmetric.hpp"
#include "tokid/em.hpp"
#include "tokid/linalg.hpp"
#include "tokid/observer.hpp"
#include "tokid/validate.hpp"

namespace tokid {

namespace {

constexpr Index iterations = 40;
// Floors of the first covariances, relative to those that the gains alone would give.
constexpr double least_noise = 0.02;
// Exact outputs begin with noise of this share of the largest one. EM raises it to its own floor.
constexpr double of_exact = 1e-20;
// Predictions from step 0 on are given up if they spoil those of the later steps by this factor.
constexpr double spoiled = 2.0;

bool can_begin_earlier(const Model& model, InitialState initial) {
  return initial == InitialState::unknown && model.x0_mean.size() == 0 && model.states() > 0 &&
         model.has(&Step::has_innovation_cov) && model.full_end() - model.full_begin() > 1;
}

// The covariances of outputs and states that the innovations show on average; zero where the data have no noise.
struct Usual {
  Vector outputs;
  double state = 0.0;
};

Usual usual_noise(const Model& model) {
  const double share = 1.0 / double(model.step.size());
  Usual usual{.outputs = Vector::Zero(model.outputs)};
  for (const Step& step : model.step) {
    const Matrix s = step.innovation_cov();
    usual.outputs += share * s.diagonal();
    usual.state += share * (step.G() * s * step.G().transpose()).trace() / double(model.states());
  }
  return usual;
}

// EM converges slowly from covariances that do not fit the gains. In steady state, P Cᵀ = K S gives R = (I - C K) S,
// and the smallest P with this product gives Q = P - A (P - K S Kᵀ) Aᵀ. The floors keep both positive, also at steps
// whose outputs are all zero.
void set_noise_of_gains(Model& model, const Usual& usual) {
  for (Step& step : model.step) {
    const Matrix s = step.innovation_cov(), k = -linalg::pseudo_inverse(step.A()) * step.G(), pc = k * s,
                 shown = step.C() * pc;
    Matrix r = s - shown;
    linalg::symmetrise(r);
    step.set_K(k);
    const Vector r_floor = s.diagonal().cwiseMax(least_noise * usual.outputs);
    step.set_R(linalg::bounded_below(r, least_noise * r_floor));
    const Matrix p = pc * linalg::pseudo_inverse((shown + shown.transpose()) / 2) * pc.transpose();
    const Matrix shaken = step.G() * s * step.G().transpose();
    // Where the state dimension changes, there is no steady state.
    Matrix q = step.A().rows() == step.A().cols()
                   ? Matrix(p - step.A() * (p - k * s * k.transpose()) * step.A().transpose())
                   : shaken;
    linalg::symmetrise(q);
    const Vector q_floor = shaken.diagonal().cwiseMax(least_noise * usual.state);
    step.set_Q(linalg::bounded_below(q, least_noise * q_floor));
  }
}

bool all_outputs_measured(const Ensemble& e) {
  for (Index j = 0; j < e.outputs(); ++j) {
    Index k = 0;
    while (k < e.steps() && e.output(k).col(j).array().isNaN().all()) ++k;
    if (k == e.steps()) return false;
  }
  return true;
}

// EM of the noise and of the distribution of x_0, with the matrices of `start`.
Model with_noise(const Model& start, const Ensemble& departures, InitialState initial, int threads) {
  RefineOptions o;
  o.smoothing = start.period == 1 ? 0.0 : 1.0;  // one covariance for all steps
  o.initial_state = initial;
  o.estimate_matrices = false;
  o.iterations = iterations;
  o.warm_up = false;
  o.execution.threads = threads;
  return refine(start, departures, o).model;
}

// Without a value where the noise is not known.
std::optional<Model> begun_earlier(const Model& late, const Ensemble& departures, InitialState initial, int threads) {
  if (const Index steps = refined_steps(departures, late.period); steps < departures.steps()) {
    Model part = late;
    part.step.resize(size_t(std::min(steps, late.steps())));
    std::optional<Model> found = begun_earlier(part, stretch(departures, 0, steps), initial, threads);
    if (found) found = continued(std::move(*found), late.k_end());
    return found;
  }
  const Index rows = estimation_window(late), begin = late.full_begin();
  const Ensemble first = stretch(departures, 0, std::min(departures.steps(), 2 * begin + rows));
  // Shared matrices are estimated from all steps. The other conditions leave the distribution of x_0, the noise of an
  // output or the last steps unknown.
  const bool whole = late.period > 0 || departures.experiments() <= late.states() || !all_outputs_measured(first) ||
                     late.k_end() < departures.steps();
  const Model later = whole || late.frame != "raw" ? late : smooth_frame(late, rows);
  Model start = with_constant_states(later, whole ? departures.steps() : first.steps());
  Usual usual = usual_noise(whole ? start : later);
  if (usual.outputs.maxCoeff() <= 0 || usual.state <= 0) return std::nullopt;
  usual.outputs = usual.outputs.cwiseMax(of_exact * usual.outputs.maxCoeff());
  set_noise_of_gains(start, usual);
  try {
    Model model = with_noise(start, whole ? departures : first, initial, threads);
    model.method = late.method;
    if (whole) return model;
    // The later steps have their own noise: where the plant varies, the copied matrices of the first steps err by far
    // more.
    Model rest = later;
    set_noise_of_gains(rest, usual);
    model.step.resize(size_t(begin));
    model.step.insert(model.step.end(), rest.step.begin() + rest.index(begin), rest.step.end());
    return kalman_observer(std::move(model));
  } catch (const std::runtime_error&) {
    return std::nullopt;
  }
}

// The one-step errors of `model` at the first steps that `late` predicts, relative to those that the regressions of
// `late` have there: mean over the outputs of the logarithm. Errors of nearly exact outputs count as in
// held_out_error().
double excess_error(const Model& model, const Model& late, const Ensemble& departures, InitialState initial) {
  const Index rows = estimation_window(late), begin = late.period > 0 ? rows : late.full_begin(),
              end = std::min({departures.steps(), late.k_end(), 2 * begin + rows});
  const Ensemble first = stretch(departures, 0, end);
  const Ensemble predicted = predict(of_departures(model, first), first, {1, initial}).y;
  Eigen::ArrayXd found = Eigen::ArrayXd::Zero(departures.outputs()), expected = found, sizes = found;
  for (Index k = begin; k < end; ++k) {
    const Eigen::ArrayXXd y = departures.output(k), e = y - predicted.output(k).array();
    found += e.isNaN().select(0.0, e.square()).colwise().sum().transpose();
    expected +=
        (!e.isNaN()).cast<double>().colwise().sum().transpose() * late.at(k).innovation_cov().diagonal().array();
    sizes += e.isNaN().select(0.0, y.square()).colwise().sum().transpose();
  }
  const auto relative = [&](const Eigen::ArrayXd& squares) -> Eigen::ArrayXd {
    const Eigen::ArrayXd share = (sizes > 0).select(squares / sizes, 0.0);
    return share.max(std::max(least_counted * least_counted * share.maxCoeff(), of_exact));
  };
  return 0.5 * (relative(found) / relative(expected)).log().mean();
}

}  // namespace

Model with_first_steps(const Model& late, const Ensemble& departures, InitialState initial, int threads) {
  if (!can_begin_earlier(late, initial)) return late;
  std::optional<Model> earlier = begun_earlier(late, departures, initial, threads);
  const bool kept = earlier && excess_error(*earlier, late, departures, initial) <= std::log(spoiled);
  return kept ? std::move(*earlier) : late;
}

}  // namespace tokid
