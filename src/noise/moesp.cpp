// SPDX-License-Identifier: BSD-3-Clause
#include "noise/moesp.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <numeric>
#include <stdexcept>

#include "data/channel_sizes.hpp"
#include "data/output_weights.hpp"
#include "data/pooled_windows.hpp"
#include "linalg/row_absorption.hpp"
#include "model/kalman_step.hpp"
#include "model/riccati.hpp"
#include "noise/rounding.hpp"

namespace tokid {

namespace {

// The largest growth of a simulated state. Beyond it, the simulation starts anew.
constexpr double most_growth = 100.0;

// Units of the outputs. An output with a smaller weight has a larger unit.
Vector weighted_sizes(const Ensemble& e, const SubspaceOptions& o) {
  return channel_sizes(e, e.inputs(), e.outputs()).cwiseProduct(unit_factors(o.output_weights, e.outputs()));
}

class Moesp {
 public:
  Moesp(const Ensemble& e, const GtvArx& arx, const PredictorFactors& factors, const SubspaceOptions& o)
      : e_(e),
        factors_(factors),
        variation_(o.variation),
        groups_(o.variation.groups(e.steps())),
        r_(e.inputs()),
        m_(e.outputs()),
        through_(arx.feedthrough ? e.inputs() : 0),
        lags_(factors.lags),
        from_rest_(arx.k_begin == 0),
        noisy_(o.noisy),
        sizes_(weighted_sizes(e, o)) {
    if (pools_windows(e, groups_)) {
      const Index begin = from_rest_ ? 0 : lags_;
      windows_ = arx.window_factor;
      if (!windows_)
        windows_ =
            std::make_shared<Matrix>(pooled_window_factor(e, lags_, begin, e.steps(), {o.execution.threads, {}}));
      const std::vector<Index> counts = window_counts(e, lags_, begin, e.steps());
      windows_count_ = double(std::accumulate(counts.begin(), counts.end(), Index{0}));
    }
    n_ = o.states > 0 ? o.states : factors.future * m_;
    for (const PredictorFactor& f : factors.group) {
      n_ = std::min(n_, f.observability.cols());
      if (!noisy_)
        n_ = std::min<Index>(n_,
                             (f.singular_values.array() > rounding::arithmetic * f.singular_values.maxCoeff()).count());
    }
  }

  Model run() {
    model_.inputs = r_;
    model_.outputs = m_;
    model_.dt = e_.dt;
    model_.names = e_.names;
    model_.method = "subspace";
    model_.period = variation_.period;
    model_.step.assign(size_t(groups_), Step(n_, n_, r_, m_));
    shift();
    simulate_inputs();
    for (size_t g = 0; g < model_.step.size(); ++g) {
      model_.step[g].set_lags(lags_);
      model_.step[g].set_singular_values(factors_.group[g].singular_values);
    }
    find_gains();
    return std::move(model_);
  }

 private:
  Index next(Index g) const { return (g + 1) % groups_; }
  auto observability(Index g) const { return factors_.group[size_t(g)].observability.leftCols(n_); }
  // x_k = state · z_k
  auto state(Index g) const { return factors_.group[size_t(g)].state.topRows(n_); }

  void shift() {
    const Index rows = (factors_.future - 1) * m_;
    for (Index g = 0; g < groups_; ++g) {
      Step& step = model_.step[size_t(g)];
      step.C() = sizes_.asDiagonal() * observability(g).topRows(m_);
      step.A() = linalg::minimum_norm(observability(next(g)).topRows(rows), observability(g).bottomRows(rows),
                                      rounding::negligible)
                     .x;
    }
  }

  // Computes B and D. The outputs are linear in B, D and the state at the start of each stretch of known inputs:
  //   y_k = C Φ x_0 + Σ_j C Φ_{k,j+1} B u_j + D u_k
  void simulate_inputs() {
    const Index b = groups_ * n_ * r_, d = groups_ * m_ * through_, unknowns = b + d;
    linalg::RowAbsorption all, stretch;
    all.reset(unknowns + 1);
    for (Index n = 0; n < e_.experiments(); ++n)
      for (Index begin = 0, end = 0; begin < e_.steps(); begin = std::max(end, begin + 1)) {
        end = stretch_end(n, begin);
        if (end > begin) all.absorb(stretch_rows(n, begin, end, b, stretch));
      }
    free_.clear();
    const Matrix factor = all.factor();
    const Vector scale = linalg::inverse_norms(factor.leftCols(unknowns));
    const Vector theta = scale.asDiagonal() * linalg::minimum_norm(factor.leftCols(unknowns) * scale.asDiagonal(),
                                                                   factor.rightCols(1), rounding::negligible)
                                                  .x;
    for (Index g = 0; g < groups_; ++g) {
      Step& step = model_.step[size_t(g)];
      step.B() = theta.segment(g * n_ * r_, n_ * r_).reshaped(n_, r_);
      step.D().leftCols(through_) =
          sizes_.asDiagonal() * theta.segment(b + g * m_ * through_, m_ * through_).reshaped(m_, through_);
    }
  }

  // The outputs of the states at the first step of a stretch, relative to their sizes: C_k Φ_{k,begin} (m × n) of the
  // steps from `begin` on. They depend on the phase of `begin` alone. They end where a state has grown by more than
  // most_growth.
  struct FreeResponse {
    std::vector<Matrix> outputs;
    Matrix growth;  // Φ of the next step
  };

  // Does the response reach the step `begin` + `after`?
  bool reaches(Index begin, Index after) {
    FreeResponse& free = free_[variation_.group(begin)];
    if (free.outputs.empty()) free.growth = Matrix::Identity(n_, n_);
    while (Index(free.outputs.size()) <= after && free.growth.norm() < most_growth * std::sqrt(double(n_))) {
      const Step& step = model_.step[size_t(variation_.group(begin + Index(free.outputs.size())))];
      free.outputs.push_back(sizes_.cwiseInverse().asDiagonal() * (step.C() * free.growth));
      free.growth = step.A() * free.growth;
    }
    return after < Index(free.outputs.size());
  }

  // The end of a stretch. Within a stretch, all inputs are known, and the state grows by at most most_growth.
  Index stretch_end(Index n, Index begin) {
    Index end = begin;
    while (end < e_.steps() && e_.input(end).row(n).allFinite() && reaches(begin, end - begin)) ++end;
    return end;
  }

  // [∂y/∂B ∂y/∂D y] of the steps begin … end-1, with outputs relative to their sizes. The rows are orthogonal to the
  // effect of an unknown state at the start of the stretch. `factor`: kept to reuse its memory.
  Matrix stretch_rows(Index n, Index begin, Index end, Index b, linalg::RowAbsorption& factor) const {
    const bool known = begin == 0 && from_rest_;
    const Index start = known ? 0 : n_, unknowns = b + groups_ * m_ * through_;
    const std::vector<Matrix>& free = free_.at(variation_.group(begin)).outputs;
    Matrix rows = Matrix::Zero((end - begin) * m_, start + unknowns + 1);
    // ∂x_k/∂B. With one set of matrices, the m rows of C ∂x_k/∂B go on by themselves, and take fewer operations.
    const bool one = groups_ == 1;
    Matrix x = Matrix::Zero(one ? 0 : n_, b), response = Matrix::Zero(m_, b);
    Index used = 0;
    for (Index k = begin; k < end; ++k) {
      const Index g = variation_.group(k);
      const Step& step = model_.step[size_t(g)];
      if (!one) response = sizes_.cwiseInverse().asDiagonal() * (step.C() * x);
      for (Index j = 0; j < m_; ++j) {
        if (std::isnan(e_.y(n, k, j))) continue;
        rows.row(used).head(start) = free[size_t(k - begin)].row(j).head(start);
        rows.row(used).segment(start, b) = response.row(j);
        for (Index i = 0; i < through_; ++i) rows(used, start + b + (g * through_ + i) * m_ + j) = e_.u(n, k, i);
        rows(used++, start + unknowns) = e_.y(n, k, j) / sizes_(j);
      }
      if (!one) x = step.A() * x;
      for (Index i = 0; i < r_; ++i)
        if (one)
          response.middleCols(i * n_, n_) = response.middleCols(i * n_, n_) * step.A() + e_.u(n, k, i) * free[0];
        else
          x.middleCols((g * r_ + i) * n_, n_).diagonal().array() += e_.u(n, k, i);
    }
    if (start == 0) return rows.topRows(used);
    factor.reset(rows.cols());
    factor.absorb(rows.topRows(used));
    const Index left = std::clamp<Index>(used - start, 0, unknowns + 1);
    return factor.factor().block(start, start, left, unknowns + 1);
  }

  // Computes the gains from the state samples: ε = y - C x - D u and w = x⁺ - A x - B u give w = -G ε + w'.
  void find_gains() {
    std::vector<linalg::RowStack> stacks(size_t(groups_), linalg::RowStack(m_ + n_));  // [ε w]
    Vector squares = Vector::Zero(m_);                                                 // sums of the squares of y
    Vector count = Vector::Zero(groups_);
    const Index width = lags_ * e_.channels();
    const auto add = [&](Index g, const Matrix& rows, double experiments) {
      const auto u = rows.middleCols(width, r_), y = rows.rightCols(m_);
      const Matrix x = rows.leftCols(width) * state(g).transpose();
      Matrix residuals(rows.rows(), m_ + n_);
      const size_t s = size_t(g);
      residuals.leftCols(m_) = y - x * model_.step[s].C().transpose() - u * model_.step[s].D().transpose();
      residuals.rightCols(n_) = rows.middleCols(e_.channels(), width) * state(next(g)).transpose() -
                                x * model_.step[s].A().transpose() - u * model_.step[s].B().transpose();
      stacks[s].add(residuals);
      squares += y.colwise().squaredNorm().transpose();
      count(g) += experiments;
    };
    if (windows_) add(0, *windows_, windows_count_);
    const bool every_row = e_.missing() == 0;
    for (Index k = lags_; !windows_ && k + 1 < e_.steps(); ++k) {
      const auto window = e_.window_and_output(k, lags_);
      const Matrix rows = every_row ? Matrix(window) : Matrix(window(e_.complete_rows(k, lags_), Eigen::all));
      add(variation_.group(k), rows, double(rows.rows()));
    }
    std::vector<Matrix> gain;
    NoiseRoots noise;
    noise.output_size = (squares / std::max(1.0, count.sum())).cwiseSqrt();
    for (Index g = 0; g < groups_; ++g) {
      const Matrix factor = stacks[size_t(g)].factor() / std::sqrt(std::max(1.0, count(g)));
      Matrix innovations = factor.leftCols(m_), rest = factor.rightCols(n_);
      drop_rounding(innovations, noise.output_size);
      gain.emplace_back(-kalman::prediction_gain(innovations, rest));
      noise.innovation.push_back(std::move(innovations));
      noise.state.push_back(std::move(rest));
    }
    for (Index g = 0; g < groups_; ++g) {
      Step& step = model_.step[size_t(g)];
      // Without noise there is no ε. The gain then comes from the map of the next state.
      step.G() = noisy_ ? gain[size_t(g)] : Matrix(-state(next(g)).rightCols(m_));
      step.set_innovation_cov(kalman::covariance_of(noise.innovation[size_t(g)]));
    }
    model_ = continued(std::move(model_), e_.steps());
    if (noisy_) filter_gains(model_, noise);
  }

  const Ensemble& e_;
  const PredictorFactors& factors_;
  TimeVariation variation_;
  Index groups_, r_, m_, through_, lags_, n_ = 0;  // through_: number of inputs with feedthrough
  bool from_rest_, noisy_;
  Vector sizes_;
  std::map<Index, FreeResponse> free_;     // of the phase of the first step
  std::shared_ptr<const Matrix> windows_;  // of the only group of a long record: the factor of its windows
  double windows_count_ = 0.0;
  Model model_;
};

}  // namespace

PredictorFactors projection_factors(const Ensemble& e, const GtvArx& arx, const SubspaceOptions& o) {
  Index lags = 1;
  for (const GtvArxStep& s : arx.step) lags = std::max(lags, s.lags);
  if (o.variation.period == 0)
    throw std::invalid_argument("weighting: projections need the data of many steps, and a period that pools them");
  const Index groups = o.variation.groups(e.steps()), d = e.channels(), r = e.inputs(), m = e.outputs();
  const Index f = o.future > 0 ? o.future : lags, z = lags * d, width = f * (r + m) + z;
  if (e.steps() < lags + f + groups - 1)
    throw std::invalid_argument(fmt::format("steps: {} found, at least {} needed (twice the lag order, and the period)",
                                            e.steps(), lags + f + groups - 1));
  const Vector sizes = weighted_sizes(e, o);
  const bool every_row = e.missing() == 0;
  PredictorFactors result;
  result.lags = lags;
  result.future = f;
  result.k_begin = arx.k_begin;
  result.group.resize(size_t(groups));
  parallel_for(0, groups, o.execution, [&](Index from, Index to) {
    for (Index g = from; g < to; ++g) {
      linalg::RowStack stack(width);
      double count = 0.0;
      const auto add = [&](const Matrix& window) {
        Matrix rows(window.rows(), width);
        rows.middleCols(f * r, z) = window.leftCols(z);
        for (Index j = 0; j < f; ++j) {
          rows.middleCols(j * r, r) = window.middleCols(z + j * d, r);
          rows.middleCols(f * r + z + j * m, m) =
              window.middleCols(z + j * d + r, m) * sizes.cwiseInverse().asDiagonal();
        }
        stack.add(rows);
      };
      const bool together = pools_windows(e, groups);
      if (together) {
        const Index last = lags + f - 1;  // of the first window
        add(pooled_window_factor(e, last, last, e.steps(), {o.execution.threads, {}}));
        for (const Index rows : window_counts(e, last, last, e.steps())) count += double(rows);
      }
      for (Index k = g; !together && k + f <= e.steps(); k += groups) {
        if (k < lags) continue;
        const auto all = e.samples().middleCols((k - lags) * d, (lags + f) * d);
        add(every_row ? Matrix(all) : Matrix(all(e.complete_rows(k + f - 1, lags + f - 1), Eigen::all)));
        count += double(every_row ? e.experiments() : Index(e.complete_rows(k + f - 1, lags + f - 1).size()));
      }
      const Matrix factor = stack.factor();
      const Index lead = std::min(factor.rows(), f * r + z), own = std::max<Index>(0, lead - f * r);
      const auto r_zz = factor.block(lead - own, f * r, own, z), r_zy = factor.block(lead - own, f * r + z, own, f * m);
      const linalg::Svd svd = linalg::svd(Matrix(r_zy.transpose()) / std::sqrt(std::max(1.0, count)));
      PredictorFactor& result_of = result.group[size_t(g)];
      result_of.singular_values = svd.s;
      const Index q = svd.s.size() > 0 ? (svd.s.array() > rounding::negligible * svd.s(0)).count() : 0;
      const Vector root = svd.s.head(q).cwiseSqrt();
      result_of.observability = svd.u.leftCols(q) * root.asDiagonal();
      const Vector unit = linalg::inverse_norms(r_zz);
      const Matrix predictor =
          linalg::minimum_norm(r_zz * unit.asDiagonal(), r_zy, rounding::negligible).x.transpose() * unit.asDiagonal();
      result_of.state = root.cwiseInverse().asDiagonal() * (svd.u.leftCols(q).transpose() * predictor);
    }
  });
  return result;
}

Model moesp(const Ensemble& e, const GtvArx& arx, const PredictorFactors& factors, const SubspaceOptions& o) {
  return Moesp(e, arx, factors, o).run();
}

}  // namespace tokid
