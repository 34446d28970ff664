// The stages of an identification once more, by the plainest formulas and with 50 digits: what the results of double
// precision are held against. Every stage starts from the same numbers as the one that it judges.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <boost/multiprecision/cpp_bin_float.hpp>
#include <boost/multiprecision/eigen.hpp>
#include <functional>
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
  Exact inverse_root;      // (L × L) X, XᵀX = (AᵀA)⁻¹
  double size = 0.0;       // ‖A‖_F
  double condition = 0.0;  // ‖A‖_F ‖A⁺‖_F
  Vector right, residual;  // (m) ‖b‖, ‖b - A x‖ of each column
};
LeastSquares least_squares(const Exact& a, const Exact& b);

// Matrices of a model as Model has them.
struct System {
  Index inputs = 0, outputs = 0, k_begin = 0;
  std::vector<Exact> A, B, C, G;  // (S)
};
System system(const Model& model);

// Pulse responses, blocks as in Markov: γ-1 of step k is that of a pulse at step k-γ.
struct Responses {
  std::vector<Exact> system, gain;  // (T) of (m × band·r), (m × band·m)
};
Responses responses(const GtvArx& arx, Index band);
Responses responses(const System& system, Index band);
inline Responses responses(const Model& model, Index band) { return responses(system(model), band); }

// (S) of (N × m): outputs from the state x0 (N × n_0) on; with `corrected`, the predictions of the observer from the
// outputs of the data.
std::vector<Exact> outputs(const Model& model, const Ensemble& data, const Matrix& x0, bool corrected);

// The covariances (S+1) and gains (S) of the Kalman filter, by the Riccati recursion as textbooks have it.
struct Filter {
  std::vector<Exact> P, K;
};
Filter kalman_filter(const Model& model);

// The predictor subspace, every step by itself, from samples without gaps and unknown initial states.

struct Arx {
  Index inputs = 0, outputs = 0, lags = 0;
  std::vector<Exact> coefficients, residual_cov;  // (T), empty before step p
};
Arx arx(const GtvArx& arx);  // of one lag order
Arx arx(const Ensemble& data, Index lags);

// Of the predictor M_k of every step from p on: x_k = map · z_k, from the eigenvectors of Σ^{-1/2} M_k ZᵀZ M_kᵀ
// Σ^{-T/2}.
struct States {
  std::vector<Exact> singular_values;  // (T) of (q × 1)
  std::vector<Exact> map;              // (T) of (n_k × p·d)
};
States states(const Arx& arx, const Ensemble& data, Index most, bool many_steps);

std::vector<Exact> samples(const States& states, const Ensemble& data, Index lags);  // (T) x_k (N × n_k)

// The regressions on samples of the states, and the gains of the Kalman filter that goes with what they leave.
struct Realised {
  System system;
  std::vector<Exact> innovation_cov;  // (S)
};
// `handed`, if there is one: what becomes of the residuals of the outputs on their way to the regression of the state.
using Handed = std::function<Exact(Index k, const Exact& residuals)>;
Realised realise(const std::vector<Exact>& states, const Ensemble& data, Index lags, const Handed& handed = {});

// Expectation: the second moments of [x_k; u_k; y_k] and [x_k; u_k; x_{k+1}] summed over the experiments, given all
// samples that are there. All others, and the states, are the unknowns of one least-squares problem per experiment,
// whose inverse normal matrix is their covariance.
struct Expectation {
  std::vector<Exact> measured, moved;  // (T)
  Exact log_likelihood;                // (N × 1)
};
Expectation expectation(const Model& model, const Ensemble& data);

// Maximisation: the regression of the last entries of [z; y] on the first ones (L), from their second moments.
struct Regression {
  Exact coefficients, residual;  // (q × L), (q × q) sum of squares
};
Regression regression(const ConstMatrixRef& moments, Index regressors);

}  // namespace tokid::testing::oracle
