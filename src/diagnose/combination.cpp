// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/combination.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace tokid {

namespace {

// A fit needs this many more rows than columns. With fewer rows, it may be chance.
constexpr Index extra_rows = 3;

// Takes `count` rows, evenly spread. A combination that holds in all rows also holds in these rows.
Matrix some_rows(const ConstMatrixRef& a, Index count) {
  Matrix result(count, a.cols());
  for (Index i = 0; i < count; ++i) result.row(i) = a.row(i * a.rows() / count);
  return result;
}

// Scales columns to norm 1, after subtracting their means if `centred`. A column that does not vary becomes zero.
Matrix normalised(Matrix a, bool centred) {
  for (Index j = 0; j < a.cols(); ++j) {
    const double size = a.col(j).stableNorm();
    if (centred) a.col(j).array() -= a.col(j).mean();
    const double norm = a.col(j).stableNorm();
    if (norm > nothing_left * size)
      a.col(j) /= norm;
    else
      a.col(j).setZero();
  }
  return a;
}

double left_over(const ConstMatrixRef& columns, const Vector& target) {
  if (columns.cols() == 0) return target.norm();
  return (target - columns * linalg::minimum_norm(columns, target, 1e-12).x).norm();
}

}  // namespace

double unexplained(const ConstMatrixRef& columns, const ConstMatrixRef& target, bool centred) {
  return left_over(normalised(columns, centred), normalised(target, centred));
}

std::optional<Combination> combination(const ConstMatrixRef& columns, const ConstMatrixRef& target, bool centred) {
  const Index rows = columns.rows(), needed = columns.cols() + extra_rows + (centred ? 1 : 0);
  if (columns.cols() == 0 || rows < needed) return std::nullopt;
  // A few rows suffice to rule out most cases.
  if (rows > 2 * needed) {
    const Matrix few = normalised(some_rows(columns, needed), centred);
    const Vector t = normalised(some_rows(target, needed), centred);
    if (left_over(few, t) > 100 * nothing_left) return std::nullopt;
  }
  const Matrix a = normalised(columns, centred);
  const Vector t = normalised(target, centred);
  if (t.isZero(0) || left_over(a, t) > nothing_left) return std::nullopt;

  std::vector<Index> chosen;
  const auto left = [&](const std::vector<Index>& set) { return left_over(a(Eigen::all, set), t); };
  while (Index(chosen.size()) < a.cols() && left(chosen) > nothing_left) {
    // Takes the column that leaves the smallest residual. Because columns may be far from orthogonal, this need not be
    // the column with the largest product.
    double least = std::numeric_limits<double>::infinity();
    Index best = -1;
    for (Index j = 0; j < a.cols(); ++j) {
      if (a.col(j).isZero(0) || std::find(chosen.begin(), chosen.end(), j) != chosen.end()) continue;
      std::vector<Index> with = chosen;
      with.push_back(j);
      // Of equally good columns the first is taken.
      if (const double rest = std::max(left(with), nothing_left); rest < 0.99 * least) least = rest, best = j;
    }
    if (best < 0) return std::nullopt;
    chosen.push_back(best);
  }
  for (size_t i = 0; i < chosen.size() && chosen.size() > 1;) {
    std::vector<Index> without = chosen;
    without.erase(without.begin() + std::ptrdiff_t(i));
    if (left(without) <= nothing_left)
      chosen = std::move(without);
    else
      ++i;
  }
  std::sort(chosen.begin(), chosen.end());

  Matrix plain = columns(Eigen::all, chosen);
  Vector y = target;
  if (centred) {
    plain.rowwise() -= Eigen::RowVectorXd(plain.colwise().mean());
    y.array() -= y.mean();
  }
  const Vector x = linalg::minimum_norm(plain, y, 1e-12).x;
  Combination result;
  for (size_t i = 0; i < chosen.size(); ++i) result.terms.push_back({chosen[i], x(Index(i))});
  const Vector rest = target - columns(Eigen::all, chosen) * x;
  result.constant = centred && std::abs(rest.mean()) > nothing_left * target.cwiseAbs().maxCoeff();
  return result;
}

bool same_sum(const std::vector<Finding::Term>& a, const std::vector<Finding::Term>& b) {
  constexpr double tolerance = 1e-3;
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [&](const Finding::Term& x, const Finding::Term& y) {
    const double own = x.factor / a.front().factor, other = y.factor / b.front().factor;
    return x.channel == y.channel && x.lag == y.lag && std::abs(own - other) <= tolerance * std::abs(own);
  });
}

}  // namespace tokid
