// SPDX-License-Identifier: BSD-3-Clause
#include "design/inputs.hpp"

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <numbers>

namespace tokid::design {

Matrix gaussian_inputs(const InputSizes& sizes, RandomNumbers& random) {
  Matrix u(sizes.experiments, sizes.steps * sizes.inputs);
  for (double& value : u.reshaped()) {
    do value = random.normal() / 3;
    while (std::abs(value) > 1);
  }
  return u;
}

namespace {

// Flips signs of `v` one after the other, as long as this reduces ‖oldᵀ v‖².
void flip_towards_orthogonal(const ConstMatrixRef& old, Eigen::Ref<Vector> v) {
  constexpr int sweeps = 4;
  Vector product = old.transpose() * v;
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    bool flipped = false;
    for (Index i = 0; i < v.size(); ++i) {
      const double slope = v(i) * old.row(i).dot(product), curvature = old.row(i).squaredNorm();
      if (slope <= curvature * (1 + 1e-12)) continue;  // ‖product - 2 v_i old_i‖² is not smaller
      product -= 2 * v(i) * old.row(i).transpose();
      v(i) = -v(i);
      flipped = true;
    }
    if (!flipped) return;
  }
}

}  // namespace

Matrix binary_inputs(const InputSizes& sizes, RandomNumbers& random) {
  const Index columns = sizes.steps * sizes.inputs;
  // As far as the number of experiments permits, each column is orthogonal to the earlier inputs that affect the window
  // and its state.
  const Index reach = std::min(sizes.experiments - 1, 2 * (sizes.lags + 1) * sizes.inputs);
  Matrix u(sizes.experiments, columns);
  for (Index c = 0; c < columns; ++c) {
    u.col(c) = random.signs(sizes.experiments);
    const Index first = std::max<Index>(0, c - reach);
    flip_towards_orthogonal(u.middleCols(first, c - first), u.col(c));
  }
  return u;
}

namespace {

// Lines of the spectrum: cycles per record, evenly spread up to 0.8 of the Nyquist frequency. A window does not change
// with more than a few hundred lines.
std::vector<double> spectral_lines(Index steps) {
  const Index highest = std::max<Index>(1, Index(0.4 * double(steps)));
  const Index count = std::min<Index>(highest, 256);
  std::vector<double> lines;
  for (Index i = 1; i <= count; ++i) lines.push_back(std::round(double(i) * double(highest) / double(count)));
  return lines;
}

}  // namespace

Matrix multisine_inputs(const InputSizes& sizes, RandomNumbers& random) {
  constexpr double turn = 2 * std::numbers::pi;
  const Index r = sizes.inputs, steps = sizes.steps, signals = sizes.experiments * r;
  const std::vector<double> lines = spectral_lines(steps);
  const Index count = static_cast<Index>(lines.size());
  Matrix waves(2 * count, steps);  // cosines above sines
  for (Index f = 0; f < count; ++f)
    for (Index k = 0; k < steps; ++k) {
      const double angle = turn * std::fmod(lines[size_t(f)] * double(k), double(steps)) / double(steps);
      waves(f, k) = std::cos(angle);
      waves(count + f, k) = std::sin(angle);
    }

  // Signal q shifts the phase of a line by q·s/Q turns. The shifts s of the lines are spread evenly over 0 … Q-1, so
  // that the phase of each line turns a different number of times over the signals. The signals are therefore as
  // orthogonal as the number of lines allows. The function makes a few draws and keeps the one with the smallest peak.
  const double work = double(signals) * double(2 * count) * double(steps);
  const Index draws = std::clamp<Index>(Index(1e9 / work), 1, 16);
  Matrix best;
  double smallest = std::numeric_limits<double>::infinity();
  for (Index draw = 0; draw < draws; ++draw) {
    const std::vector<Index> shifts = random.permutation(std::max(count, signals));
    const std::vector<Index> order = random.permutation(signals);
    Matrix weights(signals, 2 * count);
    for (Index f = 0; f < count; ++f) {
      const double start = turn * random.uniform();
      const Index shift = shifts[size_t(f)] % signals;
      for (Index q = 0; q < signals; ++q) {
        const double phase = start + turn * double((order[size_t(q)] * shift) % signals) / double(signals);
        weights(q, f) = std::cos(phase);
        weights(q, count + f) = -std::sin(phase);
      }
    }
    Matrix u = weights * waves;  // cos(angle + phase), summed over the lines
    const double peak = u.cwiseAbs().maxCoeff();
    if (peak >= smallest) continue;
    smallest = peak;
    best = std::move(u);
  }
  Matrix u(sizes.experiments, steps * r);
  for (Index k = 0; k < steps; ++k)
    for (Index i = 0; i < r; ++i) u.col(k * r + i) = best.col(k).segment(i * sizes.experiments, sizes.experiments);
  return u / smallest;
}

namespace {

// Orthogonal columns with entries between -√2 and √2: columns of the discrete Hartley transform, with their rows in
// random order. Only the columns for a few windows are made, because more are of no use.
Matrix directions(const InputSizes& sizes, bool zero_mean, RandomNumbers& random) {
  const Index size = sizes.experiments, first = zero_mean ? 1 : 0;  // column 0 is constant
  const Index enough = std::max<Index>(256, 2 * minimum_experiments(sizes.inputs, sizes.outputs, sizes.lags));
  Matrix basis(size, std::min(size - first, enough));
  const std::vector<Index> rows = random.permutation(size);
  Vector values(size);  // all values of the transform
  for (Index i = 0; i < size; ++i) {
    const double angle = 2 * std::numbers::pi * double(i) / double(size);
    values(i) = std::cos(angle) + std::sin(angle);
  }
  for (Index j = 0; j < basis.cols(); ++j)
    for (Index i = 0; i < size; ++i) basis(i, j) = values((rows[size_t(i)] * (j + first)) % size);
  if (zero_mean) return basis;

  // The rows get random signs. The best of a few draws keeps the means of all columns small, so that no column looks
  // like a mean motion.
  Vector signs;
  double smallest = std::numeric_limits<double>::infinity();
  for (int draw = 0; draw < 32; ++draw) {
    const Vector candidate = random.signs(size);
    const double mean = (candidate.transpose() * basis).cwiseAbs().maxCoeff();
    if (mean >= smallest) continue;
    smallest = mean;
    signs = candidate;
  }
  return signs.asDiagonal() * basis;
}

}  // namespace

Matrix orthogonal_inputs(const InputSizes& sizes, bool zero_mean, Index hold, RandomNumbers& random) {
  const Index r = sizes.inputs, p = sizes.lags;
  const Matrix basis = directions(sizes, zero_mean, random);
  const Index count = basis.cols();
  if (hold == 0) {
    // Without noise, this is the largest rank of a window. If the number of experiments equals this rank, large
    // condition numbers are most frequent.
    const Index rank = r * (p + 1) + sizes.states;
    hold = std::max<Index>(1, 6 / (1 + std::max<Index>(0, count - rank)));
  }

  // The directions that the last p steps do not use. The direction that was not used for the longest time is first.
  std::deque<Index> resting;
  for (const Index j : random.permutation(count)) resting.push_back(j);
  std::deque<Index> used;
  const Index fill = (count + r - 1) / r;  // steps until every direction was used once
  Matrix u(sizes.experiments, sizes.steps * r);
  for (Index k = 0; k < sizes.steps; ++k) {
    for (; static_cast<Index>(used.size()) > p * r; used.pop_front()) resting.push_back(used.front());
    const bool exchange = k < fill || (k - fill) % hold == 0;
    for (Index i = 0; i < r; ++i) {
      const Index j = exchange ? resting.front() : resting.back();
      if (exchange)
        resting.pop_front();
      else
        resting.pop_back();
      used.push_back(j);
      u.col(k * r + i) = random.sign() * basis.col(j);
    }
  }
  return u / basis.cwiseAbs().maxCoeff();
}

}  // namespace tokid::design
