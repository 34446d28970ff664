// Elementary functions with the same last bits on all processors.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "tokid/linalg.hpp"

namespace tokid::linalg {

// The functions of the C library have other last bits on processors with fused operations. Eigen's vectors of two are
// computed with the instructions of the baseline.
inline double log(double x) {
  const Eigen::Array2d two = Eigen::Array2d::Constant(x), result = two.log();
  return result(0);
}

inline double exp(double x) {
  const Eigen::Array2d two = Eigen::Array2d::Constant(x), result = two.exp();
  return result(0);
}

}  // namespace tokid::linalg
