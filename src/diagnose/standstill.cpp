// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/standstill.hpp"

#include <algorithm>
#include <cmath>

namespace tokid {

namespace {

// A standstill is reported only if it has this number of steps, this multiple of the median length, and this share of
// the record.
constexpr double fewest_steps = 8, times_usual = 3, least_share = 0.1;
// A standstill is not reported if its probability by chance is larger.
constexpr double chance_of_standstill = 1e-3;

struct Course {
  Standstill longest;
  Index held = 0, steps = 0;  // steps with the value of the step before; all steps with a value before
};

}  // namespace

std::vector<Standstill> standstills(const Ensemble& e, Index c) {
  const Index d = e.channels(), count = e.experiments();
  std::vector<Course> courses(static_cast<size_t>(count));
  std::vector<Standstill> now(static_cast<size_t>(count));
  for (Index n = 0; n < count; ++n) courses[size_t(n)].longest.experiment = now[size_t(n)].experiment = n;
  // The loop follows the steps, as the samples lie in memory. For an output, only the part of a run from the first to
  // the last movement of the inputs counts.
  const auto moves = [&](Index n, Index k) {
    for (Index i = 0; i < e.inputs(); ++i)
      if (e.u(n, k, i) != e.u(n, k - 1, i) && !std::isnan(e.u(n, k, i)) && !std::isnan(e.u(n, k - 1, i))) return true;
    return false;
  };
  std::vector<char> moved(size_t(count), 0);
  for (Index k = 1; k < e.steps(); ++k)
    for (Index n = 0; n < count; ++n) {
      const double before = e.samples()(n, (k - 1) * d + c), value = e.samples()(n, k * d + c);
      Standstill& run = now[size_t(n)];
      Course& course = courses[size_t(n)];
      if (!(value == before)) {
        // Before its first change a channel is at its initial value, which is no standstill.
        moved[size_t(n)] = char(moved[size_t(n)] || (value != before && !std::isnan(value) && !std::isnan(before)));
        run.begin = run.end = k;
        course.steps += !std::isnan(value) && !std::isnan(before);
        continue;
      }
      ++course.steps;
      ++course.held;
      if (!moved[size_t(n)]) continue;
      if (c < e.inputs() || moves(n, k)) {
        if (run.end == run.begin && c >= e.inputs() && run.begin + 1 < k) run.begin = k - 1;
        run.end = k + 1;
      }
      if (run.end - run.begin > course.longest.end - course.longest.begin) {
        course.longest = run;
        course.longest.value = value + 0.0;  // no negative zero
      }
    }
  std::vector<double> length;
  Index held = 0, steps = 0;
  for (const Course& course : courses) {
    length.push_back(double(std::max<Index>(1, course.longest.end - course.longest.begin)));
    held += course.held;
    steps += course.steps;
  }
  if (count < 2) return {};
  // For an experiment with a longer standstill, this is the median over the other experiments.
  const auto middle = length.begin() + (count - 1) / 2;
  std::nth_element(length.begin(), middle, length.end());
  const double least = std::max(fewest_steps, least_share * double(e.steps()));
  std::vector<Standstill> result;
  for (const Course& course : courses) {
    const double own = double(course.longest.end - course.longest.begin);
    if (own < least || own < times_usual * *middle) continue;
    // Outputs with coarse resolution may stay constant without a fault, in this experiment or in the others.
    const auto share = [](Index part, Index all) { return all > 0 ? double(part) / double(all) : 0.0; };
    const Index run = Index(own) - 1;
    const double usual =
        std::max(share(held - course.held, steps - course.steps), share(course.held - run, course.steps - run));
    if (std::pow(usual, double(run)) * double(steps) > chance_of_standstill) continue;
    result.push_back(course.longest);
  }
  return result;
}

}  // namespace tokid
