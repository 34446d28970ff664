// Quantiles and tail probabilities of the tests that tokid reports.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace tokid::statistics {

// q with P(F ≤ q) = probability for F distributed with (a, b) degrees of freedom
double f_quantile(double probability, double a, double b);

// P(Z > z) of the standard normal distribution
double normal_tail(double z);

}  // namespace tokid::statistics
