// How far the results of every stage are from those of 50 digits, over random cases, in units of what the stage itself
// makes of rounding errors: the bounds of docs/math.md.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace tokid::testing {

// Of the ratio, for every stage and route.
inline constexpr double accuracy_bound = 10.0;

struct Accuracy {
  std::string stage, route;
  double condition = 1.0;  // of the windows, of the Hankel matrices; 1 where there are none
  bool noisy = false;      // residuals beyond rounding errors
  double error = 0.0;      // of the result, relative
  double growth = 1.0;     // condition × growth: what that may be in units of ε, to first order
  double ratio = 0.0;      // error / (ε × condition × growth); each the largest where a case has many results
};

// What a study found, and how many of the problems that it set itself it judged. Left out is what is above a condition
// of 1e12 by 50 digits; a rank that is wrong below that is an infinite error.
struct AccuracyFindings {
  std::vector<Accuracy> all;
  int judged = 0, left_out = 0;
};

// One kind of stages over so many random cases.
struct AccuracyStudy {
  const char* name;
  AccuracyFindings (*run)(int cases);
  int cases;      // of the test
  double judged;  // least share of the problems
};
const std::vector<AccuracyStudy>& accuracy_studies();

}  // namespace tokid::testing
