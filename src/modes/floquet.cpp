// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "tokid/linalg.hpp"
#include "tokid/modes.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

constexpr Index most_cycles = 64;   // times round the period
constexpr double separate = 1e-10;  // coupling of two subspaces that counts as none: the relative error that it makes
constexpr double enough_digits = 1e-6;  // ratio of the eigenvalues of one product that keeps ten digits of the smallest

// value · 2^exponent: powers of two add no rounding errors, and neither overflow nor underflow.
struct Scaled {
  std::complex<double> value;
  long exponent = 0;
  double log_size() const { return std::log(std::abs(value)) + double(exponent) * std::numbers::ln2; }
};

// The matrices A_k of the last period, because the states of the first steps may not all exist. Smaller matrices get
// rows and columns of zeros, which add multipliers that are zero.
std::vector<Matrix> last_period(const Model& model) {
  if (model.period < 1 || model.steps() < model.period)
    throw std::invalid_argument(fmt::format("period: {} found in a model of {} steps, 1 to {} needed", model.period,
                                            model.steps(), model.steps()));
  std::vector<Matrix> result;
  Index n = 0;
  for (Index k = model.k_end() - model.period; k < model.k_end(); ++k) n = std::max({n, model.n(k), model.n(k + 1)});
  for (Index k = model.k_end() - model.period; k < model.k_end(); ++k) {
    Matrix& a = result.emplace_back(Matrix::Zero(n, n));
    a.topLeftCorner(model.n(k + 1), model.n(k)) = model.at(k).A();
  }
  return result;
}

// A_k Q_k = Q_{k+1} R_k over a period, from Q_0 = `start`. Cycle after cycle, the first columns of Q turn to the
// subspaces that grow most (orthogonal iteration): the product of the A_k becomes block triangular without being
// formed.
struct Cycle {
  Matrix end;             // Q_P
  std::vector<Matrix> r;  // R_k, upper triangular
};
Cycle cycle(const std::vector<Matrix>& a, const Matrix& start) {
  Cycle result{start, {}};
  for (const Matrix& step : a) {
    checkpoint();
    const Matrix moved = step * result.end;
    result.end = linalg::orthonormal_factor(moved);
    result.r.emplace_back((result.end.transpose() * moved).triangularView<Eigen::Upper>());
  }
  return result;
}

// Eigenvalues of the diagonal block of startᵀ · end · R_{P-1} … R_0 from row `first` on.
std::vector<Scaled> eigenvalues_of_block(const Cycle& cycle, const Matrix& closure, Index first, Index size) {
  Matrix product = Matrix::Identity(size, size);
  long exponent = 0;
  const auto multiply = [&](const Matrix& factor) {
    product = factor.block(first, first, size, size) * product;
    const double largest = product.cwiseAbs().maxCoeff();
    if (!(largest > 0) || !std::isfinite(largest)) return;
    const int shift = std::ilogb(largest);
    product *= std::ldexp(1.0, -shift);
    exponent += shift;
  };
  for (const Matrix& factor : cycle.r) multiply(factor);
  multiply(closure);
  std::vector<Scaled> result;
  for (const std::complex<double> value : linalg::eigenvalues(product)) result.push_back({value, exponent});
  return result;
}

// Whether the smallest eigenvalue has enough digits beside the largest.
bool exact(const std::vector<Scaled>& block) {
  double least = std::abs(block.front().value), most = least;
  for (const Scaled& scaled : block) {
    least = std::min(least, std::abs(scaled.value));
    most = std::max(most, std::abs(scaled.value));
  }
  return block.size() == 1 || !(least < enough_digits * most);
}

// The n multipliers, in decreasing size.
std::vector<Scaled> multipliers(const Model& model) {
  const std::vector<Matrix> a = last_period(model);
  const Index size = a.front().rows();
  Matrix start = Matrix::Identity(size, size);
  std::vector<Scaled> result;
  for (Index i = 0; i < most_cycles; ++i) {
    const Cycle round = cycle(a, start);
    const Matrix closure = start.transpose() * round.end;
    bool done = true;
    result.clear();
    for (Index first = 0, last = 1; last <= size; ++last) {
      if (last < size && !(closure.bottomLeftCorner(size - last, last).norm() <= separate)) continue;
      const std::vector<Scaled> block = eigenvalues_of_block(round, closure, first, last - first);
      done = done && exact(block);
      result.insert(result.end(), block.begin(), block.end());
      first = last;
    }
    if (done) break;
    start = round.end;
  }
  std::stable_sort(result.begin(), result.end(), [](const Scaled& x, const Scaled& y) {
    return x.log_size() != y.log_size() ? x.log_size() > y.log_size() : x.value.imag() > y.value.imag();
  });
  result.resize(size_t(model.n(model.k_end())));
  return result;
}

}  // namespace

Eigen::VectorXcd floquet_multipliers(const Model& model) {
  const std::vector<Scaled> found = multipliers(model);
  Eigen::VectorXcd result{Index(found.size())};
  const auto part = [](double value, long exponent) {
    return std::ldexp(value, int(std::clamp(exponent, -10'000L, 10'000L)));
  };
  for (size_t i = 0; i < found.size(); ++i)
    result(Index(i)) = {part(found[i].value.real(), found[i].exponent), part(found[i].value.imag(), found[i].exponent)};
  return result;
}

Eigen::VectorXcd floquet_exponents(const Model& model) {
  const std::vector<Scaled> found = multipliers(model);
  const double period = double(model.period) * model.dt;
  Eigen::VectorXcd result{Index(found.size())};
  for (size_t i = 0; i < found.size(); ++i)
    result(Index(i)) = std::complex<double>(found[i].log_size(), std::arg(found[i].value)) / period;
  return result;
}

}  // namespace tokid
