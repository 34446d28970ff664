// SPDX-License-Identifier: BSD-3-Clause
#include "design/optimise.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <deque>

#include "design/forecast.hpp"

namespace tokid::design {

namespace {

// The weight of the size of the inputs. With 1, the objective is the condition number alone, which is the same for
// small and large inputs. With 0, the objective is the information alone. With 0.5, inputs have twice the RMS value of
// those with 1, and half the condition number of those with 0.
constexpr double power = 0.5;

// 1/q times the logarithm of the mean of κ_k^{2q}, with κ_k² = ‖W_k B_k‖_F^{2·power} ‖(W_k B_k)⁺‖²_F. An exponent q up
// to 1 weights all steps, and a large q weights the worst steps. B_k (L × rank) spans the row space of W_k, and scales
// the channels of W_k by the outputs at the last rescale(). The model determines this space. The space contains no
// direction that inputs cannot excite.
class WindowConditions {
 public:
  WindowConditions(const Model& model, const Vector& amplitude, const Windows& windows, const Execution& execution)
      : model_(model), amplitude_(amplitude), windows_(windows), first_(windows.first), execution_(execution) {}

  // Takes the scales and row spaces from the windows of these inputs.
  void rescale(const Matrix& inputs) {
    const Ensemble e = response(model_, inputs);
    const Index steps = e.steps();
    basis_.assign(size_t(steps), {});
    parallel_for(first_, steps, execution_, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) {
        Matrix w = window(e, k);
        const Vector scale = scales(w, e);
        w *= scale.asDiagonal();
        const linalg::Svd svd = linalg::svd(linalg::triangular_factor(w));
        Index rank = 0;
        while (rank < svd.s.size() && svd.s(rank) > 1e-11 * svd.s(0)) ++rank;
        basis_[size_t(k)] = scale.asDiagonal() * svd.v.leftCols(rank);
      }
    });
  }

  // Value, and gradient with respect to the inputs.
  double operator()(const Matrix& inputs, double q, Matrix& gradient) const {
    const Ensemble e = response(model_, inputs);
    const Index steps = e.steps(), r = e.inputs(), m = e.outputs();
    std::vector<Matrix> slope(static_cast<size_t>(steps));  // of log κ_k² with respect to W_k B_k
    Vector value = Vector::Zero(steps);                     // log κ_k²
    parallel_for(first_, steps, execution_, [&](Index begin, Index end) {
      for (Index k = begin; k < end; ++k) {
        const Matrix& basis = basis_[size_t(k)];
        if (basis.cols() == 0) continue;
        const Matrix w = window(e, k) * basis;
        Matrix copy = w;
        const Matrix factor = linalg::triangular_factor(copy);
        const Matrix inverse =
            factor.triangularView<Eigen::Upper>().solve(Matrix::Identity(factor.rows(), factor.cols()));
        const Matrix gram = inverse * inverse.transpose();  // (wᵀw)⁻¹
        const double size = w.squaredNorm(), inverse_size = inverse.squaredNorm();
        value(k) = power * std::log(size) + std::log(inverse_size);
        slope[size_t(k)] = (2 * power / size) * w - (2 / inverse_size) * (w * gram) * gram;
      }
    });

    const double largest = value.tail(steps - first_).maxCoeff();
    Vector weight = (q * (value.array() - largest)).exp();
    weight.head(first_).setZero();
    const double sum = weight.sum();
    weight /= sum;

    Matrix by_sample = Matrix::Zero(e.experiments(), e.samples().cols());
    for (Index k = first_; k < steps; ++k) {
      const Matrix& basis = basis_[size_t(k)];
      if (basis.cols() == 0) continue;
      by_sample.middleCols((k - lags(k)) * (r + m), basis.rows()) += weight(k) * slope[size_t(k)] * basis.transpose();
    }
    // Runs backwards through the model. The gradient with respect to outputs adds to the gradient of the earlier
    // inputs.
    gradient.resize(e.experiments(), steps * r);
    Matrix state = Matrix::Zero(e.experiments(), model_.n(steps));
    for (Index k = steps; k-- > 0;) {
      auto g = gradient.middleCols(k * r, r);
      g = by_sample.middleCols(k * (r + m), r);
      if (k < model_.k_begin) continue;
      const size_t s = model_.index(k);
      const auto y = by_sample.middleCols(k * (r + m) + r, m);
      g += y * model_.step[s].D() + state * model_.step[s].B();
      state = state * model_.step[s].A() + y * model_.step[s].C();
    }
    return largest + std::log(sum / double(steps - first_)) / q;
  }

 private:
  // Scales of the columns of a window. Inputs are scaled by their limits, so that small inputs cannot balance a window.
  // Outputs are scaled by their size in this window, with the same scale for all lags of a channel.
  Vector scales(const Matrix& window, const Ensemble& e) const {
    const Index d = e.channels(), r = e.inputs();
    Vector scales = Vector::Zero(window.cols());
    for (Index i = 0; i < std::min(d, window.cols()); ++i) {
      const auto columns = Eigen::seq(i, Eigen::last, d);
      const auto part = window(Eigen::all, columns);
      const double norm = i < r ? amplitude_(i) * std::sqrt(double(part.size())) : part.norm();
      if (norm > 0) scales(columns).setConstant(std::sqrt(double(part.cols())) / norm);
    }
    return scales;
  }

  Index lags(Index k) const { return std::min(windows_.lags, std::max<Index>(0, k - model_.k_begin)); }

  Matrix window(const Ensemble& e, Index k) const {
    Matrix w = e.window(k, lags(k));
    if (windows_.centred) w.rowwise() -= w.colwise().mean().eval();
    return w;
  }

  const Model& model_;
  const Vector& amplitude_;
  Windows windows_;
  Index first_;
  Execution execution_;
  std::vector<Matrix> basis_;
};

// Limited-memory BFGS with a backtracking line search, over all entries of a matrix.
template <class Function>
Matrix descend(Matrix x, Index iterations, const Progress& progress, Function&& function) {
  constexpr size_t memory = 10;
  struct Pair {
    Matrix step, change;
    double product = 0.0;
  };
  const auto dot = [](const Matrix& a, const Matrix& b) { return a.cwiseProduct(b).sum(); };
  std::deque<Pair> pairs;
  Matrix gradient, next_gradient;
  double value = function(x, gradient);
  for (Index i = 0; i < iterations && gradient.norm() > 0; ++i) {
    Matrix direction = -gradient;
    std::vector<double> parts;
    for (size_t j = pairs.size(); j-- > 0;) {
      parts.push_back(dot(pairs[j].step, direction) / pairs[j].product);
      direction -= parts.back() * pairs[j].change;
    }
    if (pairs.empty())
      direction *= 0.1 * std::sqrt(double(x.size())) / gradient.norm();  // a first step of 0.1 per entry
    else
      direction *= pairs.back().product / pairs.back().change.squaredNorm();
    for (const Pair& pair : pairs) {
      direction += (parts.back() - dot(pair.change, direction) / pair.product) * pair.step;
      parts.pop_back();
    }

    const double slope = dot(gradient, direction);
    if (!(slope < 0)) break;
    if (progress) progress({.share = double(i) / double(iterations)});
    double length = 1.0, next = 0.0;
    Matrix moved;
    bool lower = false;
    for (int trial = 0; trial < 20 && !lower; ++trial, length *= 0.5) {
      moved = x + length * direction;
      next = function(moved, next_gradient);
      lower = next <= value + 1e-4 * length * slope;
    }
    if (!lower) break;
    Pair pair{moved - x, next_gradient - gradient, 0.0};
    pair.product = dot(pair.step, pair.change);
    // Without positive curvature along the step, the pair would make the next directions worse.
    if (pair.product > 1e-10 * pair.step.norm() * pair.change.norm()) {
      if (pairs.size() == memory) pairs.pop_front();
      pairs.push_back(std::move(pair));
    }
    const double gain = value - next;
    x = std::move(moved);
    gradient.swap(next_gradient);
    value = next;
    if (gain < 1e-7) break;
  }
  return x;
}

}  // namespace

Matrix optimise(const Model& model, const Matrix& start, const Vector& amplitude, const Windows& windows,
                Index iterations, const Execution& execution) {
  // u = a sin θ keeps every sample within its limit, so the descent needs no constraints.
  const Matrix limit = amplitude.transpose().replicate(start.rows(), start.cols() / amplitude.size());
  const auto inputs = [&](const Matrix& angle) -> Matrix { return limit.array() * angle.array().sin(); };
  // The factor 0.95 avoids the limit, where the sine is flat.
  Matrix angle = (0.95 * start.array() / limit.array()).asin();

  WindowConditions conditions(model, amplitude, windows, {execution.threads, {}});
  constexpr std::array stages{0.5, 2.0, 8.0};
  for (size_t stage = 0; stage < stages.size(); ++stage) {
    const double q = stages[stage];
    conditions.rescale(inputs(angle));
    const double all = double(stages.size());
    const Progress progress = share(execution, double(stage) / all, double(stage + 1) / all).progress;
    angle = descend(angle, iterations, progress, [&](const Matrix& x, Matrix& gradient) {
      const double value = conditions(inputs(x), q, gradient);
      gradient.array() *= limit.array() * x.array().cos();
      return value;
    });
  }
  const Matrix u = inputs(angle);
  // A common factor of all inputs does not change a condition number. Therefore the inputs are scaled until one reaches
  // its limit.
  return u / (u.array() / limit.array()).abs().maxCoeff();
}

}  // namespace tokid::design
