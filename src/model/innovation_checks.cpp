// SPDX-License-Identifier: BSD-3-Clause
#include "model/innovation_checks.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace tokid {

void check_innovations(const std::vector<Matrix>& innovations, const Ensemble& data) {
  const auto disagrees = [&](const Matrix& e) { return e.rows() != data.experiments() || e.cols() != data.outputs(); };
  if (static_cast<Index>(innovations.size()) != data.steps() ||
      std::any_of(innovations.begin(), innovations.end(), disagrees))
    throw std::invalid_argument(fmt::format("innovations: {} steps of {} x {} found, {} of {} x {} needed",
                                            innovations.size(), innovations.empty() ? 0 : innovations.front().rows(),
                                            innovations.empty() ? 0 : innovations.front().cols(), data.steps(),
                                            data.experiments(), data.outputs()));
}

Index too_few(const std::vector<Matrix>& innovations) {
  return innovations.empty() ? 0 : innovations.front().cols() + 2;
}

Matrix unit_columns(Matrix samples) {
  for (auto column : samples.colwise()) {
    const double size = column.norm();
    column.array() -= column.mean();
    // A constant column leaves only rounding errors. Their direction has no meaning, so the column becomes zero.
    if (!(column.norm() > 1e-13 * size)) column.setZero();
    if (const double norm = column.norm(); norm > 0) column /= norm;
  }
  return samples;
}

void fill_missing_inputs(Matrix& u) {
  for (auto column : u.colwise()) {
    double sum = 0.0;
    Index count = 0;
    for (const double value : column)
      if (!std::isnan(value)) sum += value, ++count;
    const double mean = count > 0 ? sum / double(count) : 0.0;
    for (double& value : column)
      if (std::isnan(value)) value = mean;
  }
}

}  // namespace tokid
