// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numbers>
#include <stdexcept>
#include <vector>

#include "modes/tracks.hpp"
#include "tokid/linalg.hpp"
#include "tokid/modes.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

constexpr Index most_cycles = 128;  // times round the period
constexpr double similar = 1e-2;    // share of a product's norm from which on its eigenvalues lose two digits at most
constexpr double rounding = 10;     // n·ε: coupling of two subspaces that rounding errors alone make
constexpr double most_coupling = 1e-4;  // coupling that may count as none if rounding errors keep it from falling
constexpr Index still_cycles = 8;       // cycles without a fall that show this
constexpr double epsilon = std::numeric_limits<double>::epsilon();

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
// subspaces that grow most (orthogonal iteration): the product of the A_k becomes block triangular. Only its diagonal
// blocks are formed.
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

// Two subspaces: the first columns of Q and the others.
struct Split {
  double lowest = std::numeric_limits<double>::infinity();  // coupling so far
  Index still = 0;                                          // cycles since it was low and fell last
  bool open = false;                                        // a product of each subspace is enough
};
// The coupling of separate multipliers falls to about ε. In badly scaled coordinates, rounding errors keep it higher. A
// rotating pair lets it rise at times, so some cycles decide.
Split after_cycle(Split split, double coupling, Index size) {
  split.still = coupling <= most_coupling && coupling >= split.lowest ? split.still + 1 : 0;
  split.lowest = std::min(split.lowest, coupling);
  split.open = coupling <= rounding * double(size) * epsilon || split.still >= still_cycles;
  return split;
}

// The product of the diagonal blocks of closure · R_{P-1} … R_0 from row `first` on.
struct Block {
  std::vector<Scaled> eigenvalues;
  // Rounding errors of a product grow with its norm. An eigenvalue far below the norm therefore loses digits.
  bool exact = true;
};
Block block_of(const Cycle& cycle, const Matrix& closure, Index first, Index size) {
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
  Block result;
  for (const std::complex<double> value : linalg::eigenvalues(product)) {
    result.eigenvalues.push_back({value, exponent});
    result.exact = result.exact && (size == 1 || std::abs(value) >= similar * product.norm());
  }
  return result;
}

// The eigenvalues of the product of square matrices a_{P-1} … a_0, in decreasing size.
std::vector<Scaled> eigenvalues_of_product(const std::vector<Matrix>& a) {
  const Index size = a.front().rows();
  Matrix start = Matrix::Identity(size, size);
  std::vector<Split> split(static_cast<size_t>(size));  // before each column
  std::vector<Scaled> result;
  for (Index i = 0; i < most_cycles; ++i) {
    const Cycle round = cycle(a, start);
    const Matrix closure = start.transpose() * round.end;
    bool done = true;
    result.clear();
    for (Index first = 0, last = 1; last <= size; ++last) {
      if (last < size) {
        Split& here = split[size_t(last)];
        here = after_cycle(here, closure.bottomLeftCorner(size - last, last).norm(), size);
        if (!here.open) continue;
      }
      const Block block = block_of(round, closure, first, last - first);
      done = done && block.exact;
      result.insert(result.end(), block.eigenvalues.begin(), block.eigenvalues.end());
      first = last;
    }
    if (done) break;
    start = round.end;
  }
  std::stable_sort(result.begin(), result.end(), [](const Scaled& x, const Scaled& y) {
    return x.log_size() != y.log_size() ? x.log_size() > y.log_size() : x.value.imag() > y.value.imag();
  });
  return result;
}

// The n multipliers, in decreasing size.
std::vector<Scaled> multipliers_of(const Model& model) {
  std::vector<Scaled> result = eigenvalues_of_product(last_period(model));
  result.resize(size_t(model.n(model.k_end())));
  return result;
}

// The transposed matrices in reverse order have the same multipliers, but other rounding errors.
std::vector<Scaled> multipliers_of_transposed(const Model& model) {
  std::vector<Matrix> a = last_period(model);
  std::reverse(a.begin(), a.end());
  for (Matrix& step : a) step.transposeInPlace();
  std::vector<Scaled> result = eigenvalues_of_product(a);
  result.resize(size_t(model.n(model.k_end())));
  return result;
}

// |y/x - 1|, at most 1
double relative_difference(const Scaled& x, const Scaled& y) {
  if (x.value == y.value && x.exponent == y.exponent) return 0.0;
  const std::complex<double> change(y.log_size() - x.log_size(), std::arg(y.value) - std::arg(x.value));
  const double result = std::abs(std::exp(change) - 1.0);
  return result < 1 ? result : 1.0;
}

Eigen::VectorXcd numbers_of(const std::vector<Scaled>& multipliers) {
  Eigen::VectorXcd result{Index(multipliers.size())};
  const auto number = [](double value, long exponent) {
    return std::ldexp(value, int(std::clamp(exponent, -10'000L, 10'000L)));
  };
  for (size_t i = 0; i < multipliers.size(); ++i)
    result(Index(i)) = {number(multipliers[i].value.real(), multipliers[i].exponent),
                        number(multipliers[i].value.imag(), multipliers[i].exponent)};
  return result;
}

Eigen::VectorXcd exponents_of(const std::vector<Scaled>& multipliers, double period) {
  Eigen::VectorXcd result{Index(multipliers.size())};
  for (size_t i = 0; i < multipliers.size(); ++i)
    result(Index(i)) = std::complex<double>(multipliers[i].log_size(), std::arg(multipliers[i].value)) / period;
  return result;
}

}  // namespace

Floquet floquet(const Model& model) {
  const std::vector<Scaled> found = multipliers_of(model), other = multipliers_of_transposed(model);
  Matrix difference(Index(found.size()), Index(found.size()));
  for (size_t i = 0; i < found.size(); ++i)
    for (size_t j = 0; j < found.size(); ++j) difference(Index(i), Index(j)) = relative_difference(found[i], other[j]);
  const std::vector<Index> partner = modes_of::assignment(difference);
  Floquet result{numbers_of(found), exponents_of(found, double(model.period) * model.dt), Vector(Index(found.size()))};
  for (size_t i = 0; i < found.size(); ++i)
    result.error(Index(i)) = std::max(epsilon, difference(Index(i), partner[i]));
  return result;
}

Eigen::VectorXcd floquet_multipliers(const Model& model) { return numbers_of(multipliers_of(model)); }

Eigen::VectorXcd floquet_exponents(const Model& model) {
  return exponents_of(multipliers_of(model), double(model.period) * model.dt);
}

}  // namespace tokid
