// SPDX-License-Identifier: BSD-3-Clause
#include "design/forecast.hpp"

#include <algorithm>
#include <cmath>

#include "model/kalman_step.hpp"
#include "model/observer_step.hpp"

namespace tokid::design {

Ensemble response(const Model& model, const Matrix& inputs) {
  const Index r = model.inputs, steps = inputs.cols() / r;
  Ensemble e(inputs.rows(), steps, r, model.outputs, model.dt);
  Matrix x = Matrix::Zero(inputs.rows(), model.n(model.k_begin)), y, next;
  for (Index k = 0; k < steps; ++k) {
    const auto u = inputs.middleCols(k * r, r);
    e.input(k) = u;
    e.output(k).setZero();
    if (k < model.k_begin) continue;
    observer::output(model.at(k), x, u, y);
    e.output(k) = y;
    observer::next_state(model.at(k), x, u, next);
    x.swap(next);
  }
  return e;
}

namespace {

// Rows whose squares sum to the covariance of the output noise at the steps first … k. `state` has such rows for the
// noise of the state at step `first`.
Matrix output_noise(const Model& model, const Matrix& state, Index first, Index k, const NoiseLevel& noise) {
  const Index m = model.outputs, r = model.inputs, steps = k - first + 1;
  Matrix rows = Matrix::Zero(state.rows() + steps * (r + m), steps * m);
  Matrix x = Matrix::Zero(rows.rows(), state.cols()), computed, next;  // x: the effect of each row
  x.topRows(state.rows()) = state;
  for (Index j = 0; j < steps; ++j) {
    const Step& step = model.at(first + j);
    Matrix w = Matrix::Zero(rows.rows(), r);
    w.middleRows(state.rows() + j * (r + m), r).setIdentity();
    w *= noise.input;
    observer::output(step, x, w, computed);
    auto y = rows.middleCols(j * m, m);
    y = computed;
    y.middleRows(state.rows() + j * (r + m) + r, m) += noise.output * Matrix::Identity(m, m);
    observer::next_state(step, x, w, next);
    x.swap(next);
  }
  return rows;
}

// The window of step k after unit pulses at step i. The columns (L × r) belong to the inputs.
Matrix pulse_window(const Model& model, Index i, Index k, Index lags) {
  const Index r = model.inputs, d = r + model.outputs;
  Matrix window = Matrix::Zero(lags * d + r, r);
  const Index at = (i - k + lags) * d;
  window.middleRows(at, r).setIdentity();
  if (i == k) return window;
  window.middleRows(at + r, model.outputs) = model.at(i).D();
  Matrix x = model.at(i).B();
  for (Index j = i + 1; j < k; ++j) {
    const size_t s = model.index(j);
    window.middleRows((j - k + lags) * d + r, model.outputs) = model.step[s].C() * x;
    x = model.step[s].A() * x;
  }
  return window;
}

}  // namespace

NoisyRegression noisy_regression(const Model& model, const Ensemble& response, Index lags, Index first,
                                 const NoiseLevel& noise) {
  const Index r = model.inputs, m = model.outputs, d = r + m, regressors = r + lags * d;
  const double share = 1 / std::sqrt(double(response.experiments()));
  double floor = 0.0, outputs = 0.0, error = 0.0, size = 0.0;
  Matrix state = Matrix::Zero(0, model.n(model.k_begin));  // noise of the state at k - lags
  for (Index k = model.k_begin; k < response.steps(); ++k) {
    if (k >= first && k - lags >= model.k_begin) {
      // The rows of the samples above the rows of the noise. Their triangular factor has the second moments of samples
      // plus noise.
      const Matrix added = output_noise(model, state, k - lags, k, noise);
      Matrix rows = Matrix::Zero(response.experiments() + added.rows(), regressors + m);
      rows.topRows(response.experiments()) = share * response.window_and_output(k, lags);
      for (Index j = 0; j <= lags; ++j)
        rows.bottomRows(added.rows()).middleCols(j * d + r, m) = added.middleCols(j * m, m);
      outputs += rows.rightCols(m).squaredNorm();
      Vector scales = rows.leftCols(regressors).colwise().norm();
      for (double& s : scales) s = s > 0 ? 1 / s : 1.0;
      rows.leftCols(regressors) *= scales.asDiagonal();

      const Matrix factor = linalg::triangular_factor(rows);
      const Index lead = std::min(factor.rows(), regressors);
      const linalg::MinimumNorm solution =
          linalg::minimum_norm(factor.topLeftCorner(lead, regressors), factor.topRightCorner(lead, m), 1e-10);
      const double variance = factor.bottomRightCorner(factor.rows() - lead, m).squaredNorm();
      floor += variance;
      for (Index i = k - lags; i <= k; ++i) {
        const Matrix pulse = scales.asDiagonal() * pulse_window(model, i, k, lags);
        error += variance * (solution.inverse_t.transpose() * pulse).squaredNorm();
        size += (i == k ? model.at(k).D() : pulse_response(model, k, i)).squaredNorm();
      }
    }
    if (k - lags >= model.k_begin) {
      const Step& step = model.at(k - lags);
      state = kalman::next_root(state * step.A().transpose(), noise.input * step.B().transpose());
    }
  }
  NoisyRegression result;
  if (outputs > 0) result.floor = std::sqrt(floor / outputs);
  if (size > 0) result.markov_error = std::sqrt(error / size);
  return result;
}

}  // namespace tokid::design
