// SPDX-License-Identifier: BSD-3-Clause
#include "modes/tracks.hpp"

#include <algorithm>
#include <cmath>
#include <complex>
#include <limits>
#include <numeric>

namespace tokid::modes_of {

namespace {

constexpr Index slope_steps = 4;  // steps over which the slope of a pole is taken: shorter ones are as random as noise

bool known(const StepModes& spectrum) { return spectrum.poles.allFinite(); }

// 0 for equal numbers, at most 1
double relative_distance(std::complex<double> a, std::complex<double> b) {
  const double size = std::abs(a) + std::abs(b);
  return size > 0 ? std::abs(a - b) / size : 0.0;
}

StepModes sorted(const StepModes& spectrum, const std::vector<Index>& order) {
  StepModes result = spectrum;
  for (size_t i = 0; i < order.size(); ++i) {
    result.poles(Index(i)) = spectrum.poles(order[i]);
    result.shapes.col(Index(i)) = spectrum.shapes.col(order[i]);
  }
  return result;
}

// A conjugate pair and its predictions are symmetric. Both ways to place two real poles in a pair are then equal, and
// rounding errors must not decide.
void put_positive_first(StepModes& spectrum) {
  for (Index i = 0; i < spectrum.poles.size(); ++i)
    for (Index j = i + 1; j < spectrum.poles.size() && spectrum.poles(i).imag() < 0; ++j)
      if (spectrum.poles(j) == std::conj(spectrum.poles(i))) {
        std::swap(spectrum.poles(i), spectrum.poles(j));
        spectrum.shapes.col(i).swap(spectrum.shapes.col(j));
      }
}

double median_size(const std::vector<StepModes>& spectra, Index column) {
  std::vector<double> sizes;
  for (const StepModes& spectrum : spectra)
    if (known(spectrum)) sizes.push_back(std::abs(spectrum.poles(column)));
  if (sizes.empty()) return 0.0;
  const auto middle = sizes.begin() + std::ptrdiff_t(sizes.size() / 2);
  std::nth_element(sizes.begin(), middle, sizes.end());
  return *middle;
}

}  // namespace

// Shortest augmenting paths with potentials u, v: Kuhn 1955, Munkres 1957. Index 0 stands for "none".
std::vector<Index> assignment(const Matrix& cost) {
  const Index n = cost.rows();
  std::vector<double> u(size_t(n) + 1), v(size_t(n) + 1);
  std::vector<size_t> row_of(size_t(n) + 1), way(size_t(n) + 1);
  for (size_t row = 1; row <= size_t(n); ++row) {
    row_of[0] = row;
    std::vector<double> shortest(size_t(n) + 1, std::numeric_limits<double>::infinity());
    std::vector<bool> used(size_t(n) + 1);
    size_t column = 0;
    do {
      used[column] = true;
      const size_t from = row_of[column];
      double least = std::numeric_limits<double>::infinity();
      size_t next = 0;
      for (size_t j = 1; j <= size_t(n); ++j) {
        if (used[j]) continue;
        const double reduced = cost(Index(from) - 1, Index(j) - 1) - u[from] - v[j];
        if (reduced < shortest[j]) shortest[j] = reduced, way[j] = column;
        if (shortest[j] < least) least = shortest[j], next = j;
      }
      for (size_t j = 0; j <= size_t(n); ++j)
        if (used[j])
          u[row_of[j]] += least, v[j] -= least;
        else
          shortest[j] -= least;
      column = next;
    } while (row_of[column] != 0);
    for (; column != 0; column = way[column]) row_of[column] = row_of[way[column]];
  }
  std::vector<Index> result(static_cast<size_t>(n));
  for (size_t j = 1; j <= size_t(n); ++j) result[row_of[j] - 1] = Index(j) - 1;
  return result;
}

double sine(const Eigen::VectorXcd& a, const Eigen::VectorXcd& b) {
  const double size = a.norm() * b.norm();
  if (!(size > 0)) return 0.0;
  // The part of b that is orthogonal to a: no digits are lost for small angles.
  return std::min(1.0, (b - a * (a.dot(b) / a.squaredNorm())).norm() / b.norm());
}

void follow(std::vector<StepModes>& spectra) {
  std::vector<size_t> past;  // steps with poles
  for (size_t k = 0; k < spectra.size(); ++k) {
    if (!known(spectra[k])) continue;
    if (!past.empty()) {
      const StepModes& last = spectra[past.back()];
      const size_t back = std::min<size_t>(slope_steps, past.size() - 1);
      const size_t first = past[past.size() - 1 - back];
      Eigen::VectorXcd predicted = last.poles;
      if (back > 0)
        predicted += (last.poles - spectra[first].poles) * (double(k - past.back()) / double(past.back() - first));
      const Index n = predicted.size();
      Matrix cost(n, n);
      for (Index i = 0; i < n; ++i)
        for (Index j = 0; j < n; ++j)
          cost(i, j) =
              relative_distance(predicted(i), spectra[k].poles(j)) + sine(last.shapes.col(i), spectra[k].shapes.col(j));
      spectra[k] = sorted(spectra[k], assignment(cost));
    }
    put_positive_first(spectra[k]);
    past.push_back(k);
  }
}

void sort_columns(std::vector<StepModes>& spectra) {
  if (spectra.empty()) return;
  const Index n = spectra.front().poles.size();
  std::vector<double> size;
  for (Index i = 0; i < n; ++i) size.push_back(median_size(spectra, i));
  std::vector<Index> order(static_cast<size_t>(n));
  std::iota(order.begin(), order.end(), Index(0));
  std::stable_sort(order.begin(), order.end(), [&](Index a, Index b) { return size[size_t(a)] < size[size_t(b)]; });
  for (StepModes& spectrum : spectra) {
    spectrum = sorted(spectrum, order);
    put_positive_first(spectrum);
  }
}

}  // namespace tokid::modes_of
