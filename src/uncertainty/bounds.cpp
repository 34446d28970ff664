// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/uncertainty.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <stdexcept>

#include "base/nan.hpp"
#include "data/check.hpp"
#include "uncertainty/interval.hpp"
#include "uncertainty/recursion.hpp"

namespace tokid {

namespace {

using uncertainty::Rows;
using uncertainty::StudentT;
using uncertainty::Variance;

constexpr double inf = std::numeric_limits<double>::infinity();

Interval unknown(Index rows, Index cols) {
  const Matrix none = Matrix::Constant(rows, cols, nan);
  return {none, none, none, none};
}

// Diagonals of Ψ_{k,l} Σ_l Ψ_{k,l}ᵀ (m × k-first+1), l = first … k. A leverage of one at step l adds column l to the
// variances of the outputs at step k. The column is infinite if Σ_l has no degree of freedom.
Matrix carried_variances(const GtvArx& arx, Index k, Index first) {
  const Index m = arx.outputs;
  std::vector<Matrix> transposed(size_t(k - first + 1), Matrix::Zero(m, m));  // Ψ_{k,l}ᵀ
  transposed.back().setIdentity();
  uncertainty::run_backwards(arx, first, k + 1, transposed);
  Matrix carried(m, k - first + 1);
  for (Index s = first; s <= k; ++s) {
    const Matrix& w = transposed[size_t(s - first)];
    auto column = carried.col(s - first);
    if (arx.step[size_t(s)].freedom > 0)
      column = (w.transpose() * uncertainty::innovation_cov(arx, s)).cwiseProduct(w.transpose()).rowwise().sum();
    else
      column = (w.array() != 0).colwise().any().transpose().select(Vector::Constant(m, inf), 0.0);
  }
  return carried;
}

// variance += leverage · carried, where zero times infinity is zero.
void add(double leverage, const Eigen::Ref<const Vector>& carried, Index freedom, Eigen::Ref<Vector> sum,
         Eigen::Ref<Vector> spread) {
  if (!(leverage > 0)) return;
  sum += leverage * carried;
  spread.array() += (leverage * carried.array()).square() / double(std::max<Index>(1, freedom));
}

// The effect of one pulse: its responses, and the leverages of the windows that contain it.
struct Pulse {
  Matrix response;   // (count·m × r): block γ is h_{i+γ,i}, h_{i,i} = D_i
  Matrix leverages;  // (count × r)
};

Pulse pulse(const GtvArx& arx, Index i, Index band) {
  const Index r = arx.inputs, m = arx.outputs, end = std::min(arx.steps(), i + band + 1);
  const Index origin = std::max<Index>(0, i - uncertainty::largest_lag_order(arx));
  Rows rows(arx, r, origin, end - origin);
  uncertainty::input(arx, rows, i).setIdentity();
  uncertainty::run(arx, i, end, rows);
  Pulse result{Matrix((end - i) * m, r), Matrix(end - i, r)};
  for (Index k = i; k < end; ++k) {
    result.response.middleRows((k - i) * m, m) = uncertainty::output(arx, rows, k).transpose();
    result.leverages.row(k - i) = uncertainty::leverages(arx, k, uncertainty::window(arx, rows, k)).transpose();
  }
  return result;
}

// The leverage of an estimated mean motion equals that of a regressor that is one in every experiment.
double nominal_leverage(const GtvArxStep& step) {
  const Index spent = step.freedom > 0 ? step.rows - step.rank - step.freedom : 0;
  return double(spent) / double(step.rows);
}

void check_channels(const GtvArx& arx, const Ensemble& data) {
  if (data.inputs() != arx.inputs || data.outputs() != arx.outputs || data.steps() > arx.steps())
    throw std::invalid_argument(
        fmt::format("data: {} inputs, {} outputs and {} steps found, {}, {} and at most {} needed", data.inputs(),
                    data.outputs(), data.steps(), arx.inputs, arx.outputs, arx.steps()));
  check_samples(data);
}

// The bounds of every output that depends on a missing sample become NaN.
Interval with_gaps(Interval interval) {
  const auto known = (interval.estimate.array() == interval.estimate.array()).eval();
  for (Matrix* part : {&interval.deviation, &interval.lower, &interval.upper})
    *part = known.select(part->array(), nan).matrix();
  return interval;
}

}  // namespace

RelativeError relative_error(const MarkovBounds& bounds) {
  Matrix errors = Matrix::Zero(bounds.outputs, bounds.inputs), widths = errors, sizes = errors;
  for (const Interval& step : bounds.step)
    for (Index block = 0; block <= bounds.band; ++block) {
      const auto part = [&](const Matrix& all) { return all.middleCols(block * bounds.inputs, bounds.inputs).array(); };
      const auto known = !part(step.deviation).isNaN();
      errors.array() += known.select(part(step.deviation).square(), 0.0);
      widths.array() += known.select(((part(step.upper) - part(step.lower)) / 2).square(), 0.0);
      sizes.array() += known.select(part(step.estimate).square(), 0.0);
    }
  const auto relative = [&](const Matrix& squares) -> Matrix {
    return (sizes.array() > 0).select((squares.array() / sizes.array()).sqrt(), nan);
  };
  return {relative(errors), relative(widths)};
}

MarkovBounds markov_bounds(const GtvArx& arx, Index band, const BoundsOptions& options) {
  if (band < 1) throw std::invalid_argument(fmt::format("band: {} found, at least 1 needed", band));
  arx.require_noise_shape();
  const StudentT t(options.level);
  const Index steps = arx.steps(), r = arx.inputs, m = arx.outputs;
  MarkovBounds result{r, m, std::min(band, std::max<Index>(1, steps - 1)), arx.k_begin, {}};
  band = result.band;
  std::vector<Pulse> pulses(size_t(steps), Pulse{});
  parallel_for(arx.k_begin, steps, {options.execution.threads, {}}, [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) pulses[size_t(i)] = pulse(arx, i, band);
  });
  result.step.assign(size_t(steps), unknown(m, (band + 1) * r));
  parallel_for(arx.k_begin, steps, options.execution, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) {
      const Index first = std::max(arx.k_begin, k - band), used = (k - first + 1) * r;
      const Matrix carried = carried_variances(arx, k, first);
      Matrix estimate(m, used);
      Variance variance(m, used);
      for (Index i = first; i <= k; ++i) {
        const Pulse& from = pulses[size_t(i)];
        estimate.middleCols((k - i) * r, r) = from.response.middleRows((k - i) * m, m);
        for (Index s = i; s <= k; ++s)
          for (Index c = 0; c < r; ++c) {
            const Index at = (k - i) * r + c;
            add(from.leverages(s - i, c), carried.col(s - first), arx.step[size_t(s)].freedom, variance.sum.col(at),
                variance.spread.col(at));
          }
      }
      const Interval found = uncertainty::interval(std::move(estimate), variance, t);
      Interval& all = result.step[size_t(k)];
      all.estimate.leftCols(used) = found.estimate;
      all.deviation.leftCols(used) = found.deviation;
      all.lower.leftCols(used) = found.lower;
      all.upper.leftCols(used) = found.upper;
    }
  });
  return result;
}

OutputBounds simulation_bounds(const GtvArx& arx, const Ensemble& data, const SimulationBoundsOptions& options) {
  check_channels(arx, data);
  arx.require_noise_shape();
  const StudentT t(options.level);
  const Index steps = data.steps(), m = arx.outputs, experiments = data.experiments();
  Rows rows(arx, experiments, 0, 0);
  rows.samples = data.samples();
  uncertainty::run(arx, arx.k_begin, steps, rows);
  Matrix leverages(steps, experiments);
  parallel_for(arx.k_begin, steps, {options.execution.threads, {}}, [&](Index begin, Index end) {
    for (Index s = begin; s < end; ++s) {
      leverages.row(s) = uncertainty::leverages(arx, s, uncertainty::window(arx, rows, s)).transpose().array() +
                         nominal_leverage(arx.step[size_t(s)]) + (options.noise ? 1.0 : 0.0);
    }
  });
  OutputBounds result;
  result.step.assign(size_t(steps), unknown(experiments, m));
  parallel_for(arx.k_begin, steps, options.execution, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) {
      const Matrix carried = carried_variances(arx, k, arx.k_begin);
      Variance variance(m, experiments);
      for (Index s = arx.k_begin; s <= k; ++s)
        for (Index n = 0; n < experiments; ++n)
          add(leverages(s, n), carried.col(s - arx.k_begin), arx.step[size_t(s)].freedom, variance.sum.col(n),
              variance.spread.col(n));
      variance.sum.transposeInPlace();
      variance.spread.transposeInPlace();
      result.step[size_t(k)] = with_gaps(uncertainty::interval(uncertainty::output(arx, rows, k), variance, t));
    }
  });
  return result;
}

OutputBounds prediction_bounds(const GtvArx& arx, const Ensemble& data, const BoundsOptions& options) {
  check_channels(arx, data);
  arx.require_noise_shape();
  const StudentT t(options.level);
  const Index steps = data.steps(), m = arx.outputs, experiments = data.experiments();
  OutputBounds result;
  result.step.assign(size_t(steps), unknown(experiments, m));
  parallel_for(arx.k_begin, steps, options.execution, [&](Index begin, Index end) {
    for (Index k = begin; k < end; ++k) {
      const GtvArxStep& step = arx.step[size_t(k)];
      const auto windows = data.window(k, step.lags).leftCols(arx.regressors(k));
      const Vector leverages = uncertainty::leverages(arx, k, windows).array() + nominal_leverage(step) + 1.0;
      const Matrix carried = carried_variances(arx, k, k);
      Variance variance(m, experiments);
      for (Index n = 0; n < experiments; ++n)
        add(leverages(n), carried.col(0), step.freedom, variance.sum.col(n), variance.spread.col(n));
      variance.sum.transposeInPlace();
      variance.spread.transposeInPlace();
      result.step[size_t(k)] = with_gaps(uncertainty::interval(windows * arx.coefficients(k).transpose(), variance, t));
    }
  });
  return result;
}

}  // namespace tokid
