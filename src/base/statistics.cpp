// SPDX-License-Identifier: BSD-3-Clause
#include "base/statistics.hpp"

#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <boost/math/special_functions/gamma.hpp>
#include <cmath>
#include <limits>
#include <numbers>

namespace tokid::statistics {

namespace {

double normal_tail(double z) { return 0.5 * std::erfc(z / std::numbers::sqrt2); }

}  // namespace

double median(std::vector<double> values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

double f_quantile(double probability, double a, double b) {
  return boost::math::quantile(boost::math::fisher_f(a, b), probability);
}

double student_quantile(double probability, double freedom) {
  return boost::math::quantile(boost::math::students_t(freedom), probability);
}

double chi_square_two_sided(double x, double freedom) {
  if (std::isinf(x)) return 0.0;
  const boost::math::chi_squared distribution(freedom);
  return std::min(1.0, 2 * std::min(cdf(distribution, x), cdf(complement(distribution, x))));
}

double student_two_sided(double t, double freedom) {
  return std::min(1.0, 2 * cdf(complement(boost::math::students_t(freedom), std::abs(t))));
}

double upper_tail(const Cumulants& c, double x) {
  if (!(c.variance > 0)) return std::numeric_limits<double>::quiet_NaN();
  const double deviation = std::sqrt(c.variance), z = (x - c.mean) / deviation;
  const double skewness = c.third / (c.variance * deviation);
  // With so little skewness, the normal distribution is accurate enough.
  if (std::abs(skewness) < 1e-4) return normal_tail(z);
  const double shape = 4 / (skewness * skewness);
  const double y = std::max(0.0, shape + (skewness > 0 ? z : -z) * std::sqrt(shape));
  return skewness > 0 ? boost::math::gamma_q(shape, y) : boost::math::gamma_p(shape, y);
}

// The zonal polynomials C_κ of weight two and three have the mean E C_κ(P M) = C_κ(M) C_κ(I_rank) / C_κ(I_size).
// `second` and `third` are the traces of the square and cube of M minus its mean eigenvalue.
Cumulants projected_trace(double rank, double size, double t1, double t2, double t3) {
  const double second = t2 - t1 * t1 / size;
  const double third = t3 - 3 * t1 * t2 / size + 2 * t1 * t1 * t1 / (size * size);
  const double single = rank / size, above = (rank + 2) / (size + 2), below = (rank - 1) / (size - 1);
  const double far_above = (rank + 4) / (size + 4), far_below = (rank - 2) / (size - 2);
  return {single * t1, 2.0 / 3 * single * (above - below) * second,
          single * (8.0 / 15 * above * far_above - 6.0 / 5 * above * below + 2.0 / 3 * below * far_below) * third};
}

}  // namespace tokid::statistics
