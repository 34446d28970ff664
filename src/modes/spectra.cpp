// SPDX-License-Identifier: BSD-3-Clause
#include "modes/spectra.hpp"

#include <algorithm>
#include <cmath>
#include <complex>

#include "base/nan.hpp"
#include "modes/frozen.hpp"
#include "tokid/linalg.hpp"
#include "tokid/parallel.hpp"

namespace tokid::modes_of {

namespace {

constexpr double smallest = 1e-12;  // |z| of a pole that decays within a step
constexpr std::complex<double> none(nan, nan);

std::complex<double> continuous(std::complex<double> z, double dt) {
  return std::complex<double>(std::log(std::max(std::abs(z), smallest)), std::arg(z)) / dt;
}

StepModes spectrum_of(const Step& frozen, Index states, double dt) {
  const Index m = frozen.outputs();
  StepModes result{Eigen::VectorXcd::Constant(states, none), Eigen::MatrixXcd::Constant(m, states, none)};
  if (frozen.states() == 0) return result;
  const linalg::Eigensystem eigen = linalg::eigensystem(frozen.A());
  if (!eigen.values.allFinite()) return result;
  for (Index i = 0; i < states; ++i) result.poles(i) = continuous(eigen.values(i), dt);
  result.shapes = frozen.C().cast<std::complex<double>>() * eigen.right;
  for (Index i = 0; i < states; ++i) {
    Index largest = 0;
    const double size = result.shapes.col(i).cwiseAbs().maxCoeff(&largest);
    if (size > 0) result.shapes.col(i) /= std::complex<double>(result.shapes(largest, i));
  }
  return result;
}

Eigen::VectorXcd in_order_of(const Eigen::VectorXcd& original, const Eigen::VectorXcd& found) {
  const Index n = original.size();
  Eigen::VectorXcd result = Eigen::VectorXcd::Constant(n, none);
  if (found.size() != n || !original.allFinite() || !found.allFinite()) return result;
  Matrix cost(n, n);
  for (Index i = 0; i < n; ++i)
    for (Index j = 0; j < n; ++j) cost(i, j) = std::abs(original(i) - found(j));
  const std::vector<Index> column = assignment(cost);
  for (Index i = 0; i < n; ++i) result(i) = found(column[size_t(i)]);
  return result;
}

}  // namespace

Spectra spectra(const Model& model, Index window, const Execution& execution) {
  const Frozen frozen(model, window);
  Spectra result{frozen.begin(), frozen.window(), std::vector<StepModes>(size_t(frozen.count()))};
  parallel_for(0, frozen.count(), execution, [&](Index begin, Index end) {
    const std::vector<Step> systems = frozen.systems(frozen.begin() + begin, end - begin);
    for (Index i = begin; i < end; ++i)
      result.step[size_t(i)] = spectrum_of(systems[size_t(i - begin)], frozen.states(), model.dt);
  });
  return result;
}

Eigen::MatrixXcd poles_in_order(const Eigen::MatrixXcd& original, Index begin, const Spectra& found) {
  Eigen::MatrixXcd result = Eigen::MatrixXcd::Constant(original.rows(), original.cols(), none);
  for (Index k = 0; k < original.rows(); ++k) {
    const Index at = begin + k - found.begin;
    if (at < 0 || at >= Index(found.step.size())) continue;
    result.row(k) = in_order_of(original.row(k).transpose(), found.step[size_t(at)].poles).transpose();
  }
  return result;
}

}  // namespace tokid::modes_of
