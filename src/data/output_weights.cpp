// SPDX-License-Identifier: BSD-3-Clause
#include "data/output_weights.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <functional>
#include <stdexcept>

namespace tokid {

namespace {

void check_count(Index found, Index outputs) {
  if (found != 0 && found != outputs)
    throw std::invalid_argument(
        fmt::format("output_weights: {} found, {} needed, one for each output", found, outputs));
}

}  // namespace

Vector relative_weights(const std::vector<double>& stated, Index outputs) {
  check_count(Index(stated.size()), outputs);
  const bool alike = std::adjacent_find(stated.begin(), stated.end(), std::not_equal_to<>()) == stated.end();
  if (alike) return {};
  const Eigen::Map<const Vector> weights(stated.data(), Index(stated.size()));
  return weights / weights.maxCoeff();
}

Vector weights_of(const Vector& weights, Index outputs) {
  check_count(weights.size(), outputs);
  return weights.size() == 0 ? Vector(Vector::Ones(outputs)) : weights;
}

Vector unit_factors(const Vector& weights, Index outputs) {
  return weights_of(weights, outputs).cwiseMax(least_weight).cwiseSqrt().cwiseInverse();
}

}  // namespace tokid
