// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/subspace.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <optional>
#include <stdexcept>

#include "base/integers.hpp"
#include "data/output_weights.hpp"
#include "data/pooled_windows.hpp"
#include "model/kalman_step.hpp"
#include "model/riccati.hpp"
#include "noise/changes_at_jumps.hpp"
#include "noise/moesp.hpp"
#include "noise/rounding.hpp"
#include "tokid/random_walk.hpp"

namespace tokid {

namespace {

// The number of singular values that the choice of the order usually needs.
constexpr Index usually_shown = 24;
// With this many rows per column, the sample covariance of a step is used without those of its neighbours.
constexpr double enough_rows = 5.0;

// The steps of the data in groups that share a model, and their samples.
class Steps {
 public:
  Steps(const Windows& e, const GtvArx& arx, const SubspaceOptions& o)
      : data(e), variation(o.variation), lags(largest_lags(arx)), begin(arx.k_begin) {
    if (e.inputs() != arx.inputs || e.outputs() != arx.outputs || e.steps() != arx.steps())
      throw std::invalid_argument(fmt::format("ARX model: {} steps, {} inputs, {} outputs found, {}, {}, {} needed",
                                              arx.steps(), arx.inputs, arx.outputs, e.steps(), e.inputs(),
                                              e.outputs()));
    if (variation.period > 0 && e.steps() < lags + std::min(variation.period, e.steps()))
      throw std::invalid_argument(fmt::format("steps: {} found, at least {} needed (lag order and period)", e.steps(),
                                              lags + variation.period));
    if (!pools_windows(e, groups())) return;
    together_ = arx.window_factor;
    if (!together_)
      together_ = std::make_shared<Matrix>(pooled_window_factor(e, lags, begin, e.steps(), {o.execution.threads, {}}));
    const std::vector<Index> counts = window_counts(e, lags, begin, e.steps());
    together_count_ = double(std::accumulate(counts.begin(), counts.end(), Index{0}));
  }

  Index groups() const { return variation.groups(data.steps()); }
  Index group(Index k) const { return variation.group(k); }
  Index next(Index g) const { return variation.period > 0 ? (g + 1) % groups() : g + 1; }
  bool varying() const { return variation.period == 0; }
  // If coefficients vary slowly, they continue beyond both ends of the experiments. Then all steps can have all states.
  bool smooth() const { return varying() && variation.smoothing > 0; }
  // The steps of group g that a regression uses.
  std::vector<Index> of(Index g) const {
    std::vector<Index> steps;
    for (Index k = g; k < data.steps(); k += varying() ? data.steps() : groups())
      if (k >= begin) steps.push_back(k);
    return steps;
  }
  // A step with the ARX model of `a` steps after group g, and with all p lags.
  Index shown(Index g, Index a) const {
    if (varying()) return std::min(g + a, data.steps() - 1);
    Index k = g + a;
    while (k < lags) k += groups();
    while (k >= data.steps()) k -= groups();
    return k;
  }
  // The number of block rows of the predictor at group g.
  Index future(Index g, Index f) const { return varying() && !smooth() ? std::min(f, data.steps() - g) : f; }

  Index width() const { return lags * data.channels(); }  // number of columns of the past samples

  // Calls body(k, window, count) for the steps k of group g that a regression uses, with the rows [z_k u_k y_k] and the
  // number of experiments that they represent. If there is only one group, its windows come as one factor.
  template <class Body>
  void each_window(Index g, Body&& body) const {
    if (together_) return body(begin, *together_, together_count_);
    for (const Index k : of(g)) body(k, data.rows(k, lags), double(data.count(k, lags)));
  }

  const Windows& data;
  TimeVariation variation;
  Index lags, begin;

 private:
  static Index largest_lags(const GtvArx& arx) {
    Index p = 1;
    for (const GtvArxStep& s : arx.step) p = std::max(p, s.lags);
    return p;
  }

  std::shared_ptr<const Matrix> together_;  // the windows of the only group of a long record
  double together_count_ = 0.0;
};

// The smallest noise of an output relative to its size, compared with the largest such ratio of all outputs. An output
// with less noise is treated as if it had this much noise. Otherwise such outputs would determine all states.
constexpr double least_weighed = 1e-5;

// The matrices that weight the errors of the outputs: whiteners of the innovations, pooled if the model is smooth. An
// output with a smaller weight has larger innovations here, by independent noise.
std::vector<Matrix> whiteners(const GtvArx& arx, const SubspaceOptions& o) {
  const Index m = arx.outputs;
  const Vector factors = unit_factors(o.output_weights, m).cwiseAbs2();
  std::vector<Matrix> result(arx.step.size());
  const bool pooled = o.variation.smoothing > 0 || o.variation.period > 0 || !o.noisy;
  Matrix covariance = Matrix::Zero(m, m);
  for (Index k = arx.k_begin; k < arx.steps(); ++k) {
    const Vector squares = arx.output_rms(k).cwiseAbs2();
    Matrix own = squares.asDiagonal();
    if (o.noisy) {
      own = arx.residual_cov(k);
      double noisiest = 0.0;
      for (Index j = 0; j < m; ++j)
        if (squares(j) > 0) noisiest = std::max(noisiest, own(j, j) / squares(j));
      own.diagonal() = own.diagonal().cwiseMax(least_weighed * least_weighed * noisiest * squares);
    }
    own.diagonal().array() *= factors.array();
    if (pooled)
      covariance += own / double(arx.steps());
    else
      result[size_t(k)] = linalg::whitener(own);
  }
  if (pooled) std::fill(result.begin(), result.end(), linalg::whitener(covariance));
  return result;
}

// M (f·m × p·d): block row a predicts the weighted output a steps after group g from the past.
Matrix predictor(const Steps& steps, const GtvArx& arx, const std::vector<Matrix>& whitener, Index g, Index f,
                 Weighting weighting) {
  const Index d = arx.inputs + arx.outputs, m = arx.outputs, p = steps.lags;
  Matrix result = Matrix::Zero(f * m, p * d);
  for (Index a = 0; a < f; ++a) {
    const Index k = steps.shown(g, a);
    const GtvArxStep& s = arx.step[size_t(k)];
    auto row = result.middleRows(a * m, m);
    const Index lags = s.lags - a;  // lags that reach before group g, beyond the `a` samples after it
    if (lags > 0) row.middleCols((p - lags) * d, lags * d) = arx.coefficients(k).leftCols(lags * d);
    if (weighting == Weighting::many_steps)
      for (Index j = 1; j <= std::min(a, s.lags); ++j)
        row += arx.output_block(k, j) * result.middleRows((a - j) * m, m);
  }
  for (Index a = 0; a < f; ++a) {
    auto row = result.middleRows(a * m, m);
    row = whitener[size_t(steps.shown(g, a))] * row.eval();
  }
  return result;
}

// Triangular factor of the past samples of a group, and the number of experiments that it represents.
struct Past {
  Matrix factor;
  double rows = 0.0;

  void add(const Matrix& z, double count, double weight) {
    Matrix both = linalg::stacked(factor, std::sqrt(weight) * z);
    factor = linalg::triangular_factor(both);
    rows += weight * count;
  }
};

std::vector<Past> pasts(const Steps& steps, const SubspaceOptions& o) {
  std::vector<Past> own(size_t(steps.groups()));
  parallel_for(0, steps.groups(), {o.execution.threads, {}}, [&](Index from, Index to) {
    for (Index g = from; g < to; ++g) {
      linalg::RowStack rows(steps.width());
      steps.each_window(g, [&](Index, const Matrix& window, double count) {
        rows.add(window.leftCols(steps.width()));
        own[size_t(g)].rows += count;
      });
      own[size_t(g)].factor = rows.factor();
    }
  });
  // Few experiments do not determine the covariance of so many samples. Therefore neighbouring steps contribute with
  // exponentially falling weights.
  const double width = double(steps.lags * steps.data.channels());
  double reach = enough_rows * width / double(std::max<Index>(1, steps.data.experiments()));
  for (Index g = steps.begin; g < steps.groups(); ++g)
    if (own[size_t(g)].rows < enough_rows * width) reach = std::max(reach, 1.0);  // samples are missing
  if (!steps.varying() || o.variation.smoothing == 0 || reach < 1) return own;
  const double weight = std::exp(-2 / reach);
  std::vector<Past> all = own;
  Past before, after;
  for (size_t g = 0; g < own.size(); ++g) {
    if (before.rows > 0) all[g].add(before.factor, before.rows, weight);
    before = all[g];
  }
  for (size_t g = own.size(); g-- > 0;) {
    const Past later = after;
    after = own[g];
    if (later.rows > 0) {
      after.add(later.factor, later.rows, weight);
      all[g].add(later.factor, later.rows, weight);
    }
  }
  return all;
}

const Ensemble& ensemble_of(const Windows& windows) {
  if (!windows.ensemble())
    throw std::invalid_argument(
        "weighting: projection found, but it needs the experiments, and only their "
        "factors are there. Use another weighting");
  return *windows.ensemble();
}

}  // namespace

PredictorFactors predictor_factors(const Windows& windows, const GtvArx& arx, const SubspaceOptions& o) {
  if (o.weighting == Weighting::projection) return projection_factors(ensemble_of(windows), arx, o);
  const Steps steps(windows, arx, o);
  PredictorFactors result;
  result.lags = steps.lags;
  result.k_begin = steps.begin;
  const Index usual = std::min(steps.lags, ceil_div(usually_shown, arx.outputs));
  const bool suffice = o.weighting == Weighting::one_step && 2 * o.states <= usual * arx.outputs;
  result.future = o.future > 0 ? o.future : suffice ? usual : steps.lags;
  result.group.resize(size_t(steps.groups()));
  const std::vector<Matrix> weights = whiteners(arx, o);
  const std::vector<Past> past = pasts(steps, o);
  parallel_for(0, steps.groups(), o.execution, [&](Index from, Index to) {
    for (Index g = from; g < to; ++g) {
      const Past& z = past[size_t(g)];
      if (steps.of(g).empty()) continue;
      const Matrix m = predictor(steps, arx, weights, g, steps.future(g, result.future), o.weighting);
      const linalg::Svd d = linalg::svd(m * z.factor.transpose() / std::sqrt(std::max(1.0, z.rows)));
      PredictorFactor& factor = result.group[size_t(g)];
      factor.singular_values = d.s;
      const Index q = (d.s.array() > 1e-14 * (d.s.size() > 0 ? d.s(0) : 0.0)).count();
      const Vector root = d.s.head(q).cwiseSqrt();
      factor.observability = d.u.leftCols(q) * root.asDiagonal();
      factor.state = root.cwiseInverse().asDiagonal() * (d.u.leftCols(q).transpose() * m);
    }
  });
  return result;
}

namespace {

// The states of one order: maps from the past samples, aligned from step to step.
struct StateMaps {
  std::vector<Matrix> of;  // (groups, and one after the last step) n_k × p·d
};

StateMaps state_maps(const Steps& steps, const PredictorFactors& factors, const SubspaceOptions& o) {
  double largest = 0.0;
  for (const PredictorFactor& f : factors.group)
    if (f.singular_values.size() > 0) largest = std::max(largest, f.singular_values(0));
  StateMaps maps;
  Matrix previous(0, 0);
  for (const PredictorFactor& f : factors.group) {
    Index n = f.observability.cols();
    if (!o.noisy) n = std::min<Index>(n, (f.singular_values.array() > rounding::arithmetic * largest).count());
    if (o.states > 0) n = std::min(n, o.states);
    Matrix map = f.state.topRows(n);
    if (map.cols() == 0) map.resize(0, steps.width());
    if (steps.varying() && n > 0) {
      // Orthogonal Procrustes alignment with the previous step: the matrices then vary as slowly as the system varies.
      Matrix own = f.observability.leftCols(n);
      const Index common = std::min(own.rows(), previous.rows()), shared = std::min(n, previous.cols());
      if (common > 0 && shared > 0) {
        Matrix target = Matrix::Zero(common, n);
        target.leftCols(shared) = previous.topLeftCorner(common, shared);
        const Matrix rotation = linalg::procrustes(own.topRows(common), target);
        own *= rotation;
        map = rotation.transpose() * map;
      }
      previous = own;
    }
    maps.of.push_back(std::move(map));
  }
  // x_T affects no output. The first samples of the data do not determine the full state.
  if (steps.varying()) maps.of.push_back(steps.smooth() ? maps.of.back() : Matrix(0, steps.width()));
  if (steps.smooth()) {
    Index most = 0;
    for (const Matrix& map : maps.of) most = std::max(most, map.rows());
    size_t first = size_t(steps.begin);
    while (first < maps.of.size() && maps.of[first].rows() < most) ++first;
    for (size_t g = size_t(steps.begin); g < first; ++g) maps.of[g] = maps.of[first];
    for (size_t g = first + 1; g < maps.of.size(); ++g)
      if (maps.of[g].rows() < most) maps.of[g] = maps.of[g - 1];  // samples are missing
  }
  return maps;
}

// Coefficients (right × regressors) of one group of steps, and the residual of the right side.
struct Fitted {
  Matrix coefficients;
  Matrix residual;         // triangular (· × right): residualᵀ·residual is the sum of squares
  Vector squares;          // (right) sums of the squares of the right side
  double rows = 0.0;       // number of experiments, summed over the steps of the group
  Index rank = 0;          // rank of the group's own regressors
  double condition = 0.0;  // condition number of the regressors, within their rank
};

// Rank and condition number of regressors. The columns are scaled to norm 1, so that rank and condition do not depend
// on units. The eigenvalues of their products are fast to compute, and accurate if no singular value is small.
void examine(const ConstMatrixRef& regressors, Fitted& fitted) {
  constexpr double small = 1e-6;  // square of the ratio of two singular values
  if (regressors.size() == 0) return;
  const Matrix scaled = regressors * linalg::inverse_norms(regressors).asDiagonal();
  const Vector squares = linalg::symmetric_eigenvalues(scaled.transpose() * scaled);
  const double least = squares(0), largest = squares(squares.size() - 1);
  if (least > small * largest) {
    fitted.rank = squares.size();
    fitted.condition = std::sqrt(largest / least);
    return;
  }
  const Vector sigma = linalg::singular_values(scaled);
  fitted.rank = sigma.size() > 0 ? (sigma.array() > rounding::negligible * sigma(0)).count() : 0;
  fitted.condition = fitted.rank > 0 ? sigma(0) / sigma(fitted.rank - 1) : 0.0;
}

// Regressions of all groups. rows_of(k, window) gives [regressors right] of a step, or an empty matrix.
template <class Rows>
std::vector<Fitted> regress(const Steps& steps, const SubspaceOptions& o, Index future,
                            const std::vector<Index>& regressors, Rows&& rows_of) {
  const size_t groups = size_t(steps.groups());
  std::vector<Matrix> factor(groups);
  std::vector<Fitted> result(groups);
  parallel_for(0, steps.groups(), {o.execution.threads, {}}, [&](Index from, Index to) {
    for (Index g = from; g < to; ++g) {
      std::optional<linalg::RowStack> rows;
      steps.each_window(g, [&](Index k, const Matrix& window, double count) {
        const Matrix block = rows_of(k, window);
        if (block.cols() == 0) return;
        if (!rows) rows.emplace(block.cols());
        rows->add(block);
        result[size_t(g)].rows += count;
      });
      if (rows) factor[size_t(g)] = rows->factor();
    }
  });
  const double smoothing = !steps.smooth()         ? 0.0
                           : o.state_smoothing < 0 ? SubspaceOptions::state_share * o.variation.smoothing
                                                   : o.state_smoothing;
  const auto solve = [&](size_t begin, size_t end) {
    const Index l = regressors[begin];
    Vector rms = Vector::Zero(l);
    for (size_t g = begin; g < end; ++g) rms += factor[g].leftCols(l).colwise().squaredNorm().transpose();
    rms = (rms / double(end - begin)).cwiseSqrt();
    rms = (rms.array() > 0).select(rms, 1.0);  // columns of equal size, so that the rank does not depend on units
    std::vector<Matrix> rows(factor.begin() + std::ptrdiff_t(begin), factor.begin() + std::ptrdiff_t(end));
    for (Matrix& block : rows) block.leftCols(l) *= rms.cwiseInverse().asDiagonal();
    // The state predicts f outputs, so that its coordinates change over the f steps to a jump.
    const std::vector<Index> loose = changes_at_jumps(o.variation.jumps, future - 1, 0, Index(begin));
    const std::vector<Matrix> x = random_walk_regression(rows, l, Vector::Constant(l, std::sqrt(smoothing)), loose);
    for (size_t g = begin; g < end; ++g) {
      const Matrix& block = rows[g - begin];
      const auto right = block.rightCols(block.cols() - l);
      Matrix left = right - block.leftCols(l) * x[g - begin];
      result[g].squares = right.colwise().squaredNorm();
      examine(block.leftCols(l), result[g]);
      result[g].coefficients = (rms.cwiseInverse().asDiagonal() * x[g - begin]).transpose();
      result[g].residual = linalg::triangular_factor(left);
    }
  };
  // Neighbours determine the coefficients of steps without a row.
  Index most = 0;
  for (const Matrix& rows : factor) most = std::max(most, rows.cols());
  for (Index g = steps.begin; g < steps.groups(); ++g)
    if (Matrix& rows = factor[size_t(g)]; steps.smooth() && rows.cols() == 0) rows.resize(0, most);
  // Successive steps with the same numbers of coefficients share a penalty.
  for (size_t begin = 0, end = 0; begin < groups; begin = end) {
    for (end = begin + 1; smoothing > 0 && end < groups && regressors[end] == regressors[begin] &&
                          factor[end].cols() == factor[begin].cols();)
      ++end;
    if (factor[begin].cols() > 0) solve(begin, end);
  }
  return result;
}

// The two regressions on the states: of the outputs and of the next states.
class StateRegressions {
 public:
  StateRegressions(const Steps& steps, const StateMaps& maps, Index future, bool feedthrough,
                   const SubspaceOptions& options)
      : steps_(steps),
        maps_(maps),
        options_(options),
        future_(future),
        r_(steps.data.inputs()),
        m_(steps.data.outputs()),
        through_(feedthrough ? r_ : 0),
        errors_(options.noisy ? m_ : 0) {}

  Index states(Index g) const { return maps_.of[size_t(g)].rows(); }
  Index output_regressors(Index g) const { return states(g) + through_; }
  Index state_regressors(Index g) const { return states(g) + r_ + errors_; }

  // y on [x; u], or on x alone without feedthrough. The coefficients are [C D]; without feedthrough, D = 0.
  std::vector<Fitted> outputs() const {
    std::vector<Fitted> result = fitted(&StateRegressions::output_regressors, [&](Index k, const Matrix& window) {
      const Index n = states(steps_.group(k));
      const Matrix samples = samples_of(window, k);
      return linalg::beside(samples.leftCols(n + through_), samples.rightCols(m_));
    });
    for (Index g = 0; g < steps_.groups(); ++g)
      if (Fitted& y = result[size_t(g)]; y.rows > 0 || y.coefficients.size() > 0) {
        const Matrix known = y.coefficients.reshaped(m_, output_regressors(g));
        y.coefficients = linalg::beside(known, Matrix::Zero(m_, r_ - through_));
      }
    return result;
  }

  // x⁺ on [x; u; ε], with ε from the regression of the outputs. Without noise there is no ε, and the observer gain
  // comes from the map of the next state.
  std::vector<Fitted> next_states(const std::vector<Fitted>& outputs) const {
    return fitted(&StateRegressions::state_regressors, [&](Index k, const Matrix& window) {
      if (k + 1 >= steps_.data.steps() && !steps_.smooth()) return Matrix();
      const Index g = steps_.group(k), known = states(g) + r_;
      const Matrix samples = samples_of(window, k);
      const Matrix next = window.rightCols(steps_.width()) * maps_.of[size_t(steps_.next(g))].transpose();
      Matrix both(samples.rows(), known + errors_ + next.cols());
      both.leftCols(known) = samples.leftCols(known);
      if (options_.noisy) {
        Matrix innovations =
            samples.rightCols(m_) - samples.leftCols(known) * outputs[size_t(g)].coefficients.transpose();
        drop_rounding(innovations, samples.rightCols(m_).colwise().norm());
        both.middleCols(known, m_) = innovations;
      }
      both.rightCols(next.cols()) = next;
      return both;
    });
  }

 private:
  template <class Rows>
  std::vector<Fitted> fitted(Index (StateRegressions::*regressors_of)(Index) const, Rows&& rows_of) const {
    std::vector<Index> regressors;
    for (Index g = 0; g < steps_.groups(); ++g) regressors.push_back((this->*regressors_of)(g));
    return regress(steps_, options_, future_, regressors, rows_of);
  }

  Matrix samples_of(const Matrix& window, Index k) const {  // [x u y]
    const Matrix x = window.leftCols(steps_.width()) * maps_.of[size_t(steps_.group(k))].transpose();
    return linalg::beside(x, window.rightCols(r_ + m_));
  }

  const Steps& steps_;
  const StateMaps& maps_;
  const SubspaceOptions& options_;
  Index future_, r_, m_, through_, errors_;  // inputs, outputs, inputs with feedthrough, innovations
};

// The residuals of the regressions as roots of the covariances of each step. With few experiments, all steps of full
// dimension share one covariance. With many experiments, each step has its own.
NoiseRoots noise_roots(const Steps& steps, const StateRegressions& sizes, const std::vector<Fitted>& outputs,
                       const std::vector<Fitted>& next_states, Index begin, Index end, const SubspaceOptions& o) {
  const Index m = steps.data.outputs();
  const bool pooled = o.variation.smoothing > 0 && steps.varying();
  Index most = 0;
  for (Index g = 0; g < steps.groups(); ++g) most = std::max(most, sizes.states(g));
  const auto full = [&](Index g) { return sizes.states(g) == most && sizes.states(steps.next(g)) == most; };
  linalg::RowStack all_outputs(m), all_states(most);
  double rows_outputs = 0.0, rows_states = 0.0;
  Vector squares = Vector::Zero(m);
  for (Index g = 0; g < steps.groups(); ++g) {
    const Fitted &y = outputs[size_t(g)], &x = next_states[size_t(g)];
    if (y.rows > 0) {
      squares += y.squares;
      if (pooled) all_outputs.add(y.residual);
    }
    rows_outputs += y.rows;
    if (!pooled || !full(g) || x.rows == 0) continue;
    all_states.add(x.residual);
    rows_states += x.rows;
  }
  const Matrix shared_outputs = all_outputs.factor(), shared_states = all_states.factor();
  const auto root = [](const Matrix& residual, double rows, Index spent, Index size) -> Matrix {
    if (residual.cols() != size) return Matrix::Zero(0, size);
    return residual / std::sqrt(std::max(1.0, rows - double(spent)));
  };
  NoiseRoots noise;
  noise.output_size = (squares / std::max(1.0, rows_outputs)).cwiseSqrt();
  for (Index k = begin; k < end; ++k) {
    const Index g = steps.group(k), next = sizes.states(steps.next(g));
    const Fitted &y = outputs[size_t(g)], &x = next_states[size_t(g)];
    noise.innovation.push_back(pooled ? root(shared_outputs, rows_outputs, 0, m)
                                      : root(y.residual, y.rows, sizes.output_regressors(g), m));
    noise.state.push_back(pooled && full(g) ? root(shared_states, rows_states, 0, next)
                                            : root(x.residual, x.rows, sizes.state_regressors(g), next));
  }
  return noise;
}

}  // namespace

Model realise(const Windows& e, const GtvArx& arx, const PredictorFactors& factors, const SubspaceOptions& o) {
  if (o.weighting == Weighting::projection) return moesp(ensemble_of(e), arx, factors, o);
  const Steps steps(e, arx, o);
  const Index r = e.inputs(), m = e.outputs();
  const StateMaps maps = state_maps(steps, factors, o);
  const StateRegressions regressions(steps, maps, factors.future, arx.feedthrough, o);
  const std::vector<Fitted> outputs = regressions.outputs(), next_states = regressions.next_states(outputs);

  Model model;
  model.inputs = r;
  model.outputs = m;
  model.dt = e.dt;
  model.names = e.names;
  model.method = "subspace";
  model.period = o.variation.period;
  if (steps.smooth()) model.frame = "smooth";
  model.k_begin = steps.varying() ? steps.begin : 0;
  const Index own = steps.varying() ? e.steps() : steps.groups();  // the steps of later periods repeat them
  const NoiseRoots noise = noise_roots(steps, regressions, outputs, next_states, model.k_begin, own, o);
  for (Index k = model.k_begin; k < own; ++k) {
    const Index group = steps.group(k), next_group = steps.next(group);
    const Index n = regressions.states(group), next = regressions.states(next_group);
    const size_t g = size_t(group);
    const Fitted &y = outputs[g], &x = next_states[g];
    const Matrix ab =
        x.coefficients.size() > 0 ? x.coefficients : Matrix(Matrix::Zero(next, regressions.state_regressors(group)));
    const Matrix cd = y.coefficients.size() > 0 ? y.coefficients : Matrix(Matrix::Zero(m, n + r));
    Step& step = model.step.emplace_back(n, next, r, m);
    step.A() = ab.leftCols(n);
    step.B() = ab.middleCols(n, r);
    step.C() = cd.leftCols(n);
    step.D() = cd.rightCols(r);
    step.G() = o.noisy ? -ab.rightCols(m) : -maps.of[size_t(next_group)].rightCols(m);
    step.set_innovation_cov(kalman::covariance_of(noise.innovation[size_t(k - model.k_begin)]));
    step.set_singular_values(factors.group[g].singular_values);
    step.set_condition(y.condition);
    step.set_rank(y.rank);
    step.set_lags(steps.varying() && arx.step[size_t(k)].lags > 0 ? arx.step[size_t(k)].lags : steps.lags);
  }
  model = continued(std::move(model), e.steps());
  if (o.noisy) filter_gains(model, noise);
  return model;
}

Model subspace(const Windows& windows, const GtvArx& arx, const SubspaceOptions& options) {
  return realise(windows, arx, predictor_factors(windows, arx, options), options);
}

}  // namespace tokid
