// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/model.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <stdexcept>

#include "base/nan.hpp"
#include "model/continuation.hpp"
#include "model/coordinates.hpp"
#include "tokid/linalg.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

// A change of coordinates with a pivot below this share of the largest can't be inverted.
constexpr double not_invertible = 1e-12;
}  // namespace

bool determines_state(const Matrix& rows) {
  constexpr double half_of_the_digits = 1e-8;
  if (rows.cols() == 0) return true;
  if (rows.rows() < rows.cols()) return false;
  const Vector sigma = linalg::singular_values(rows);
  return sigma(sigma.size() - 1) > half_of_the_digits * sigma(0);
}

// Â_k = S_{k+1} A_k S_k⁻¹ and so on: (41) with S = T⁻¹, which leaves the Markov parameters as they are (42).
Model transform(const Model& model, const std::vector<Matrix>& S) {
  if (static_cast<Index>(S.size()) != model.steps() + 1)
    throw std::invalid_argument(
        fmt::format("transform: {} matrices found, {} (one for each state) needed", S.size(), model.steps() + 1));
  Model result = model;
  std::vector<Matrix> inverse(S.size());
  for (size_t s = 0; s < S.size(); ++s) {
    const Index n = model.n(model.k_begin + Index(s));
    if (S[s].rows() != n || S[s].cols() != n)
      throw std::invalid_argument(
          fmt::format("transform: S[{}] is {} x {}, {} x {} needed", s, S[s].rows(), S[s].cols(), n, n));
    const linalg::MinimumNorm solution =
        linalg::minimum_norm(S[s], Matrix::Identity(S[s].rows(), S[s].cols()), not_invertible);
    if (solution.rank < S[s].cols())
      throw std::invalid_argument(
          fmt::format("transform: S[{}] has rank {}, {} needed", s, solution.rank, S[s].cols()));
    inverse[s] = solution.x;
  }
  for (size_t s = 0; s + 1 < S.size(); ++s) {
    result.step[s].A() = S[s + 1] * model.step[s].A() * inverse[s];
    result.step[s].B() = S[s + 1] * model.step[s].B();
    result.step[s].C() = model.step[s].C() * inverse[s];
    result.step[s].G() = S[s + 1] * model.step[s].G();
    if (model.has(&Step::has_Q)) result.step[s].set_Q(S[s + 1] * model.step[s].Q() * S[s + 1].transpose());
    if (model.has(&Step::has_K)) result.step[s].set_K(S[s] * model.step[s].K());
  }
  if (model.x0_mean.size() > 0) result.x0_mean = S[0] * model.x0_mean;
  if (model.x0_cov.size() > 0) result.x0_cov = S[0] * model.x0_cov * S[0].transpose();
  return result;
}

namespace {

// Transforms the steps around s that can be transformed. coordinates(k) is the candidate for S_k. A step is transformed
// if its candidate determines all of the state. The result is empty if the candidate of step s does not.
template <class Coordinates>
FramedModel framed(const Model& model, Index s, Coordinates&& coordinates) {
  std::vector<Matrix> S;
  for (Index k = model.k_begin; k <= model.k_end(); ++k) S.emplace_back(Matrix::Identity(model.n(k), model.n(k)));
  const auto enters = [&](Index k) {
    if (k < model.k_begin || k > model.k_end()) return false;
    const Matrix candidate = coordinates(k);
    if (candidate.rows() != model.n(k) || candidate.size() == 0) return false;
    if (!determines_state(candidate)) return false;
    S[model.index(k)] = candidate;
    return true;
  };
  FramedModel result{{}, s, s};
  if (!enters(s)) return result;
  while (enters(result.begin - 1)) --result.begin;
  while (enters(++result.end)) continue;
  result.model = transform(model, S);
  return result;
}

}  // namespace

FramedModel reference_frame(const Model& model, Index s, Index rows) {
  if (s < model.k_begin || rows < 1 || s >= model.k_end() || rows > model.k_end() - s || model.n(s) == 0)
    throw std::invalid_argument(fmt::format(
        "reference frame: step {} with {} block rows found. The step must have states, and the model must have as many "
        "steps from it on. All states are there at steps {} to {}, and the model ends with step {}",
        s, rows, model.full_begin(), model.full_end() - 1, model.k_end() - 1));
  const Matrix projection = linalg::pseudo_inverse(observability(model, s, rows));
  FramedModel result = framed(model, s, [&](Index k) {
    return k + rows <= model.k_end() ? Matrix(projection * observability(model, k, rows)) : Matrix();
  });
  if (result.begin == result.end)
    throw std::invalid_argument(fmt::format(
        "reference frame: {} block rows of step {} don't determine its {} states; more rows or another step needed",
        rows, s, model.n(s)));
  result.model.frame = "reference";
  return result;
}

FramedModel align(const Model& model, const Model& reference, Index rows) {
  if (model.inputs != reference.inputs || model.outputs != reference.outputs)
    throw std::invalid_argument(
        fmt::format("align: models with {} and {} inputs, {} and {} outputs found, equal numbers needed", model.inputs,
                    reference.inputs, model.outputs, reference.outputs));
  const Index last = std::min(model.k_end(), reference.k_end()) - rows;
  Index s = std::max(model.full_begin(), reference.k_begin);
  while (s < last && model.n(s) != reference.n(s)) ++s;
  if (rows < 1 || s > last)
    throw std::invalid_argument(
        fmt::format("align: no step has the same state dimension in both models and {} block rows in each", rows));
  FramedModel result = framed(model, s, [&](Index k) {
    if (k < reference.k_begin || k > last) return Matrix();
    return Matrix(linalg::pseudo_inverse(observability(reference, k, rows)) * observability(model, k, rows));
  });
  if (result.begin == result.end)
    throw std::invalid_argument(fmt::format(
        "align: {} block rows of step {} don't determine its {} states; more rows needed", rows, s, model.n(s)));
  result.model.frame = reference.frame;
  return result;
}

Model smooth_frame(const Model& model, Index rows) {
  std::vector<Matrix> S;
  Matrix previous(0, 0);  // O_{k-1} in the new coordinates
  for (Index k = model.k_begin; k <= model.k_end(); ++k) {
    const Index n = model.n(k);
    const Matrix o = observability(model, k, rows);
    const Index common = std::min(o.rows(), previous.rows());
    Matrix target = Matrix::Zero(common, n);
    const Index shared = std::min(n, previous.cols());
    target.leftCols(shared) = previous.topLeftCorner(common, shared);
    const Matrix rotation =
        common > 0 && n > 0 ? linalg::procrustes(o.topRows(common), target) : Matrix(Matrix::Identity(n, n));
    S.emplace_back(rotation.transpose());  // x' = Qᵀ x, so O' = O Q
    previous = o * rotation;
  }
  Model result = transform(model, S);
  result.frame = "smooth";
  return result;
}

Similarity kinematically_similar(const Model& a, const Model& b, double tolerance, Index band) {
  if (a.inputs != b.inputs || a.outputs != b.outputs)
    throw std::invalid_argument(fmt::format(
        "kinematically_similar: models with {} and {} inputs, {} and {} outputs found, equal numbers needed", a.inputs,
        b.inputs, a.outputs, b.outputs));
  if (band <= 0) band = 2 * std::max(a.states(), b.states());
  // Models that go on are compared over all steps of the other one. If both go on, all responses to the pulses of a
  // common period are compared.
  const Index begin = std::max(a.k_begin, b.k_begin);
  if (goes_on(a) && goes_on(b)) {
    const Index all = begin + std::lcm(a.period, b.period) + band;
    if (a.k_end() < all || b.k_end() < all)
      return kinematically_similar(continued(a, all), continued(b, all), tolerance, band);
  } else if (ends_early(a, b.k_end())) {
    return kinematically_similar(continued(a, b.k_end()), b, tolerance, band);
  } else if (ends_early(b, a.k_end())) {
    return kinematically_similar(a, continued(b, a.k_end()), tolerance, band);
  }
  const Index end = std::min(a.k_end(), b.k_end());
  if (end <= begin)
    throw std::invalid_argument(
        fmt::format("kinematically_similar: steps {} to {} and {} to {} found, common steps needed", a.k_begin,
                    a.k_end() - 1, b.k_begin, b.k_end() - 1));
  // Goes forward from each pulse with one product per Markov parameter, and collects the scale of each step k.
  Vector difference = Vector::Zero(end - begin), scale = difference;
  Matrix squares = Matrix::Zero(a.outputs, a.inputs), all_squares = squares;
  const auto compare = [&](Index k, const ConstMatrixRef& x, const ConstMatrixRef& y) {
    difference(k - begin) = std::max(difference(k - begin), (x - y).norm());
    scale(k - begin) = std::max({scale(k - begin), x.norm(), y.norm()});
    squares += (x - y).cwiseAbs2();
    all_squares += y.cwiseAbs2();
  };
  for (Index i = begin; i < end; ++i) {
    checkpoint();
    compare(i, a.at(i).D(), b.at(i).D());
    Matrix x = a.at(i).B(), y = b.at(i).B();
    for (Index k = i + 1; k < std::min(end, i + 1 + band); ++k) {
      compare(k, a.at(k).C() * x, b.at(k).C() * y);
      x = a.at(k).A() * x;
      y = b.at(k).A() * y;
    }
  }
  Similarity result;
  result.relative_error = (all_squares.array() > 0).select((squares.array() / all_squares.array()).sqrt(), nan);
  result.begin = begin;
  result.end = end;
  result.band = band;
  for (Index k = 0; k < difference.size(); ++k)
    if (scale(k) > 0) result.max_difference = std::max(result.max_difference, difference(k) / scale(k));
  result.similar = result.max_difference <= tolerance;
  return result;
}

}  // namespace tokid
