// SPDX-License-Identifier: BSD-3-Clause
#include "large/evaluate.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "model/observer_step.hpp"

namespace tokid::stream {

namespace {

const Matrix none;  // the data are departures, so there is no nominal trajectory

// Runs the observer and the simulation together over the samples. Empty if a sample is missing.
std::optional<ErrorTotals> walk(const Model& model, const Ensemble& data, Index begin, Index end, bool zero,
                                bool first) {
  ErrorCollector errors(data, none, 0);
  Index k = zero ? model.k_begin : model.full_begin();
  const Index window = zero ? 0 : estimation_window(model), known = k + window;
  end = std::min(end, model.k_end());
  if (k + window > end) return std::move(errors.totals);
  Matrix observed = zero ? Matrix(Matrix::Zero(data.experiments(), model.n(k)))
                         : Matrix(estimate_state(model, stretch(data, 0, known), k, window).transpose());
  Matrix simulated, e, next;
  for (; k < end; ++k) {
    const Step& step = model.at(k);
    const auto u = data.input(k), y = data.output(k);
    // In the first stretch, the simulation starts from the estimated state. In later stretches, it starts at `begin`
    // from the state of the observer.
    if (first ? simulated.size() == 0 : k == begin) simulated = observed;
    if (k >= begin && simulated.rows() > 0) {
      observer::innovation(step, simulated, u, y, e);
      errors.simulated(k, e);
      observer::next_state(step, simulated, u, next);
      simulated.swap(next);
    }
    observer::innovation(step, observed, u, y, e);
    if (std::isnan(e.sum())) return std::nullopt;  // a sample is missing
    if (k >= std::max(begin, known)) errors.predicted(k, e);
    observer::next_state(step, observed, u, e, next);
    observed.swap(next);
  }
  return std::move(errors.totals);
}

}  // namespace

ErrorTotals evaluate(const Model& model, const Ensemble& data, Index begin, Index end, InitialState initial,
                     bool first) {
  const bool zero = first && starts_from_zero(model, initial);
  if (zero || !first || !has_initial_estimate(model, initial))
    if (std::optional<ErrorTotals> totals = walk(model, data, begin, end, zero, first)) return *std::move(totals);
  ErrorCollector errors(data, none, 0);
  const Prediction prediction = predict(model, data, {1, initial});
  const Ensemble simulation = simulate_data(model, data, initial);
  for (Index k = begin; k < end; ++k) {
    errors.predicted(k, prediction.innovations[size_t(k)]);
    errors.simulated(k, data.output(k) - simulation.output(k));
  }
  return std::move(errors.totals);
}

}  // namespace tokid::stream
