// Quantiles and tail probabilities of the tests that tokid reports.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

namespace tokid::statistics {

double median(std::vector<double> values);  // NaN for an empty list; of an even number of values, the upper middle one

// q with P(F ≤ q) = probability for F distributed with (a, b) degrees of freedom
double f_quantile(double probability, double a, double b);

// t with P(T ≤ t) = probability for Student's t
double student_quantile(double probability, double freedom);

// Twice the smaller of P(X ≤ x) and P(X ≥ x) for χ² with the given degrees of freedom
double chi_square_two_sided(double x, double freedom);

// P(|T| ≥ |t|) for Student's t
double student_two_sided(double t, double freedom);

// Mean, variance and third central moment. For a sum of independent terms, each cumulant is the sum of the cumulants of
// the terms.
struct Cumulants {
  double mean = 0.0, variance = 0.0, third = 0.0;

  Cumulants& operator+=(const Cumulants& other) {
    mean += other.mean, variance += other.variance, third += other.third;
    return *this;
  }
};

// P(X ≥ x) of the gamma distribution with these cumulants, shifted and reflected where necessary (Pearson's type III);
// NaN if the variance is zero.
double upper_tail(const Cumulants& cumulants, double x);

// Cumulants of tr(P M). P projects ℝ^size onto a uniformly random subspace of dimension `rank`. M is symmetric, and t1,
// t2, t3 are the traces of M, M², M³. If M is also a projection, tr(P M) is Pillai's trace of two sets of variables, at
// least one of which is normal. Needs 1 ≤ rank ≤ size and size ≥ 3.
Cumulants projected_trace(double rank, double size, double t1, double t2, double t3);

}  // namespace tokid::statistics
