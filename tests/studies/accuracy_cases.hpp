// What the studies of accuracy share: random sizes, and how a result is held against its bound.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include "studies/accuracy.hpp"
#include "testing.hpp"
#include "tokid/gtv_arx.hpp"

namespace tokid::testing {

inline Index whole(Random& random, Index from, Index to) { return Index(random.uniform(double(from), double(to) + 1)); }
inline double power(Random& random, double from, double to) { return std::pow(10.0, random.uniform(from, to)); }

// n ≤ 12, with p m = n.
struct Sizes {
  Index n, m, r, p;
  Index channels() const { return r + m; }
  Index regressors() const { return minimum_experiments(r, m, p); }
};
inline Sizes draw_sizes(Random& random) {
  const Index m = whole(random, 1, 3), r = whole(random, 1, 3), p = whole(random, 1, 4);
  return {p * m, m, r, p};
}

// N_min to 10 N_min experiments, as many small ensembles as large ones.
inline Index draw_experiments(Random& random, Index fewest) {
  return Index(std::lround(double(fewest) * power(random, 0.0, 1.0)));
}

// Standard deviations from 0.001 to 1.
inline Matrix draw_covariance(Random& random, Index size) {
  Vector s(size);
  for (double& value : s) value = power(random, -3.0, 0.0);
  const Matrix f = random.orthogonal(size) * s.asDiagonal(), square = f * f.transpose();
  return (square + square.transpose()) / 2;
}

// An error of a result, what ε may make of it to first order, in units of ε, and the size of the result itself.
inline void see(Accuracy& accuracy, double error, double unit, double size) {
  if (error == 0 && unit == 0) return;
  const auto raise = [](double& most, double value) {
    if (!(value <= most) && !std::isnan(most)) most = value;  // what is no number stays
  };
  raise(accuracy.error, error / size);
  raise(accuracy.growth, unit / size);
  raise(accuracy.ratio, error / (epsilon * unit));
}

// Those of accuracy_noise.cpp.
AccuracyFindings predictor_subspaces(int cases);
AccuracyFindings likelihoods(int cases);

}  // namespace tokid::testing
