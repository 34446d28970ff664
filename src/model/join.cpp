// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <stdexcept>

#include "model/continuation.hpp"
#include "model/coordinates.hpp"
#include "tokid/linalg.hpp"

namespace tokid {

namespace {

// Would the steps begin … end-1 of a periodic model go on as the model does? Its first steps may differ from later
// ones.
bool goes_on_alike(const Model& model, Index begin, Index end) {
  if (!goes_on(model) || end - begin < model.period) return false;
  const auto alike = [](const Step::View& a, const Step::View& b) {  // a change of coordinates leaves rounding errors
    return a.rows() == b.rows() && a.cols() == b.cols() && a.isApprox(b, 1e-8);
  };
  for (Index k = end; k < end + model.period; ++k) {
    const Step &own = model.at(k - model.period), &next = step_at(model, k);
    if (!alike(own.A(), next.A()) || !alike(own.B(), next.B()) || !alike(own.C(), next.C()) ||
        !alike(own.D(), next.D()))
      return false;
  }
  return true;
}

// The steps begin … end-1, which the model has.
Model part(Model model, Index begin, Index end) {
  if (!goes_on_alike(model, begin, end)) model.period = 0;
  model.step.erase(model.step.begin() + (end - model.k_begin), model.step.end());
  model.step.erase(model.step.begin(), model.step.begin() + (begin - model.k_begin));
  if (begin > model.k_begin) {  // x0_mean and x0_cov belong to the old first step
    model.x0_mean.resize(0);
    model.x0_cov.resize(0, 0);
  }
  model.k_begin = begin;
  return model;
}

}  // namespace

Model cut(Model model, Index begin, Index end) {
  if (begin < model.k_begin || begin >= end || (end > model.k_end() && !goes_on(model)))
    throw std::invalid_argument(fmt::format("cut: steps {} to {} found, steps within {} to {} needed", begin, end - 1,
                                            model.k_begin, model.k_end() - 1));
  return part(continued(std::move(model), end), begin, end);
}

Model from_step(Model model, Index k) {
  if (k < model.k_begin || k > model.k_end())
    throw std::invalid_argument(
        fmt::format("from_step: step {} found, {} to {} needed", k, model.k_begin, model.k_end()));
  const Index end = model.k_end();
  return part(std::move(model), k, end);
}

void lead_into(Model& model, const Matrix& s) {
  const Step& last = model.step.back();
  Step next(s * last.A(), s * last.B(), last.C(), last.D(), s * last.G());
  next.take_diagnostics_of(last);
  if (last.has_Q()) next.set_Q(s * last.Q() * s.transpose());
  if (last.has_R()) next.set_R(last.R());
  if (last.has_K()) next.set_K(last.K());
  model.step.back() = std::move(next);
}

namespace {

void check_joinable(const Model& earlier, const Model& later, Index k, Index rows) {
  if (earlier.inputs != later.inputs || earlier.outputs != later.outputs)
    throw std::invalid_argument(
        fmt::format("join: models with {} and {} inputs, {} and {} outputs found, equal numbers needed", earlier.inputs,
                    later.inputs, earlier.outputs, later.outputs));
  if (std::abs(earlier.dt - later.dt) > 1e-6 * earlier.dt)
    throw std::invalid_argument(
        fmt::format("join: sample times {} s and {} s found, equal ones needed", earlier.dt, later.dt));
  if (rows < 1 || k <= earlier.k_begin || k < later.k_begin || k + rows > std::min(earlier.k_end(), later.k_end()))
    throw std::invalid_argument(fmt::format(
        "join: step {} with {} block rows found; the models have steps {} to {} and {} to {}. From the step on, both "
        "need as many steps as there are block rows, and the earlier model needs one before",
        k, rows, earlier.k_begin, earlier.k_end() - 1, later.k_begin, later.k_end() - 1));
  if (earlier.n(k) != later.n(k))
    throw std::invalid_argument(
        fmt::format("join: {} and {} states at step {} found, equal numbers needed", earlier.n(k), later.n(k), k));
  if ((earlier.y_nominal.rows() > 0) != (later.y_nominal.rows() > 0))
    throw std::invalid_argument(fmt::format("join: a nominal trajectory in the {} model only, in both or none needed",
                                            earlier.y_nominal.rows() > 0 ? "earlier" : "later"));
}

// The rows of `before` up to step k, and those of `after` from there on.
Matrix joined_rows(const Matrix& before, const Matrix& after, Index k) {
  if (after.rows() <= k) return after;
  Matrix result = after;
  const Index rows = std::min(k, before.rows());
  result.topRows(rows) = before.topRows(rows);
  return result;
}

constexpr bool (Step::*regression_parts[])() const = {&Step::has_singular_values, &Step::has_condition, &Step::has_rank,
                                                      &Step::has_lags};
constexpr bool (Step::*covariances[])() const = {&Step::has_innovation_cov, &Step::has_Q, &Step::has_R, &Step::has_K};

bool same_parts(const Model& a, const Model& b) {
  const auto same = [&](bool (Step::*part)() const) { return a.has(part) == b.has(part); };
  return a.method == b.method && std::all_of(std::begin(covariances), std::end(covariances), same) &&
         std::all_of(std::begin(regression_parts), std::end(regression_parts), same);
}

// The step with the optional parts that both models have. Otherwise the joint model would have them at some steps only.
// Diagnostics of different methods have different meanings.
Step with_common_parts(const Step& step, const Model& a, const Model& b) {
  Step result(step.A(), step.B(), step.C(), step.D(), step.G());
  const auto common = [&](bool (Step::*part)() const) { return a.has(part) && b.has(part); };
  if (common(&Step::has_innovation_cov)) result.set_innovation_cov(step.innovation_cov());
  if (common(&Step::has_Q)) result.set_Q(step.Q());
  if (common(&Step::has_R)) result.set_R(step.R());
  if (common(&Step::has_K)) result.set_K(step.K());
  if (a.method != b.method) return result;
  if (common(&Step::has_singular_values)) result.set_singular_values(step.singular_values());
  if (common(&Step::has_condition)) result.set_condition(step.condition());
  if (common(&Step::has_rank)) result.set_rank(step.rank());
  if (common(&Step::has_lags)) result.set_lags(step.lags());
  return result;
}

// The difference of the outputs that a state at step k causes, with S from the states of `earlier` to those of `later`.
double state_misfit(const Matrix& earlier, const Matrix& later, const Matrix& S) {
  const double size = earlier.norm();
  return size > 0 ? (earlier - later * S).norm() / size : 0.0;
}

}  // namespace

JoinedModel join(const Model& earlier, const Model& later, Index k, Index rows) {
  if (ends_early(earlier, k + rows)) return join(continued(earlier, k + rows), later, k, rows);
  if (ends_early(later, k + rows)) return join(earlier, continued(later, k + rows), k, rows);
  check_joinable(earlier, later, k, rows);
  const Matrix before = observability(earlier, k, rows), after = observability(later, k, rows);
  if (!determines_state(before) || !determines_state(after))
    throw std::invalid_argument(
        fmt::format("join: {} block rows of step {} don't determine its {} states; more rows or another step needed",
                    rows, k, earlier.n(k)));
  const Matrix S = linalg::pseudo_inverse(after) * before;  // states of `later` from those of `earlier`, at step k
  const Similarity pulses = kinematically_similar(cut(earlier, k, k + rows), cut(later, k, k + rows), 0.0, rows);

  JoinedModel result{cut(earlier, earlier.k_begin, k), std::max(state_misfit(before, after, S), pulses.max_difference)};
  Model& model = result.model;
  lead_into(model, S);
  const Model rest = from_step(later, k);
  model.step.insert(model.step.end(), rest.step.begin(), rest.step.end());
  if (!same_parts(earlier, later))
    for (Step& step : model.step) step = with_common_parts(step, earlier, later);
  if (earlier.method != later.method) model.method = "known";
  if (earlier.frame != later.frame) model.frame = "raw";
  model.period = 0;
  model.u_nominal = joined_rows(earlier.u_nominal, later.u_nominal, k);
  model.y_nominal = joined_rows(earlier.y_nominal, later.y_nominal, k);
  for (const std::string& fingerprint : later.provenance.data) note_data(model.provenance, fingerprint);
  return result;
}

}  // namespace tokid
