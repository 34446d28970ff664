// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/stage_values.hpp"

#include <fmt/format.h>

#include <stdexcept>

#include "tokid/linalg.hpp"

namespace tokid {

namespace {

template <class Entries>
void check_finite(const char* name, Index k, const Entries& entries) {
  if (!entries.allFinite())
    throw std::invalid_argument(
        fmt::format("{}: a number that is not finite found at step {}, numbers needed", name, k));
}

template <class Entries>
void check_sizes(const char* name, Index k, const Entries& entries, const char* needed) {
  if (!(entries.array() >= 0).all() || !entries.allFinite())
    throw std::invalid_argument(
        fmt::format("{}: another value found at step {}, {} from 0 on needed", name, k, needed));
}

}  // namespace

void check(const GtvArx& arx) {
  for (Index k = arx.k_begin; k < arx.steps(); ++k) {
    checkpoint();
    check_finite("coefficients", k, arx.coefficients(k));
    check_finite("residual_cov", k, arx.residual_cov(k));
    if (!linalg::covariance_factor(arx.residual_cov(k)))
      throw std::invalid_argument(
          fmt::format("residual_cov: another matrix found at step {}, a covariance needed (symmetric, positive "
                      "semidefinite)",
                      k));
    check_sizes("output_rms", k, arx.output_rms(k), "numbers");
    check_finite("noise_shape", k, arx.noise_shape(k));
  }
}

void set_noise_shape(GtvArx& arx, Index k, Matrix x) {
  arx.require_noise_shape();
  const Index regressors = arx.regressors(k);
  if (x.rows() != regressors)
    throw std::invalid_argument(fmt::format("noise_shape: {} rows found at step {}, {} needed, one for each regressor",
                                            x.rows(), k, regressors));
  check_finite("noise_shape", k, x);
  if (x.cols() > x.rows()) {
    Matrix transposed = x.transpose();  // Xᵀ = Q·R, so that X·Xᵀ = Rᵀ·R
    x = linalg::triangular_factor(transposed).transpose();
  }
  arx.step[size_t(k)].rank = x.cols();
  arx.noise_shape(k) = x;
}

void check(const Markov& markov) {
  for (Index k = markov.i_begin; k < markov.steps(); ++k) {
    checkpoint();
    check_finite("D", k, markov.D(k));
    check_finite("system", k, markov.system(k));
    check_finite("gain", k, markov.gain(k));
    check_sizes("system_noise", k, markov.system_noise(k), "variances");
  }
}

}  // namespace tokid
