// SPDX-License-Identifier: BSD-3-Clause
#include "model/expected_errors.hpp"

#include <algorithm>

#include "base/nan.hpp"
#include "model/kalman_step.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

// The observer of an exact model has the state x̄_{k+1} = A x̄_k + B u_k - G_k ε_k with white ε, and y_k = C x̄_k + D
// u_k + ε_k. A computation without corrections has a state that differs by δ, with δ_{k+1} = A δ_k - G_k ε_k. The error
// of its output is C_k δ_k + ε_k. This function is the Kalman filter without its correction: it takes p from step k to
// k+1.
void propagate(const Model& model, const std::vector<Matrix>& covariances, Index k, Matrix& p) {
  const Step& step = model.at(k);
  Matrix ap, next;
  kalman::propagate(p, step.A(), step.G() * covariances[model.index(k)] * step.G().transpose(), ap, next);
  p.swap(next);
}

Vector output_variance(const Model& model, const std::vector<Matrix>& covariances, Index k, const Matrix& p) {
  const size_t s = model.index(k);
  return (model.step[s].C() * p * model.step[s].C().transpose() + covariances[s]).diagonal();
}

// The error δ of the estimated state at step `start`, as a linear function of the innovations (n × window·m) in the
// window that begins there. The estimate uses these innovations, and δ thus depends on them. The estimate is the Kalman
// smoother from x0_mean on, or least squares.
Matrix estimation_error(const Model& model, const std::vector<Matrix>& covariances, Index start, Index window,
                        bool from_estimate) {
  const Index n = model.n(start), m = model.outputs;
  Matrix pooled = Matrix::Zero(m, m);
  for (Index j = start; j < start + window; ++j) pooled += covariances[model.index(j)];
  const Matrix whitener = linalg::whitener(pooled);
  Matrix sensitivity(window * m, n), error(n, window * m), transition = Matrix::Identity(n, n);
  for (Index j = start; j < start + window; ++j) {
    const size_t s = model.index(j);
    const Index row = (j - start) * m;
    const Matrix shown = model.step[s].C() * transition;
    if (from_estimate) {
      const Matrix w = linalg::whitener(covariances[s]);
      error.middleCols(row, m) = -model.x0_cov * shown.transpose() * w.transpose() * w;
    } else {
      sensitivity.middleRows(row, m) = whitener * shown;
    }
    transition = model.at(j).closed_loop() * transition;
  }
  if (from_estimate) return error;
  const Matrix inverse = linalg::pseudo_inverse(sensitivity);
  for (Index j = 0; j < window; ++j) error.middleCols(j * m, m) = -inverse.middleCols(j * m, m) * whitener;
  return error;
}

}  // namespace

Matrix expected_simulation_errors(const Model& model, const std::vector<Matrix>& covariances, InitialState initial,
                                  Index steps) {
  const Index m = model.outputs, end = std::min(model.k_end(), steps);
  Matrix result = Matrix::Constant(steps, m, nan);
  const bool from_zero = starts_from_zero(model, initial);
  const bool from_estimate =
      !from_zero && has_initial_estimate(model, initial) && model.has(&Step::has_Q) && model.has(&Step::has_R);
  Index k = from_zero || from_estimate ? model.k_begin : model.full_begin();
  Matrix p;  // covariance of δ
  if (from_zero) {
    p = Matrix::Zero(model.n(k), model.n(k));
  } else {
    const Index start = k, window = std::min(estimation_window(model), end - k);
    if (window < 1 || (!from_estimate && window < estimation_window(model))) return result;
    // δ_k as a function of ε in the window
    Matrix by = estimation_error(model, covariances, start, window, from_estimate);
    for (; k < start + window; ++k) {
      const size_t s = model.index(k);
      Matrix shown = model.step[s].C() * by;
      shown.middleCols((k - start) * m, m) += Matrix::Identity(m, m);
      result.row(k).setZero();
      for (Index j = 0; j < window; ++j) {
        const auto part = shown.middleCols(j * m, m);
        result.row(k) += (part * covariances[model.index(start + j)] * part.transpose()).diagonal();
      }
      by = (model.step[s].A() * by).eval();
      by.middleCols((k - start) * m, m) -= model.step[s].G();
    }
    p = Matrix::Zero(by.rows(), by.rows());
    for (Index j = 0; j < window; ++j) {
      const auto part = by.middleCols(j * m, m);
      p += part * covariances[model.index(start + j)] * part.transpose();
    }
  }
  for (; k < end; ++k) {
    checkpoint();
    result.row(k) = output_variance(model, covariances, k, p);
    propagate(model, covariances, k, p);
  }
  return result;
}

Matrix expected_prediction_errors(const Model& model, const std::vector<Matrix>& covariances, Index begin, Index end,
                                  Index horizons) {
  constexpr double most_operations = 1e9;
  const double n = double(std::max<Index>(1, model.states()));
  const Index most = std::clamp<Index>(Index(most_operations / (6 * n * n * n * double(horizons))), 8, 64);
  const Index stride = std::max<Index>(1, (end - begin + most - 1) / most);
  Matrix sum = Matrix::Zero(horizons, model.outputs);
  Vector count = Vector::Zero(horizons);
  for (Index start = begin; start < end; start += stride) {
    checkpoint();
    Matrix p = Matrix::Zero(model.n(start), model.n(start));
    for (Index h = 0; h < std::min(horizons, end - start); ++h) {
      sum.row(h) += output_variance(model, covariances, start + h, p);
      ++count(h);
      propagate(model, covariances, start + h, p);
    }
  }
  return count.cwiseInverse().asDiagonal() * sum;
}

}  // namespace tokid
