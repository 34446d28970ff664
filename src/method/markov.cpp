// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/markov.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <stdexcept>

namespace tokid {

namespace {

// Relative rounding errors of simulated or stored outputs. The residuals of noise-free data have at least this size.
constexpr double rounding = 8 * std::numeric_limits<double>::epsilon();

// Computes the Markov parameters and their variances in three passes, each of which runs in parallel. The first pass
// computes the pulse responses, by columns i. The second pass adds the error of each regression to the variances, by
// rows k. The third pass propagates these variances to later steps, by columns.
class Recursions {
 public:
  Recursions(const GtvArx& arx, Markov& markov) : arx_(arx), markov_(markov) {
    const Index steps = arx.steps(), r = arx.inputs, m = arx.outputs;
    variance_.resize(m, steps);
    feedthrough_variance_.setZero(m, steps * r);
    for (Index k = arx.k_begin; k < steps; ++k) {
      variance_.col(k) = arx.residual_cov(k).diagonal().cwiseMax((rounding * arx.output_rms(k)).cwiseAbs2());
      if (!arx.feedthrough) continue;
      const auto shape = arx.noise_shape(k);
      for (Index i = 0; i < r; ++i)
        feedthrough_variance_.col(k * r + i) = variance_.col(k) * shape.row(shape.rows() - r + i).squaredNorm();
    }
  }

  // h_{k,i} and h°_{k,i}, k > i: the responses of the ARX recursion to pulses at i         (28), (29), (34), (35)
  void pulse_responses(Index i) {
    for (Index k = i + 1; k <= last(i); ++k) {
      const Index gap = k - i, lags = arx_.step[size_t(k)].lags;
      auto h = markov_.h(k, i);
      auto g = markov_.h_gain(k, i);
      for (Index j = 1; j <= std::min(gap - 1, lags); ++j) {
        const auto minus_h2 = arx_.output_block(k, j);
        h.noalias() += minus_h2 * markov_.h(k - j, i);
        g.noalias() += minus_h2 * markov_.h_gain(k - j, i);
      }
      if (gap > lags) continue;
      const auto minus_h2 = arx_.output_block(k, gap);
      h += arx_.input_block(k, gap);
      h.noalias() += minus_h2 * arx_.D(i);
      g -= minus_h2;
    }
  }

  // Adds the variance from the regression of step k itself. h_{k,i} = M_k ω, where ω is the window of step k in the
  // pulse response. To first order, this variance is Σ_e ωᵀ(W_kᵀW_k)⁺ω, with the residual covariance Σ_e.
  // propagate_variances() adds the variances of the earlier Markov parameters.
  class Own {
   public:
    explicit Own(const Recursions& of) : of_(of) {}

    void add(Index k) {
      const GtvArx& arx = of_.arx_;
      Markov& markov = of_.markov_;
      const Index lags = arx.step[size_t(k)].lags, r = arx.inputs, m = arx.outputs, d = r + m;
      const Index gaps = std::min(markov.band, k - markov.i_begin);
      if (gaps == 0) return;
      windows_.setZero(arx.regressors(k), gaps * r);
      for (Index gap = 1; gap <= gaps; ++gap)
        for (Index j = 1; j <= std::min(gap, lags); ++j) {
          auto v = windows_.block((lags - j) * d, (gap - 1) * r, d, r);
          if (j < gap) {
            v.bottomRows(m) = markov.h(k - j, k - gap);
          } else {
            v.topRows(r).setIdentity();
            v.bottomRows(m) = arx.D(k - gap);
          }
        }
      const GtvArx::View x = arx.noise_shape(k);
      projected_.resize(x.cols(), windows_.cols());
      projected_.noalias() = x.transpose() * windows_;
      for (Index c = 0; c < projected_.cols(); ++c)
        markov.system_noise(k).col(c) = of_.variance_.col(k) * projected_.col(c).squaredNorm();
    }

   private:
    const Recursions& of_;
    Matrix windows_, projected_;
  };

  void propagate_variances(Index i) {
    const Index r = arx_.inputs;
    for (Index k = i + 1; k <= last(i); ++k) {
      const Index gap = k - i, lags = arx_.step[size_t(k)].lags;
      auto noise = markov_.h_noise(k, i);
      for (Index j = 1; j <= std::min(gap - 1, lags); ++j)
        noise.noalias() += arx_.output_block(k, j).cwiseAbs2() * markov_.h_noise(k - j, i);
      if (gap <= lags)
        noise.noalias() += arx_.output_block(k, gap).cwiseAbs2() * feedthrough_variance_.middleCols(i * r, r);
    }
  }

 private:
  Index last(Index i) const { return std::min(i + markov_.band, arx_.steps() - 1); }

  const GtvArx& arx_;
  Markov& markov_;
  Matrix variance_;              // (m × T) variance of the innovation of each output
  Matrix feedthrough_variance_;  // (m × T·r) variance of the entries of D_k
};

}  // namespace

Markov::Markov(Index T, Index r, Index m, Index widest, Index first)
    : inputs(r),
      outputs(m),
      band(widest),
      i_begin(first),
      steps_(T),
      system_(Matrix::Zero(m, T * widest * r)),
      system_noise_(Matrix::Zero(m, T * widest * r)),
      gain_(Matrix::Zero(m, T * widest * m)),
      D_(Matrix::Zero(m, T * r)) {}

Markov markov(const GtvArx& arx, Index band, const Execution& execution) {
  if (band < 1) throw std::invalid_argument(fmt::format("band: {} found, at least 1 needed", band));
  arx.require_noise_shape();
  const Index steps = arx.steps();
  Markov result(steps, arx.inputs, arx.outputs, std::min(band, std::max<Index>(1, steps - 1)), arx.k_begin);
  for (Index k = arx.k_begin; k < steps; ++k) result.D(k) = arx.D(k);

  Recursions recursions(arx, result);
  parallel_for(arx.k_begin, steps, execution, [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) recursions.pulse_responses(i);
  });
  const Execution quiet{execution.threads, {}};
  parallel_for(arx.k_begin, steps, quiet, [&](Index begin, Index end) {
    Recursions::Own own(recursions);
    for (Index k = begin; k < end; ++k) own.add(k);
  });
  parallel_for(arx.k_begin, steps, quiet, [&](Index begin, Index end) {
    for (Index i = begin; i < end; ++i) recursions.propagate_variances(i);
  });
  return result;
}

}  // namespace tokid
