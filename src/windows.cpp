// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/windows.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "channel_sizes.hpp"
#include "linalg/row_absorption.hpp"

namespace tokid {

namespace {

// Steps that share a factorisation: about as many as a window has.
Index block_of(Index lags) { return lags + 1; }

// [1 V] of rows without a gap.
Matrix with_ones(const ConstMatrixRef& samples) {
  Matrix result(samples.rows(), samples.cols() + 1);
  result.col(0).setOnes();
  result.rightCols(samples.cols()) = samples;
  return result;
}

// R_k from an absorption of [1 V …]: its first column and `size` ones from `from` on; what is before the experiments
// stays zero.
void store(const linalg::RowAbsorption& r, Index from, Index size, Index k, WindowFactors& f) {
  const Index before = f.width() - size;
  auto own = f.of(k);
  const auto in = [&](Index i) { return i == 0 ? 0 : from + i; };
  const auto to = [&](Index i) { return i == 0 ? 0 : before + i; };
  for (Index j = 0; j <= size; ++j)
    for (Index i = 0; i <= j; ++i) own(to(i), to(j)) = r(in(i), in(j));
}

void check_alike(const WindowFactors& a, const WindowFactors& b) {
  const auto differ = [](const char* what, const auto& found, const auto& needed) {
    throw std::invalid_argument(
        fmt::format("{}: {} found, {} needed as in the experiments before", what, found, needed));
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
}

}  // namespace

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
  if (lags < 1 || lags >= e.steps())
    throw std::invalid_argument(fmt::format("lags: {} found, 1 to {} needed", lags, e.steps() - 1));
  WindowFactors f;
  f.inputs = e.inputs();
  f.outputs = e.outputs();
  f.lags = lags;
  f.initial_state = initial_state;
  f.dt = e.dt;
  f.names = e.names;
  f.experiments = e.experiments();
  f.rows.assign(size_t(e.steps()), 0);
  f.factor.setZero(f.width() + 1, e.steps() * (f.width() + 1));
  f.sum.resize(e.samples().cols());
  f.count.resize(e.samples().cols());
  for (Index c = 0; c < e.samples().cols(); ++c) {
    const auto known = e.samples().col(c).array() == e.samples().col(c).array();  // not NaN
    f.sum(c) = known.select(e.samples().col(c).array(), 0.0).sum();
    f.count(c) = double(known.count());
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
      throw std::invalid_argument(fmt::format("lags: {} found, the window factors have {}", lags, factors_->lags));
    const auto own = factors_->of(k);
    rows = own.rightCols(width);
    // [1 V] [-mean; I]
    if (mean_.size() > 0)
      rows.rightCols(known).noalias() -= own.col(0) * mean_.segment((k + 1) * d - known, known).transpose();
    return factors_->rows[size_t(k)];
  }
  const auto window = ensemble_->samples().middleCols((k + 1) * d - known, known);
  rows.resize(experiments_, width);
  rows.leftCols(width - known).setZero();
  rows.rightCols(known) = window;
  // A missing sample makes the sum none.
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
  double total = 0.0;
  for (Index k = factors_->begin(); k < steps_; ++k) {
    Matrix samples;
    total += double(rows(k, 0, samples));
    square += samples.colwise().squaredNorm().transpose();
  }
  const Vector size = (square / std::max(1.0, total)).cwiseSqrt();
  return (size.array() > 0).select(size, 1.0);
}

}  // namespace tokid
