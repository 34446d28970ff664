// The stages of an identification once more, by the plainest formulas and with 50 digits: what the results of double
// precision are held against. Every stage starts from the same numbers as the one that it judges.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <boost/multiprecision/cpp_bin_float.hpp>
#include <boost/multiprecision/eigen.hpp>
#include <vector>

#include "tokid/gtv_arx.hpp"
#include "tokid/model.hpp"

namespace tokid::testing::oracle {

using Real = boost::multiprecision::number<boost::multiprecision::cpp_bin_float<50>, boost::multiprecision::et_off>;
using Exact = Eigen::Matrix<Real, Eigen::Dynamic, Eigen::Dynamic>;

inline Exact exact(const ConstMatrixRef& a) { return a.cast<Real>(); }
// ‖a - truth‖_F
double distance(const ConstMatrixRef& a, const Exact& truth);

// min ‖A x - b‖ for A (rows × L) of full rank. Normal equations: their condition, at most 1e24 here, leaves 26 digits.
struct LeastSquares {
  Exact x;                 // (L × m)
  double size = 0.0;       // ‖A‖_F
  double condition = 0.0;  // ‖A‖_F ‖A⁺‖_F
  Vector right, residual;  // (m) ‖b‖, ‖b - A x‖ of each column
};
LeastSquares least_squares(const Exact& a, const Exact& b);

// Pulse responses, blocks as in Markov: γ-1 of step k is that of a pulse at step k-γ.
struct Responses {
  std::vector<Exact> system, gain;  // (T) of (m × band·r), (m × band·m)
};
Responses responses(const GtvArx& arx, Index band);
Responses responses(const Model& model, Index band);

// (S) of (N × m): outputs from the state x0 (N × n_0) on; with `corrected`, the predictions of the observer from the
// outputs of the data.
std::vector<Exact> outputs(const Model& model, const Ensemble& data, const Matrix& x0, bool corrected);

// The covariances (S+1) and gains (S) of the Kalman filter, by the Riccati recursion as textbooks have it.
struct Filter {
  std::vector<Exact> P, K;
};
Filter kalman_filter(const Model& model);

}  // namespace tokid::testing::oracle
