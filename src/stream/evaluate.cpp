// SPDX-License-Identifier: BSD-3-Clause
#include "stream/evaluate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "linalg/tall_product.hpp"
#include "nan.hpp"

namespace tokid::stream {

namespace {

// Of an output without an error; nothing where a sample is missing.
ErrorSums sums_of_all(const Eigen::Ref<const Vector>& y) {
  ErrorSums s;
  const double sum = y.sum();
  if (std::isnan(sum) || y.size() == 0) return s;
  s.count = y.size();
  s.mean = sum / double(s.count);
  s.spread = (y.array() - s.mean).square().sum();
  return s;
}

// Of one output at one step, from all experiments that have both, with the sums of y alone where all have it.
ErrorSums sums_of(const Eigen::Ref<const Vector>& y, const Eigen::Ref<const Vector>& error, const ErrorSums& of_all) {
  ErrorSums s = of_all;
  s.error = error.squaredNorm();
  if (s.count > 0 && !std::isnan(s.error)) return s;
  s = {};
  for (Index n = 0; n < y.size(); ++n)
    if (!std::isnan(error(n))) s.mean += y(n), s.error += error(n) * error(n), ++s.count;
  if (s.count > 0) s.mean /= double(s.count);
  for (Index n = 0; n < y.size(); ++n)
    if (!std::isnan(error(n))) s.spread += (y(n) - s.mean) * (y(n) - s.mean);
  return s;
}

class Evaluation {
 public:
  explicit Evaluation(const Ensemble& data) : data_(data) {
    totals_.one_step.resize(size_t(data.outputs()));
    totals_.simulation.resize(size_t(data.outputs()));
  }

  void predicted(Index k, const Matrix& error) {
    for (Index j = 0; j < error.cols(); ++j) {
      const ErrorSums s = sums_of(k, error, j);
      totals_.one_step[size_t(j)].add(s);
      totals_.innovation += s.error;
      totals_.output += s.spread + double(s.count) * s.mean * s.mean;
    }
  }
  void simulated(Index k, const Matrix& error) {
    for (Index j = 0; j < error.cols(); ++j) totals_.simulation[size_t(j)].add(sums_of(k, error, j));
  }
  ErrorTotals totals() { return std::move(totals_); }

 private:
  // Prediction and simulation of a step follow each other.
  ErrorSums sums_of(Index k, const Matrix& error, Index j) {
    if (k != step_) {
      step_ = k;
      outputs_.clear();
      for (Index i = 0; i < data_.outputs(); ++i) outputs_.push_back(sums_of_all(data_.output(k).col(i)));
    }
    return stream::sums_of(data_.output(k).col(j), error.col(j), outputs_[size_t(j)]);
  }

  const Ensemble& data_;
  ErrorTotals totals_;
  Index step_ = -1;
  std::vector<ErrorSums> outputs_;  // of that step
};

// Observer and simulation side by side, experiments as rows, through samples without a gap.
class Walk {
 public:
  Walk(const Model& model, const Ensemble& data) : model_(model), data_(data) {}

  // y_k - C_k x - D_k u_k
  void error(Index k, const Matrix& x, Matrix& e) const {
    const size_t s = model_.at(k);
    e.resize(x.rows(), model_.outputs);
    linalg::tall_products(data_.output(k), {{x, model_.C[s], true}, {data_.input(k), model_.D[s], true}}, e);
  }
  // A_k x + B_k u_k
  void advance(Index k, Matrix& x) {
    const size_t s = model_.at(k);
    next_.resize(x.rows(), model_.n(k + 1));
    linalg::tall_products({{x, model_.A[s]}, {data_.input(k), model_.B[s]}}, next_);
    x.swap(next_);
  }
  // A_k x + B_k u_k - G_k e
  void advance(Index k, const Matrix& e, Matrix& x) {
    const size_t s = model_.at(k);
    next_.resize(x.rows(), model_.n(k + 1));
    linalg::tall_products({{x, model_.A[s]}, {data_.input(k), model_.B[s]}, {e, model_.G[s], true}}, next_);
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
  Evaluation evaluation(data);
  Walk walk(model, data);
  Index k = zero ? model.k_begin : model.full_begin();
  const Index window = zero ? 0 : estimation_window(model), known = k + window;
  end = std::min(end, model.k_end());
  if (k + window > end) return evaluation.totals();
  Matrix observed = zero ? Matrix(Matrix::Zero(data.experiments(), model.n(k)))
                         : Matrix(estimate_state(model, stretch(data, 0, known), k, window).transpose());
  Matrix simulated, e;
  for (; k < end; ++k) {
    // In the first stretch from the estimated state on, later from what was known before.
    if (first ? simulated.size() == 0 : k == begin) simulated = observed;
    if (k >= begin && simulated.rows() > 0) {
      walk.error(k, simulated, e);
      evaluation.simulated(k, e);
      walk.advance(k, simulated);
    }
    walk.error(k, observed, e);
    if (std::isnan(e.sum())) return std::nullopt;  // a gap
    if (k >= std::max(begin, known)) evaluation.predicted(k, e);
    walk.advance(k, e, observed);
  }
  return evaluation.totals();
}

}  // namespace

void ErrorSums::add(const ErrorSums& later) {
  if (later.count == 0) return;
  const double total = double(count + later.count), gap = later.mean - mean;
  spread += later.spread + gap * gap * double(count) * double(later.count) / total;
  mean += gap * double(later.count) / total;
  error += later.error;
  count += later.count;
}

void ErrorTotals::add(const ErrorTotals& later) {
  if (one_step.empty()) one_step.resize(later.one_step.size()), simulation.resize(later.simulation.size());
  for (size_t j = 0; j < one_step.size(); ++j) {
    one_step[j].add(later.one_step[j]);
    simulation[j].add(later.simulation[j]);
  }
  innovation += later.innovation;
  output += later.output;
}

Fit fit_of(const std::vector<ErrorSums>& sums, bool departures) {
  const Index m = Index(sums.size());
  Fit result{Vector::Constant(m, nan), Vector::Constant(m, nan), std::numeric_limits<Index>::max()};
  for (Index j = 0; j < m; ++j) {
    const ErrorSums& s = sums[size_t(j)];
    result.samples = std::min(result.samples, s.count);
    if (s.count == 0) continue;
    const double spread = s.spread + (departures ? double(s.count) * s.mean * s.mean : 0.0);
    result.rmse(j) = std::sqrt(s.error / double(s.count));
    result.fit(j) = spread > 0 ? 100 * (1 - std::sqrt(s.error / spread)) : s.error > 0 ? nan : 100.0;
  }
  return result;
}

ErrorTotals evaluate(const Model& model, const Ensemble& data, Index begin, Index end, InitialState initial,
                     bool first) {
  const bool zero = first && starts_from_zero(model, initial);
  if (zero || !first || !has_initial_estimate(model, initial))
    if (std::optional<ErrorTotals> totals = walk(model, data, begin, end, zero, first)) return *std::move(totals);
  Evaluation evaluation(data);
  const Prediction prediction = predict(model, data, {1, initial});
  const Ensemble simulation = simulate_data(model, data, initial);
  for (Index k = begin; k < end; ++k) {
    evaluation.predicted(k, prediction.innovations[size_t(k)]);
    evaluation.simulated(k, data.output(k) - simulation.output(k));
  }
  return evaluation.totals();
}

}  // namespace tokid::stream
