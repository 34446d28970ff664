// SPDX-License-Identifier: BSD-3-Clause
#include "textbook.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "studies/oracle.hpp"

namespace tokid::testing::oracle {

Filter kalman_filter(const Model& model) {
  Filter filter;
  filter.P.push_back(exact(model.x0_cov));
  for (size_t s = 0; s < model.step.size(); ++s) {
    const Exact a = exact(model.step[s].A()), c = exact(model.step[s].C());
    const Exact cp = c * filter.P.back();
    const Exact innovation = cp * c.transpose() + exact(model.step[s].R());
    filter.K.emplace_back(Eigen::LLT<Exact>(innovation).solve(cp).transpose());
    const Exact updated = filter.P.back() - filter.K.back() * cp;
    Exact next = a * updated * a.transpose() + exact(model.step[s].Q());
    filter.P.emplace_back((next + next.transpose()) / Real(2));
  }
  return filter;
}

}  // namespace tokid::testing::oracle

namespace tokid::testing::textbook {

using oracle::exact;
using oracle::Exact;

namespace {

Matrix rounded(const Exact& a) { return a.cast<double>(); }

GivenOutputs given_outputs(const Exact& zz, const Exact& zy, const Exact& yy) {
  const Exact gain = zy * yy.inverse(), covariance = zz - gain * zy.transpose();
  return {rounded(gain), rounded(covariance), rounded(yy), double(log(yy.determinant()))};
}

}  // namespace

Matrix product(const ConstMatrixRef& a, const ConstMatrixRef& b) { return rounded(exact(a) * exact(b)); }

Matrix propagated(const ConstMatrixRef& f, const ConstMatrixRef& p, const ConstMatrixRef& noise) {
  const Exact F = exact(f);
  return rounded(F * exact(p) * F.transpose() + exact(noise));
}

GivenOutputs corrected(const Matrix& p, const Matrix& h, const Matrix& r) {
  const Exact P = exact(p), H = exact(h);
  return given_outputs(P, P * H.transpose(), H * P * H.transpose() + exact(r));
}

GivenOutputs next_state(const Matrix& a, const Matrix& c, const Matrix& g, const Matrix& p, const Matrix& s) {
  const Exact A = exact(a), C = exact(c), G = exact(g), P = exact(p), S = exact(s);
  return given_outputs(A * P * A.transpose() + G * S * G.transpose(), A * P * C.transpose() - G * S,
                       C * P * C.transpose() + S);
}

std::vector<Matrix> covariances(const Model& model) {
  std::vector<Matrix> result;
  for (const Exact& p : oracle::kalman_filter(model).P) result.push_back(rounded(p));
  return result;
}

struct FilterGains::Covariance {
  Exact P;
};

FilterGains::FilterGains(Index states) : covariance_(new Covariance{Exact::Zero(states, states)}) {}

void FilterGains::advance(const Step& step, const Matrix& innovation_root, const Matrix& state_root) {
  Exact& P = covariance_->P;
  const Exact A = exact(step.A()), C = exact(step.C()), G = exact(step.G()), V = exact(innovation_root),
              W = exact(state_root), sigma = V.transpose() * V, innovation = C * P * C.transpose() + sigma,
              own = (G * sigma - A * P * C.transpose()) * innovation.inverse();
  P = (A * P * A.transpose() + G * sigma * G.transpose() + W.transpose() * W - own * innovation * own.transpose())
          .eval();
  gain = rounded(own);
  S = rounded(innovation);
}

}  // namespace tokid::testing::textbook
