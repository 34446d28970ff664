// Kalman filters as textbooks have them, by the 50 digits of studies/oracle.hpp, and rounded once at the end. Without
// its types, which take a compiler long.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <vector>

#include "tokid/model.hpp"

namespace tokid::testing::textbook {

Matrix product(const ConstMatrixRef& a, const ConstMatrixRef& b);
Matrix propagated(const ConstMatrixRef& f, const ConstMatrixRef& p, const ConstMatrixRef& noise);  // F P Fᵀ + noise

// Jointly Gaussian z and y, without a recursion.
struct GivenOutputs {
  Matrix gain;        // the weight of y in the mean of z given y
  Matrix covariance;  // of z given y, a Schur complement
  Matrix S;           // covariance of y
  double log_det;     // of S
};
// z of covariance P, y = H z + noise of covariance R.
GivenOutputs corrected(const Matrix& p, const Matrix& h, const Matrix& r);
// z = A x - G ε, y = C x + ε, for x of covariance P and ε of covariance S.
GivenOutputs next_state(const Matrix& a, const Matrix& c, const Matrix& g, const Matrix& p, const Matrix& s);

std::vector<Matrix> covariances(const Model& model);  // (S+1) P of the Kalman filter

// S = C P Cᵀ + Σ,  G⁺ = (G Σ - A P Cᵀ) S⁻¹,  P⁺ = A P Aᵀ + G Σ Gᵀ + Q' - G⁺ S G⁺ᵀ from P = 0 on.
class FilterGains {
 public:
  explicit FilterGains(Index states);
  void advance(const Step& step, const Matrix& innovation_root, const Matrix& state_root);  // roots of Σ and Q'
  Matrix gain, S;

 private:
  struct Covariance;
  std::shared_ptr<Covariance> covariance_;
};

}  // namespace tokid::testing::textbook
