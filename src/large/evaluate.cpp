// SPDX-License-Identifier: BSD-3-Clause
#include "large/evaluate.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include "linalg/tall_product.hpp"

namespace tokid::stream {

namespace {

const Matrix none;  // departures have no nominal trajectory

// Observer and simulation side by side, experiments as rows, through samples without a gap.
class Walk {
 public:
  Walk(const Model& model, const Ensemble& data) : model_(model), data_(data) {}

  // y_k - C_k x - D_k u_k
  void error(Index k, const Matrix& x, Matrix& e) const {
    const size_t s = model_.index(k);
    e.resize(x.rows(), model_.outputs);
    linalg::tall_products(data_.output(k), {{x, model_.step[s].C(), true}, {data_.input(k), model_.step[s].D(), true}},
                          e);
  }
  // A_k x + B_k u_k
  void advance(Index k, Matrix& x) {
    const size_t s = model_.index(k);
    next_.resize(x.rows(), model_.n(k + 1));
    linalg::tall_products({{x, model_.step[s].A()}, {data_.input(k), model_.step[s].B()}}, next_);
    x.swap(next_);
  }
  // A_k x + B_k u_k - G_k e
  void advance(Index k, const Matrix& e, Matrix& x) {
    const size_t s = model_.index(k);
    next_.resize(x.rows(), model_.n(k + 1));
    linalg::tall_products(
        {{x, model_.step[s].A()}, {data_.input(k), model_.step[s].B()}, {e, model_.step[s].G(), true}}, next_);
    x.swap(next_);
  }

 private:
  const Model& model_;
  const Ensemble& data_;
  Matrix next_;
};

// Nothing where a sample is missing.
std::optional<ErrorTotals> walk(const Model& model, const Ensemble& data, Index begin, Index end, bool zero,
                                bool first) {
  ErrorCollector errors(data, none);
  Walk walk(model, data);
  Index k = zero ? model.k_begin : model.full_begin();
  const Index window = zero ? 0 : estimation_window(model), known = k + window;
  end = std::min(end, model.k_end());
  if (k + window > end) return std::move(errors.totals);
  Matrix observed = zero ? Matrix(Matrix::Zero(data.experiments(), model.n(k)))
                         : Matrix(estimate_state(model, stretch(data, 0, known), k, window).transpose());
  Matrix simulated, e;
  for (; k < end; ++k) {
    // In the first stretch from the estimated state on, later from what was known before.
    if (first ? simulated.size() == 0 : k == begin) simulated = observed;
    if (k >= begin && simulated.rows() > 0) {
      walk.error(k, simulated, e);
      errors.simulated(k, e);
      walk.advance(k, simulated);
    }
    walk.error(k, observed, e);
    if (std::isnan(e.sum())) return std::nullopt;  // a gap
    if (k >= std::max(begin, known)) errors.predicted(k, e);
    walk.advance(k, e, observed);
  }
  return std::move(errors.totals);
}

}  // namespace

ErrorTotals evaluate(const Model& model, const Ensemble& data, Index begin, Index end, InitialState initial,
                     bool first) {
  const bool zero = first && starts_from_zero(model, initial);
  if (zero || !first || !has_initial_estimate(model, initial))
    if (std::optional<ErrorTotals> totals = walk(model, data, begin, end, zero, first)) return *std::move(totals);
  ErrorCollector errors(data, none);
  const Prediction prediction = predict(model, data, {1, initial});
  const Ensemble simulation = simulate_data(model, data, initial);
  for (Index k = begin; k < end; ++k) {
    errors.predicted(k, prediction.innovations[size_t(k)]);
    errors.simulated(k, data.output(k) - simulation.output(k));
  }
  return std::move(errors.totals);
}

}  // namespace tokid::stream
