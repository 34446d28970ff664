// SPDX-License-Identifier: BSD-3-Clause
#include "modes/frozen.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/integers.hpp"
#include "model/continuation.hpp"
#include "tokid/linalg.hpp"
#include "tokid/parallel.hpp"

namespace tokid::modes_of {

namespace {

// The window determines the state if its smallest singular value is above this share of the largest, with columns of
// norm one. Below it, half of the digits would be lost.
constexpr double determined = 1e-8;

bool determines(const Matrix& observed) {
  if (observed.rows() < observed.cols()) return false;
  const Vector sigma = linalg::singular_values(observed * linalg::inverse_norms(observed).asDiagonal());
  return sigma(sigma.size() - 1) > determined * sigma(0);
}

Index even(Index steps) { return steps + steps % 2; }

Index least_window(const Model& model) { return even(ceil_div(model.states(), model.outputs)); }

Index chosen_window(const Model& model, Index window) {
  const Index n = model.states(), m = model.outputs;
  if (n == 0) throw std::invalid_argument("model: no states found, at least 1 needed for modes");
  if (window == 0) return even(std::max(estimation_window(model), 2 * ceil_div(n, m)));
  const Index least = least_window(model);
  if (window < least || window % 2 != 0)
    throw std::invalid_argument(
        fmt::format("window: {} found, an even number of steps from {} on needed for {} states and {} outputs", window,
                    least, n, m));
  return window;
}

// The size of each output, so that the units of the outputs do not matter: the geometric mean over the inputs of the
// norms of its pulse responses to the inputs of the steps begin … end-1. Another unit of an input then multiplies all
// sizes by the same factor.
Vector output_sizes(const Model& model, Index begin, Index end, Index band) {
  const Index m = model.outputs, r = model.inputs;
  Matrix squares = Matrix::Zero(m, r);
  for (Index i = begin; i < end; ++i) {
    checkpoint();
    Matrix x = model.at(i).B();
    for (Index k = i + 1; k < std::min(model.k_end(), i + 1 + band); ++k) {
      squares += (model.at(k).C() * x).cwiseAbs2();
      x = model.at(k).A() * x;
    }
  }
  Vector result = Vector::Ones(m);
  for (Index j = 0; j < m; ++j) {
    double sum = 0.0;
    Index count = 0;
    for (Index i = 0; i < r; ++i)
      if (squares(j, i) > 0 && std::isfinite(squares(j, i))) sum += std::log(squares(j, i)) / 2, ++count;
    if (count > 0) result(j) = std::exp(sum / double(count));
  }
  return result;
}

// The last step k with a window before it and after it. The window from k-half+1 on must lie within the model, and the
// state must be whole at k-half and k-half+1.
Index last_centre(const Model& model, Index half) {
  return std::min(model.k_end() - 1 - half, model.full_end() - 2 + half);
}

// Have all steps of a model that goes on the same number of states?
bool always_full(const Model& model) { return model.full_begin() == model.k_begin && model.full_end() > model.k_end(); }

}  // namespace

Model lasting(Model model) {
  if (!goes_on(model)) {
    model.period = 0;
    return model;
  }
  Index begin = model.k_end() - model.period;
  while (begin > model.k_begin && model.n(begin - 1) == model.n(model.k_end())) --begin;
  return from_step(std::move(model), begin);
}

Index other_window(const Model& model, Index window) {
  const Index half = std::max(least_window(model), even(window / 2));
  if (half < window) return half;
  const bool fits = model.period > 0 || last_centre(model, window) >= model.full_begin() + window;
  return fits ? 2 * window : 0;
}

bool has_window(const Model& given, Index window) {
  const Model model = lasting(given);
  if (model.states() == 0) return false;
  if (model.period > 0) return always_full(model);
  const Index half = chosen_window(model, window) / 2;
  return last_centre(model, half) >= model.full_begin() + half;
}

Frozen::Frozen(const Model& model, Index window) : model_(lasting(model)), half_(chosen_window(model_, window) / 2) {
  const Index reach = 2 * half_, period = model_.period;
  if (period > 0) {
    if (!always_full(model_))
      throw std::invalid_argument(fmt::format(
          "model: a number of states found that changes within its period of {} steps, a constant one needed for modes",
          period));
    shift_ = ceil_div(reach, period) * period;
    begin_ = model_.k_begin;
    count_ = period;
    model_ = continued(std::move(model_), begin_ + shift_ + count_ + reach);
  }
  first_ = model_.full_begin() + half_;
  last_ = last_centre(model_, half_);
  if (last_ < first_)
    throw std::invalid_argument(
        fmt::format("window: {} steps found, the model has {} with all states, {} needed. State a shorter window",
                    window == 0 ? 2 * half_ : window, std::min(model_.k_end(), model_.full_end()) - model_.full_begin(),
                    2 * half_ + 1));
  if (period == 0) begin_ = first_, count_ = last_ - first_ + 1;
  scale_ = period > 0 ? output_sizes(model_, begin_, begin_ + count_, reach)
                      : output_sizes(model_, model_.k_begin, model_.k_end(), reach);
}

Index Frozen::reach_of(Index k) const { return std::min({half_, k - first_, last_ - k}); }

Matrix Frozen::observed(Index j) const {
  Matrix o = observability(model_, j, 2 * half_);
  for (Index row = 0; row < o.rows(); ++row) o.row(row) /= scale_(row % scale_.size());
  return o;
}

std::vector<Step> Frozen::systems(Index first, Index count) const {
  std::vector<Step> result;
  std::vector<Matrix> observed_from;  // O_j from step `from` on
  Index from = 0;
  for (Index k = first + shift_; k < first + shift_ + count; ++k) {
    checkpoint();
    const Index reach = reach_of(k), begin = k - half_ - reach;
    const Index end = k - half_ + reach + 2;
    if (observed_from.empty()) from = begin;
    observed_from.erase(observed_from.begin(), observed_from.begin() + (begin - from));
    from = begin;
    while (from + Index(observed_from.size()) < end)
      observed_from.push_back(observed(from + Index(observed_from.size())));
    result.push_back(system(k, reach, observed_from, from));
  }
  return result;
}

Step Frozen::system(Index k, Index reach, const std::vector<Matrix>& observed, Index from) const {
  const Index n = model_.states(), m = model_.outputs, r = model_.inputs, centre = k - half_;
  const auto window = [&](Index j) -> const Matrix& { return observed[size_t(j - from)]; };
  const Matrix scaled = window(centre) * linalg::inverse_norms(window(centre)).asDiagonal();
  const Step none(0, 0, r, m);
  // Each window of the mean must determine its state: a sensor may be dead for some steps.
  if (!determines(scaled) || !determines(window(centre + reach + 1))) return none;
  const Matrix basis = linalg::orthonormal_factor(scaled);  // Q

  Matrix A = Matrix::Zero(n, n);
  for (Index j = centre - reach; j <= centre + reach; ++j) {
    const Vector norms = linalg::inverse_norms(window(j));
    const Matrix before = basis.transpose() * window(j) * norms.asDiagonal();
    const Matrix after = basis.transpose() * window(j + 1) * model_.at(j).A() * norms.asDiagonal();
    const linalg::MinimumNorm map = linalg::minimum_norm(before.transpose(), after.transpose(), determined);
    if (map.rank < n) return none;
    A += map.x.transpose();
  }
  A /= double(2 * reach + 1);
  if (!A.allFinite()) return none;

  // C is the least-squares solution of C Aⁱ = block i of Q.
  Matrix sum = Matrix::Zero(n, m), gram = Matrix::Zero(n, n), power = Matrix::Identity(n, n);
  for (Index i = 0; i < 2 * half_; ++i) {
    sum += power * basis.middleRows(i * m, m).transpose();
    gram += power * power.transpose();
    power = A * power;
  }
  const Matrix C = scale_.asDiagonal() * linalg::solve(gram, sum).transpose();
  if (!C.allFinite()) return none;
  return Step(A, Matrix::Zero(n, r), C, Matrix::Zero(m, r), Matrix::Zero(n, m));
}

Step Frozen::whole(Index k) const {
  Step result = systems(k, 1).front();
  if (result.states() == 0) return result;
  const Index centre = k + shift_, reach = reach_of(centre), m = model_.outputs, r = model_.inputs;
  result.D().setZero();
  for (Index i = centre - reach; i <= centre + reach; ++i) result.D() += model_.at(i).D();
  result.D() /= double(2 * reach + 1);

  // As many steps as lie after every step in the mean. If they don't determine the state, a whole window.
  Index steps = half_;
  Matrix observed = answers(result, steps);
  if (!determines(observed)) observed = answers(result, steps = 2 * half_);
  const Index last = std::min(centre, model_.k_end() - 1 - steps - reach);  // centre of the mean
  Matrix pulses = Matrix::Zero(steps * m, r);
  for (Index i = last - reach; i <= last + reach; ++i) {
    Matrix x = model_.at(i).B();
    for (Index gap = 0; gap < steps; ++gap) {
      const Step& step = model_.at(i + 1 + gap);
      pulses.middleRows(gap * m, m) += scale_.cwiseInverse().asDiagonal() * (step.C() * x);
      x = step.A() * x;
    }
  }
  const Vector norms = linalg::inverse_norms(observed);
  const Matrix scaled = observed * norms.asDiagonal(), basis = linalg::orthonormal_factor(scaled);
  result.B() = norms.asDiagonal() *
               linalg::solve(basis.transpose() * scaled, basis.transpose() * pulses / double(2 * reach + 1));
  return result;
}

Matrix Frozen::answers(const Step& system, Index steps) const {
  const Index m = model_.outputs;
  Matrix result(steps * m, system.states()), row = scale_.cwiseInverse().asDiagonal() * system.C();
  for (Index i = 0; i < steps; ++i) {
    result.middleRows(i * m, m) = row;
    row = row * system.A();
  }
  return result;
}

}  // namespace tokid::modes_of
