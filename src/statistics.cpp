// SPDX-License-Identifier: BSD-3-Clause
#include "statistics.hpp"

#include <boost/math/distributions/fisher_f.hpp>
#include <cmath>
#include <numbers>

namespace tokid::statistics {

double f_quantile(double probability, double a, double b) {
  return boost::math::quantile(boost::math::fisher_f(a, b), probability);
}

double normal_tail(double z) { return 0.5 * std::erfc(z / std::numbers::sqrt2); }

}  // namespace tokid::statistics
