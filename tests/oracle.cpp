// SPDX-License-Identifier: BSD-3-Clause
#include "oracle.hpp"

#include <Eigen/Cholesky>
#include <algorithm>

namespace tokid::testing::oracle {

namespace {

// aᵀb column by column: numbers this long gain nothing from blocks.
Real product(const Exact& a, Index i, const Exact& b, Index j) {
  Real sum = 0;
  for (Index n = 0; n < a.rows(); ++n) sum += a(n, i) * b(n, j);
  return sum;
}

Exact identity(Index n) { return Exact::Identity(n, n); }

}  // namespace

double distance(const ConstMatrixRef& a, const Exact& truth) { return double(Exact(exact(a) - truth).norm()); }

LeastSquares least_squares(const Exact& a, const Exact& b) {
  const Index cols = a.cols(), right = b.cols();
  Exact gram(cols, cols), moments(cols, right);
  for (Index j = 0; j < cols; ++j) {
    for (Index i = j; i < cols; ++i) gram(i, j) = product(a, i, a, j);
    for (Index i = 0; i < right; ++i) moments(j, i) = product(a, j, b, i);
  }
  const Real square = gram.trace();
  const Eigen::LLT<Exact, Eigen::Lower> cholesky(gram);
  LeastSquares result;
  result.x = cholesky.solve(moments);
  const Exact inverse = cholesky.matrixL().solve(identity(cols));
  result.size = double(sqrt(square));
  result.condition = double(sqrt(square) * inverse.norm());
  result.right.resize(right);
  result.residual.resize(right);
  for (Index j = 0; j < right; ++j) {
    Real before = 0, after = 0;
    for (Index n = 0; n < a.rows(); ++n) {
      Real rest = b(n, j);
      before += rest * rest;
      for (Index i = 0; i < cols; ++i) rest -= a(n, i) * result.x(i, j);
      after += rest * rest;
    }
    result.right(j) = double(sqrt(before));
    result.residual(j) = double(sqrt(after));
  }
  return result;
}

Responses responses(const GtvArx& arx, Index band) {
  const Index steps = arx.steps(), r = arx.inputs, m = arx.outputs;
  Responses result;
  result.system.assign(size_t(steps), Exact::Zero(m, band * r));
  result.gain.assign(size_t(steps), Exact::Zero(m, band * m));
  for (Index k = arx.k_begin; k < steps; ++k) {
    const Index lags = arx.step[size_t(k)].lags;
    for (Index i = std::max(arx.k_begin, k - band); i < k; ++i) {
      Exact h = Exact::Zero(m, r), g = Exact::Zero(m, m);
      for (Index j = 1; j <= std::min(k - i, lags); ++j) {
        const Exact minus_h2 = exact(arx.output_block(k, j));
        if (j == k - i) {
          h += exact(arx.input_block(k, j)) + minus_h2 * exact(arx.D(i));
          g -= minus_h2;
        } else {
          const size_t step = size_t(k - j);
          h += minus_h2 * result.system[step].middleCols((k - j - i - 1) * r, r);
          g += minus_h2 * result.gain[step].middleCols((k - j - i - 1) * m, m);
        }
      }
      result.system[size_t(k)].middleCols((k - i - 1) * r, r) = h;
      result.gain[size_t(k)].middleCols((k - i - 1) * m, m) = g;
    }
  }
  return result;
}

Responses responses(const Model& model, Index band) {
  const Index steps = model.k_end(), r = model.inputs, m = model.outputs;
  Responses result;
  result.system.assign(size_t(steps), Exact::Zero(m, band * r));
  result.gain.assign(size_t(steps), Exact::Zero(m, band * m));
  for (Index i = model.k_begin; i + 1 < steps; ++i) {
    Exact state(model.n(i + 1), r + m);
    state << exact(model.B[model.at(i)]), exact(model.G[model.at(i)]);
    for (Index k = i + 1; k < std::min(steps, i + 1 + band); ++k) {
      const Exact output = exact(model.C[model.at(k)]) * state;
      result.system[size_t(k)].middleCols((k - i - 1) * r, r) = output.leftCols(r);
      result.gain[size_t(k)].middleCols((k - i - 1) * m, m) = output.rightCols(m);
      state = (exact(model.A[model.at(k)]) * state).eval();
    }
  }
  return result;
}

std::vector<Exact> outputs(const Model& model, const Ensemble& data, const Matrix& x0, bool corrected) {
  std::vector<Exact> result;
  Exact x = exact(x0);
  for (size_t s = 0; s < model.A.size(); ++s) {
    const Index k = model.k_begin + Index(s);
    const Exact u = exact(data.input(k));
    const Exact y = x * exact(model.C[s]).transpose() + u * exact(model.D[s]).transpose();
    Exact next = x * exact(model.A[s]).transpose() + u * exact(model.B[s]).transpose();
    if (corrected) next -= (exact(data.output(k)) - y) * exact(model.G[s]).transpose();
    result.push_back(y);
    x = next;
  }
  return result;
}

Filter kalman_filter(const Model& model) {
  Filter filter;
  filter.P.push_back(exact(model.x0_cov));
  for (size_t s = 0; s < model.A.size(); ++s) {
    const Exact a = exact(model.A[s]), c = exact(model.C[s]);
    const Exact cp = c * filter.P.back();
    const Exact innovation = cp * c.transpose() + exact(model.R[s]);
    filter.K.emplace_back(Eigen::LLT<Exact>(innovation).solve(cp).transpose());
    const Exact updated = filter.P.back() - filter.K.back() * cp;
    Exact next = a * updated * a.transpose() + exact(model.Q[s]);
    filter.P.emplace_back((next + next.transpose()) / Real(2));
  }
  return filter;
}

}  // namespace tokid::testing::oracle
