// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/markov.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace tokid {

namespace {

// Rounding errors of simulated or stored outputs, in units of ε: the residuals of noise-free data are not below it.
constexpr double rounding = 8 * std::numeric_limits<double>::epsilon();

// Variance of the innovation of each output (m).
Vector innovation_variance(const GtvArx& arx, Index k) {
  return arx.residual_cov(k).diagonal().cwiseMax((rounding * arx.output_rms(k)).cwiseAbs2());
}

// The column of Markov parameters that starts at step i: the answer of the ARX recursion to a pulse at i.
class PulseColumn {
 public:
  PulseColumn(const GtvArx& arx, Markov& markov) : arx_(arx), markov_(markov) {
    const Index r = arx.inputs, m = arx.outputs;
    Index lags = 0;
    for (const GtvArxStep& s : arx.step) lags = std::max(lags, s.lags);
    regressors_.resize(lags * (r + m) + r, r);
    projected_.resize(regressors_.rows(), r);
  }

  void compute(Index i) {
    const Index last = std::min(i + markov_.band, arx_.steps() - 1);
    for (Index k = i + 1; k <= last; ++k) step(k, i);
  }

 private:
  void step(Index k, Index i) {
    const Index gap = k - i, lags = arx_.step[size_t(k)].lags, r = arx_.inputs, m = arx_.outputs;
    auto h = markov_.system[size_t(k)].middleCols((gap - 1) * r, r);
    auto g = markov_.gain[size_t(k)].middleCols((gap - 1) * m, m);
    auto noise = markov_.system_noise[size_t(k)].middleCols((gap - 1) * r, r);
    h.setZero();
    g.setZero();
    noise.setZero();
    for (Index j = 1; j <= std::min(gap - 1, lags); ++j) {  // (28), (34): the sum
      const auto minus_h2 = arx_.output_block(k, j);
      h.noalias() += minus_h2 * markov_.h(k - j, i);
      g.noalias() += minus_h2 * markov_.h_gain(k - j, i);
      noise.noalias() += minus_h2.cwiseAbs2() * markov_.h_noise(k - j, i);
    }
    if (gap <= lags) {  // (28), (34): the direct part
      const auto minus_h2 = arx_.output_block(k, gap);
      h += arx_.input_block(k, gap);
      h.noalias() += minus_h2 * arx_.D(i);
      g -= minus_h2;
      noise.noalias() += minus_h2.cwiseAbs2() * feedthrough_noise(i);
    }
    noise += own_noise(k, i);
  }

  // h_{k,i} = M_k ω with ω the window that the pulse leaves behind, so to first order its variance is
  // Σ_e ωᵀ(W_kᵀW_k)⁺ω, on top of what the earlier parameters hand on.
  Matrix own_noise(Index k, Index i) {
    const Index lags = arx_.step[size_t(k)].lags, r = arx_.inputs, m = arx_.outputs, d = r + m, gap = k - i;
    auto omega = regressors_.topRows(lags * d + r);
    omega.setZero();
    for (Index j = 1; j <= std::min(gap, lags); ++j) {
      auto v = omega.middleRows((lags - j) * d, d);
      if (j < gap) {
        v.bottomRows(m) = markov_.h(k - j, i);
      } else {
        v.topRows(r).setIdentity();
        v.bottomRows(m) = arx_.D(i);
      }
    }
    const GtvArx::View x = arx_.noise_shape(k);
    auto projected = projected_.topRows(x.cols());
    projected.noalias() = x.transpose() * omega;
    return innovation_variance(arx_, k) * projected.colwise().squaredNorm();
  }

  // Variances of the entries of D_i (m × r).
  Matrix feedthrough_noise(Index i) const {
    return innovation_variance(arx_, i) *
           arx_.noise_shape(i).bottomRows(arx_.inputs).rowwise().squaredNorm().transpose();
  }

  const GtvArx& arx_;
  Markov& markov_;
  Matrix regressors_, projected_;
};

}  // namespace

Markov markov(const GtvArx& arx, Index band, const Execution& execution) {
  if (band < 1) throw std::invalid_argument(fmt::format("band: {} found, at least 1 needed", band));
  arx.require_noise_shape();
  const Index steps = arx.steps(), r = arx.inputs, m = arx.outputs;
  Markov result;
  result.inputs = r;
  result.outputs = m;
  result.band = std::min(band, std::max<Index>(1, steps - 1));
  result.i_begin = arx.k_begin;
  const Matrix none = Matrix::Zero(m, result.band * r);
  result.system.assign(size_t(steps), none);
  result.system_noise.assign(size_t(steps), none);
  result.gain.assign(size_t(steps), Matrix::Zero(m, result.band * m));
  result.D.assign(size_t(steps), Matrix::Zero(m, r));
  for (Index k = arx.k_begin; k < steps; ++k) result.D[size_t(k)] = arx.D(k);

  parallel_for(arx.k_begin, steps, execution, [&](Index begin, Index end) {
    PulseColumn column(arx, result);
    for (Index i = begin; i < end; ++i) column.compute(i);
  });
  return result;
}

}  // namespace tokid
