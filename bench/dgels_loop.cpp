// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <numeric>
#include <stdexcept>
#include <vector>

#include "loops.hpp"

extern "C" void dgels_(const char* trans, const int* m, const int* n, const int* nrhs, double* a, const int* lda,
                       double* b, const int* ldb, double* work, const int* lwork, int* info, std::size_t trans_length);

void dgels_loop(const Windows& w, std::ptrdiff_t begin, std::ptrdiff_t end, double* results) {
  const std::ptrdiff_t d = w.inputs + w.outputs, regressors = w.lags * d + w.inputs, m = w.outputs;
  const int rows = int(w.experiments), columns = int(regressors), right = int(m);
  std::vector<double> a(size_t(rows * regressors)), y(size_t(rows * m)), work(1);
  const auto solve = [&](int size) {
    int info = 0;
    dgels_("N", &rows, &columns, &right, a.data(), &rows, y.data(), &rows, work.data(), &size, &info, 1);
    if (info != 0) throw std::runtime_error("dgels: a window without full rank");
  };
  solve(-1);  // asks for the size of the workspace
  work.resize(size_t(work[0]));
  for (std::ptrdiff_t k = begin; k < end; ++k) {
    const double* window = w.samples + (k - w.lags) * d * rows;
    const double* outputs = w.samples + (k * d + w.inputs) * rows;
    std::copy_n(window, a.size(), a.begin());
    std::copy_n(outputs, y.size(), y.begin());
    solve(int(work.size()));
    double* result = results + (k - begin) * (regressors + 1) * m;
    for (std::ptrdiff_t j = 0; j < m; ++j, result += regressors + 1) {
      const double* column = y.data() + j * rows;
      std::copy_n(column, regressors, result);
      result[regressors] = std::inner_product(column + regressors, column + rows, column + regressors, 0.0);
    }
  }
}
