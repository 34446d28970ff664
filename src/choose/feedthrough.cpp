// SPDX-License-Identifier: BSD-3-Clause
#include "choose/feedthrough.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/integers.hpp"
#include "base/nan.hpp"
#include "base/statistics.hpp"
#include "data/rows.hpp"
#include "tokid/innovations.hpp"
#include "tokid/random_walk.hpp"
#include "tokid/smooth_arx.hpp"

namespace tokid {

namespace {

// Independent sums that a test divides the samples into, if the samples suffice, and the fewest that it needs.
constexpr Index most_parts = 64, fewest_parts = 8;
// Weight of an innovation in later predictions, for each step.
constexpr double forgetting = 0.9;
// Fewest windows of a regression that is not coupled, for each unknown. With fewer, its errors hide any response.
constexpr double rows_per_unknown = 2.0;
// D = 0 is decided only if feedthrough can have no larger effect on an output than this share of its innovations.
constexpr double unnoticed = 0.3;
// Functions of time in which a correlation may vary.
constexpr Index most_shapes = 8, steps_per_shape = 8;

// Residuals of a regression for all steps: T matrices (N × channels), NaN where there is none.
using Residuals = std::vector<Matrix>;

// Selects columns of the windows [v_{k-p} … v_k]: regressors, and then the samples that they explain.
struct Columns {
  std::vector<Index> regressors, explained;
};

std::vector<Index> joined(std::vector<Index> a, const std::vector<Index>& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

Matrix without_gaps(const Matrix& samples) { return samples.array().isNaN().select(0.0, samples); }

// Regressions of training experiments, applied to held-out experiments. Residuals of the training data would be too
// small and not independent.
class HeldOut {
 public:
  HeldOut(const Ensemble& e, const Plan& plan, Index folds, const Execution& execution)
      : experiments_(e.experiments()),
        steps_(e.steps()),
        lags_(plan.lags),
        variation_(plan.choices.variation),
        scales_(Windows(e).channel_sizes().cwiseInverse().replicate(plan.lags + 1, 1)) {
    for (Index f = 0; f < folds; ++f) parts_.push_back(fold(e, f, folds, is_centred(plan)));
    factors_.resize(parts_.size());
    parallel_for(0, folds, execution, [&](Index begin, Index end) {
      for (Index f = begin; f < end; ++f) factors_[size_t(f)] = factors(parts_[size_t(f)].training);
    });
  }

  // The coefficients of each fold, of each group of steps that share a model: regressors × explained.
  using Coefficients = std::vector<std::vector<Matrix>>;
  Coefficients coefficients(const Columns& columns) const {
    Coefficients result;
    const Index count = Index(columns.regressors.size());
    const std::vector<Index> all = joined(columns.regressors, columns.explained);
    for (const Factors& factors : factors_) {
      std::vector<Matrix> rows;
      for (const Matrix& factor : factors.of_group) rows.emplace_back(factor(Eigen::all, all));
      const double stiffness = std::sqrt(variation_.smoothing * factors.rows);
      result.push_back(random_walk_regression(rows, count, Vector::Constant(count, stiffness)));
    }
    return result;
  }

  Residuals residuals(const Columns& columns, const Coefficients& x) const {
    Residuals result(size_t(steps_), Matrix::Constant(experiments_, Index(columns.explained.size()), nan));
    for (size_t f = 0; f < parts_.size(); ++f) {
      const Ensemble& tested = parts_[f].held_out;
      const std::vector<Index> rows_of_all = rows_of(f);
      for (Index k = lags_; k < steps_; ++k) {
        const std::vector<Index> rows = tested.complete_rows(k, lags_);
        const Matrix windows = tested.window_and_output(k, lags_)(rows, Eigen::all) * scales_.asDiagonal();
        const Matrix residual = windows(Eigen::all, columns.explained) -
                                windows(Eigen::all, columns.regressors) * x[f][size_t(variation_.group(k))];
        for (size_t i = 0; i < rows.size(); ++i)
          result[size_t(k)].row(rows_of_all[size_t(rows[i])]) = residual.row(Index(i));
      }
    }
    return result;
  }
  Residuals residuals(const Columns& columns) const { return residuals(columns, coefficients(columns)); }

  // Calls visit(rows, x) with the rows of each fold and its coefficients at step k.
  template <class Visit>
  void each_fold(Index k, const Coefficients& x, Visit&& visit) const {
    for (size_t f = 0; f < parts_.size(); ++f) visit(rows_of(f), x[f][size_t(variation_.group(k))]);
  }

  // The mean number of windows of a regression, in the smallest fold.
  double fewest_rows() const {
    double fewest = std::numeric_limits<double>::infinity();
    for (const Factors& factors : factors_) fewest = std::min(fewest, factors.rows);
    return fewest;
  }

 private:
  struct Factors {
    std::vector<Matrix> of_group;  // triangular factors of the scaled windows of the steps that share a model
    double rows = 0.0;             // mean number of windows of a group
  };

  // The rows of all experiments that fold f holds out.
  std::vector<Index> rows_of(size_t f) const { return fold_rows(experiments_, Index(f), Index(parts_.size())); }

  Factors factors(const Ensemble& training) const {
    Factors result;
    const Index groups = variation_.groups(steps_);
    for (Index g = 0; g < groups; ++g) {
      linalg::RowStack stack(scales_.size());
      for (Index k = g; k < steps_; k += groups) {
        if (k < lags_) continue;
        const std::vector<Index> rows = training.complete_rows(k, lags_);
        stack.add(training.window_and_output(k, lags_)(rows, Eigen::all) * scales_.asDiagonal());
        result.rows += double(rows.size()) / double(groups);
      }
      result.of_group.push_back(stack.factor());
    }
    return result;
  }

  Index experiments_, steps_, lags_;
  TimeVariation variation_;
  Vector scales_;  // of a window
  std::vector<Split> parts_;
  std::vector<Factors> factors_;
};

// Student's test of a mean of zero. The parts of the sum are independent under the hypothesis.
struct Significance {
  double t = 0.0, freedom = 0.0;
  bool tested() const { return freedom + 1 >= double(fewest_parts); }
};
Significance significance(const Vector& parts) {
  const double count = double((parts.array() != 0).count()), square = parts.squaredNorm();
  if (!(square > 0)) return {};
  const double ratio = parts.sum() / std::sqrt(square);
  return {ratio * std::sqrt((count - 1) / std::max(1e-300, count - ratio * ratio)), count - 1};
}

// The pair of an input and an output with the most significant correlation.
struct Correlation {
  double p = nan;  // probability of a correlation at least this significant of any pair, if there is none
  Index input = 0, output = 0;
};

// Tests whether products of residuals have mean zero. It adds the products up in parts: each experiment, or stretches
// of it if there are few experiments.
class MeanTest {
 public:
  MeanTest(Index begin, const TimeVariation& variation, Index steps, Index experiments)
      : begin_(begin), steps_(steps), experiments_(experiments), variation_(variation) {
    const Index used = steps - begin;
    shapes_ = variation.period > 0 ? std::min(most_shapes, variation.groups(steps))
                                   : std::clamp<Index>(used / steps_per_shape, 1, most_shapes);
    stretches_ = std::clamp<Index>(ceil_div(most_parts, experiments), 1, std::max<Index>(1, used / 4));
  }

  // Tests all pairs of inputs and outputs. The correlation may vary in time, and even change its sign.
  Correlation correlation(const Residuals& inputs, const Residuals& outputs) const {
    Correlation result;
    const Index r = inputs.front().cols(), m = outputs.front().cols();
    for (Index i = 0; i < r; ++i)
      for (Index j = 0; j < m; ++j)
        for (Index s = 0; s < shapes_; ++s) {
          const Significance found = significance(parts(
              [&](Index k) { return shape(k, s) * inputs[size_t(k)].col(i).cwiseProduct(outputs[size_t(k)].col(j)); }));
          if (!found.tested()) continue;
          const double p = double(r * m * shapes_) * statistics::student_two_sided(found.t, found.freedom);
          if (!(std::min(1.0, p) >= result.p)) result = {std::min(1.0, p), i, j};
        }
    return result;
  }

  // The largest effect that feedthrough may still have on an output: two standard errors above its estimate, relative
  // to the innovations of the output. The inputs of the windows have the root mean square 1.
  double largest_effect(const Residuals& inputs, const Residuals& outputs) const {
    double largest = 0.0;
    for (Index i = 0; i < inputs.front().cols(); ++i) {
      const double input_square = square_of(inputs, i);
      for (Index j = 0; j < outputs.front().cols(); ++j) {
        const Vector products =
            parts([&](Index k) { return inputs[size_t(k)].col(i).cwiseProduct(outputs[size_t(k)].col(j)); });
        const double slope = (std::abs(products.sum()) + 2 * products.norm()) / input_square;
        largest = std::max(largest, slope / std::sqrt(square_of(outputs, j) / count_of(outputs, j)));
      }
    }
    return largest;
  }

  // Probability of a mean product at least this large; NaN if not tested.
  double positive(const Residuals& a, const Residuals& b) const {
    const Significance found =
        significance(parts([&](Index k) { return a[size_t(k)].cwiseProduct(b[size_t(k)]).rowwise().sum(); }));
    if (!found.tested()) return nan;
    const double tail = statistics::student_two_sided(found.t, found.freedom) / 2;
    return found.t > 0 ? tail : 1 - tail;
  }

 private:
  double square_of(const Residuals& residuals, Index column) const {
    double sum = 0.0;
    for (Index k = begin_; k < steps_; ++k) sum += without_gaps(residuals[size_t(k)].col(column)).squaredNorm();
    return sum;
  }

  double count_of(const Residuals& residuals, Index column) const {
    double count = 0.0;
    for (Index k = begin_; k < steps_; ++k)
      count += double(residuals[size_t(k)].col(column).array().isFinite().count());
    return count;
  }

  double shape(Index k, Index order) const {
    const double at = variation_.period > 0 ? (double(variation_.group(k)) + 0.5) / double(variation_.groups(steps_))
                                            : (double(k - begin_) + 0.5) / double(steps_ - begin_);
    return std::cos(std::numbers::pi * double(order) * at);
  }

  template <class Products>
  Vector parts(Products&& products) const {
    Vector sums = Vector::Zero(experiments_ * stretches_);
    for (Index k = begin_; k < steps_; ++k) {
      sums.segment((k - begin_) * stretches_ / (steps_ - begin_) * experiments_, experiments_) +=
          without_gaps(products(k));
    }
    return sums;
  }

  Index begin_, steps_, experiments_, shapes_ = 1, stretches_ = 1;
  TimeVariation variation_;
};

// The columns of a window.
struct WindowColumns {
  Index inputs, channels, lags;

  std::vector<Index> past() const { return range(0, lags * channels); }
  std::vector<Index> input() const { return range(lags * channels, lags * channels + inputs); }
  std::vector<Index> output() const { return range(lags * channels + inputs, (lags + 1) * channels); }
  std::vector<Index> past_inputs() const {
    std::vector<Index> result;
    for (Index j = 0; j < lags; ++j)
      for (Index i = 0; i < inputs; ++i) result.push_back(j * channels + i);
    return result;
  }
};

// The part of the outputs that earlier innovations explain, from the regression of the outputs on past and inputs. It
// depends on innovations alone. The oldest ones count less, because it would diverge if the plant is unstable.
Residuals predicted_disturbances(const HeldOut& held_out, const WindowColumns& w) {
  const Columns columns{joined(w.past(), w.input()), w.output()};
  const auto x = held_out.coefficients(columns);
  const Residuals innovations = held_out.residuals(columns, x);
  const Index outputs = w.channels - w.inputs;
  Residuals disturbance(innovations.size(), Matrix::Zero(innovations.front().rows(), outputs)), predicted = disturbance;
  for (Index k = w.lags; k < Index(innovations.size()); ++k) {
    const size_t now = size_t(k);
    held_out.each_fold(k, x, [&](const std::vector<Index>& rows, const Matrix& coefficients) {
      for (Index j = 1; j <= w.lags; ++j)
        predicted[now](rows, Eigen::all) += std::pow(forgetting, double(j)) *
                                            disturbance[size_t(k - j)](rows, Eigen::all) *
                                            coefficients.middleRows((w.lags - j) * w.channels + w.inputs, outputs);
    });
    disturbance[now] = predicted[now] + without_gaps(innovations[now]);
  }
  return predicted;
}

// Probability that the inputs depend on earlier innovations as feedback in the same step makes them depend, if there is
// no feedback. Such feedback does not distinguish the predicted part of an output from its innovation.
double feedback_in_step(const HeldOut& held_out, const MeanTest& test, const WindowColumns& w) {
  const Residuals inputs = held_out.residuals({w.past_inputs(), w.input()});
  Vector square = Vector::Zero(w.inputs);
  for (const Matrix& u : inputs) square += without_gaps(u).colwise().squaredNorm().transpose();
  const Vector weights = (square.array() > 0).select(square.cwiseInverse(), 0.0);
  const auto law =
      held_out.coefficients({joined(w.past(), w.output()), w.input()});  // its last rows: effect of y_k on u_k
  const Residuals disturbances = predicted_disturbances(held_out, w);
  Residuals expected = inputs;
  for (Index k = w.lags; k < Index(inputs.size()); ++k)
    held_out.each_fold(k, law, [&](const std::vector<Index>& rows, const Matrix& coefficients) {
      expected[size_t(k)](rows, Eigen::all) = disturbances[size_t(k)](rows, Eigen::all) *
                                              coefficients.bottomRows(w.channels - w.inputs) * weights.asDiagonal();
    });
  return test.positive(inputs, expected);
}

}  // namespace

FeedthroughChoice choose_feedthrough(const Ensemble& e, const Plan& plan, const Execution& execution) {
  using Reason = FeedthroughChoice::Reason;
  if (!plan.noisy) return {.reason = Reason::exact};
  if (e.experiments() < 2) return {.reason = Reason::untested};
  const WindowColumns w{e.inputs(), e.channels(), plan.lags};
  const HeldOut held_out(e, plan, fold_count(e.experiments()), execution);
  if (plan.choices.variation.smoothing == 0 &&
      held_out.fewest_rows() < rows_per_unknown * double(plan.lags * e.channels() + e.inputs()))
    return {.reason = Reason::untested};
  const MeanTest test(plan.lags, plan.choices.variation, e.steps(), e.experiments());

  // Feedthrough correlates what the past does not explain of the inputs and of the outputs.
  const Residuals inputs = held_out.residuals({w.past(), w.input()}),
                  outputs = held_out.residuals({w.past(), w.output()});
  const Correlation response = test.correlation(inputs, outputs);
  FeedthroughChoice choice{
      .reason = Reason::untested, .response_p = response.p, .input = response.input, .output = response.output};
  if (std::isnan(response.p)) return choice;
  if (response.p >= unlikely) {
    if (test.largest_effect(inputs, outputs) > unnoticed) return choice;
    choice.present = false;
    choice.reason = Reason::no_response;
    return choice;
  }
  choice.feedback_p = feedback_in_step(held_out, test, w);
  choice.reason = choice.feedback_p < unlikely ? Reason::feedback : Reason::response;
  return choice;
}

Findings findings_of(const FeedthroughChoice& choice, const Channels& names) {
  if (choice.reason != FeedthroughChoice::Reason::feedback) return {};
  return {{.kind = Finding::Kind::feedthrough_or_feedback,
           .channels = {{false, choice.input, names.input(choice.input)},
                        {true, choice.output, names.output(choice.output)}}}};
}

}  // namespace tokid
