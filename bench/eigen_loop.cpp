// Compiled twice, as eigen_loop and as eigen_native_loop, each into a library of its own: the templates of one
// instruction set must not be taken for those of the other.
// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/QR>

#include "loops.hpp"

using Eigen::Index;
using Eigen::MatrixXd;

void TOKID_LOOP(const Windows& w, std::ptrdiff_t begin, std::ptrdiff_t end, double* results) {
  const Index rows = w.experiments, m = w.outputs, d = w.inputs + m, regressors = w.lags * d + w.inputs;
  const Eigen::Map<const MatrixXd> samples(w.samples, rows, end * d);
  Eigen::HouseholderQR<MatrixXd> qr(rows, regressors);
  MatrixXd y(rows, m);
  for (Index k = begin; k < end; ++k) {
    qr.compute(samples.middleCols((k - w.lags) * d, regressors));
    y = samples.middleCols(k * d + w.inputs, m);
    y.applyOnTheLeft(qr.householderQ().adjoint());
    Eigen::Map<MatrixXd> result(results + (k - begin) * (regressors + 1) * m, regressors + 1, m);
    const auto r = qr.matrixQR().topRows(regressors).triangularView<Eigen::Upper>();
    result.topRows(regressors) = r.solve(y.topRows(regressors));
    result.bottomRows(1) = y.bottomRows(rows - regressors).colwise().squaredNorm();
  }
}
