// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/windows.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

#include "data/channel_sizes.hpp"
#include "data/check.hpp"
#include "linalg/row_absorption.hpp"

namespace tokid {

namespace {

constexpr double epsilon = std::numeric_limits<double>::epsilon();

// Number of steps that share a factorisation: about as many as in a window.
Index block_of(Index lags) { return lags + 1; }

// [1 V] for samples V without a gap.
Matrix with_ones(const ConstMatrixRef& samples) {
  Matrix result(samples.rows(), samples.cols() + 1);
  result.col(0).setOnes();
  result.rightCols(samples.cols()) = samples;
  return result;
}

// Stores R_k from the factor `r` of [1 V …]: its first column, and `size` columns after column `from`. Columns before
// the start of the experiments stay zero.
void store(const linalg::RowAbsorption& r, Index from, Index size, Index k, WindowFactors& f) {
  const Index before = f.width() - size;
  auto own = f.of(k);
  const auto in = [&](Index i) { return i == 0 ? 0 : from + i; };
  const auto to = [&](Index i) { return i == 0 ? 0 : before + i; };
  for (Index j = 0; j <= size; ++j)
    for (Index i = 0; i <= j; ++i) own(to(i), to(j)) = r(in(i), in(j));
}

}  // namespace

WindowFactors kind_of(const Ensemble& e, Index lags, InitialState initial_state) {
  WindowFactors f;
  f.inputs = e.inputs();
  f.outputs = e.outputs();
  f.lags = lags;
  f.initial_state = initial_state;
  f.dt = e.dt;
  f.names = e.names;
  f.experiments = e.experiments();
  f.rows.assign(size_t(e.steps()), 0);
  return f;
}

void check_alike(const WindowFactors& a, const WindowFactors& b) {
  const auto differ = [](const char* what, const auto& found, const auto& needed) {
    throw std::invalid_argument(
        fmt::format("{}: {} found, {} needed as in the earlier experiments", what, found, needed));
  };
  if (a.steps() != b.steps()) differ("steps", b.steps(), a.steps());
  if (a.inputs != b.inputs) differ("inputs", b.inputs, a.inputs);
  if (a.outputs != b.outputs) differ("outputs", b.outputs, a.outputs);
  if (a.lags != b.lags) differ("lag order", b.lags, a.lags);
  if (a.dt != b.dt) differ("dt", b.dt, a.dt);
  if (a.initial_state != b.initial_state)
    differ("initial states", to_string(b.initial_state), to_string(a.initial_state));
  for (Index i = 0; i < a.inputs; ++i)
    if (a.names.input(i) != b.names.input(i)) differ("input", b.names.input(i), a.names.input(i));
  for (Index j = 0; j < a.outputs; ++j)
    if (a.names.output(j) != b.names.output(j)) differ("output", b.names.output(j), a.names.output(j));
  const auto check_units = [&](const std::vector<std::string>& found, const std::vector<std::string>& needed) {
    for (size_t i = 0; i < std::min(found.size(), needed.size()); ++i)
      if (!found[i].empty() && !needed[i].empty() && found[i] != needed[i]) differ("unit", found[i], needed[i]);
  };
  check_units(b.names.input_units, a.names.input_units);
  check_units(b.names.output_units, a.names.output_units);
}

Nominal WindowFactors::nominal() const {
  const Index d = channels();
  Nominal result{Matrix::Zero(steps(), inputs), Matrix::Zero(steps(), outputs)};
  for (Index k = 0; k < steps(); ++k)
    for (Index c = 0; c < d; ++c) {
      const double mean = count(k * d + c) > 0 ? sum(k * d + c) / count(k * d + c) : 0.0;
      (c < inputs ? result.u(k, c) : result.y(k, c - inputs)) = mean;
    }
  return result;
}

WindowFactors window_factors(const Ensemble& e, Index lags, InitialState initial_state, const Execution& execution) {
  check_samples(e);
  if (lags < 1 || lags >= e.steps())
    throw std::invalid_argument(fmt::format("lags: {} found, 1 to {} needed", lags, e.steps() - 1));
  WindowFactors f = kind_of(e, lags, initial_state);
  f.factor.setZero(f.width() + 1, e.steps() * (f.width() + 1));
  f.sum.resize(e.samples().cols());
  f.count.resize(e.samples().cols());
  f.spread.resize(e.samples().cols());
  for (Index c = 0; c < e.samples().cols(); ++c) {
    const auto samples = e.samples().col(c).array();
    const auto known = !samples.isNaN();
    f.sum(c) = known.select(samples, 0.0).sum();
    f.count(c) = double(known.count());
    f.spread(c) = known.select(samples - f.sum(c) / std::max(1.0, f.count(c)), 0.0).square().sum();
  }

  const Index d = e.channels(), steps = e.steps();
  if (e.missing() > 0) {
    parallel_for(f.begin(), steps, execution, [&](Index from, Index to) {
      linalg::RowAbsorption r;
      for (Index k = from; k < to; ++k) {
        const std::vector<Index> rows = e.complete_rows(k, std::min(k, lags));
        const Matrix samples = with_ones(e.window_and_output(k, std::min(k, lags))(rows, Eigen::all));
        r.reset(samples.cols());
        r.absorb(samples);
        store(r, 0, samples.cols() - 1, k, f);
        f.rows[size_t(k)] = samples.rows();
      }
    });
    return f;
  }
  const Index block = block_of(lags), blocks = (steps - f.begin() + block - 1) / block;
  parallel_for(0, blocks, execution, [&](Index from, Index to) {
    linalg::RowAbsorption r;
    for (Index b = from; b < to; ++b) {
      const Index begin = f.begin() + b * block, end = std::min(steps, begin + block);
      const Index first = std::max<Index>(0, begin - lags);
      const Matrix samples = with_ones(e.samples().middleCols(first * d, (end - first) * d));
      r.reset(samples.cols());
      r.absorb(samples);
      for (Index k = begin, oldest = first; k < end; ++k) {
        for (; oldest < k - lags; ++oldest) r.drop(1 + (oldest - first) * d, d);
        store(r, (oldest - first) * d, (k + 1 - oldest) * d, k, f);
        f.rows[size_t(k)] = e.experiments();
      }
    }
  });
  return f;
}

void merge(WindowFactors& factors, const WindowFactors& others, const Execution& execution) {
  check_alike(factors, others);
  parallel_for(factors.begin(), factors.steps(), execution, [&](Index from, Index to) {
    linalg::RowAbsorption r;
    for (Index k = from; k < to; ++k) {
      r.reset(factors.width() + 1);
      r.absorb(factors.of(k));
      r.absorb(others.of(k));
      factors.of(k) = r.factor();
      factors.rows[size_t(k)] += others.rows[size_t(k)];
    }
  });
  factors.experiments += others.experiments;
  for (Index c = 0; c < factors.sum.size(); ++c) {
    const double a = factors.count(c), b = others.count(c);
    const double apart = others.sum(c) / std::max(1.0, b) - factors.sum(c) / std::max(1.0, a);
    factors.spread(c) += others.spread(c) + apart * apart * a * b / std::max(1.0, a + b);
  }
  factors.sum += others.sum;
  factors.count += others.count;
}

Windows::Windows(const Ensemble& e)
    : dt(e.dt),
      names(e.names),
      experiments_(e.experiments()),
      steps_(e.steps()),
      inputs_(e.inputs()),
      outputs_(e.outputs()),
      ensemble_(&e) {}

Windows::Windows(const WindowFactors& f, const Nominal* nominal)
    : dt(f.dt),
      names(f.names),
      experiments_(f.experiments),
      steps_(f.steps()),
      inputs_(f.inputs),
      outputs_(f.outputs),
      factors_(&f) {
  if (!nominal) return;
  mean_.resize(steps_ * channels());
  for (Index k = 0; k < steps_; ++k)
    mean_.segment(k * channels(), channels()) << nominal->u.row(k).transpose(), nominal->y.row(k).transpose();
}

Index Windows::rows(Index k, Index lags, Matrix& rows) const {
  const Index d = channels(), known = (std::min(k, lags) + 1) * d, width = (lags + 1) * d;
  if (factors_) {
    if (lags > factors_->lags)
      throw std::invalid_argument(
          fmt::format("lags: {} found, the window factors permit at most {}", lags, factors_->lags));
    const auto own = factors_->of(k);
    rows = own.rightCols(width);
    if (mean_.size() == 0) return factors_->rows[size_t(k)];
    // Subtracts the mean from V: [1 V] [-mean; I]. For a channel that always equals its mean, only rounding errors are
    // left. They are set to zero.
    const auto mean = mean_.segment((k + 1) * d - known, known);
    rows.rightCols(known).noalias() -= own.col(0) * mean.transpose();
    for (Index j = 0; j < known; ++j) {
      auto column = rows.col(width - known + j);
      if (column.norm() <= 16 * epsilon * double(width) * std::abs(own(0, 0) * mean(j))) column.setZero();
    }
    return factors_->rows[size_t(k)];
  }
  const auto window = ensemble_->samples().middleCols((k + 1) * d - known, known);
  rows.resize(experiments_, width);
  rows.leftCols(width - known).setZero();
  rows.rightCols(known) = window;
  // A missing sample makes the sum NaN.
  if (const double sum = window.sum(); std::isnan(sum)) {
    const std::vector<Index> complete = ensemble_->complete_rows(k, known / d - 1);
    rows.resize(Index(complete.size()), width);
    rows.leftCols(width - known).setZero();
    rows.rightCols(known) = window(complete, Eigen::all);
  }
  return rows.rows();
}

Index Windows::count(Index k, Index lags) const {
  if (factors_) return factors_->rows[size_t(k)];
  const Index known = std::min(k, lags);
  const bool gap = std::isnan(ensemble_->window_and_output(k, known).sum());
  return gap ? Index(ensemble_->complete_rows(k, known).size()) : experiments_;
}

Vector Windows::channel_sizes() const {
  if (ensemble_) return tokid::channel_sizes(*ensemble_, 0, channels());
  Vector square = Vector::Zero(channels());
  Vector total = Vector::Zero(channels());
  for (Index c = 0; c < factors_->sum.size(); ++c) {
    const double count = factors_->count(c), mean = factors_->sum(c) / std::max(1.0, count);
    const double off = mean_.size() > 0 ? mean - mean_(c) : mean;
    square(c % channels()) += factors_->spread(c) + count * off * off;
    total(c % channels()) += count;
  }
  const Vector size = (square.array() / total.array().max(1.0)).sqrt();
  return (size.array() > 0).select(size, 1.0);
}

}  // namespace tokid
