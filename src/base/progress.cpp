// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/progress.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/nan.hpp"

namespace tokid {

namespace {

// [s] No time left is told before `soon`. A new estimate replaces the old one with this time constant.
constexpr double soon = 0.5, smoothing = 0.7;

double seconds(TimeLeft::Clock::duration time) { return std::chrono::duration<double>(time).count(); }

}  // namespace

double TimeLeft::after(const ProgressReport& report, Clock::time_point now) {
  const double elapsed = seconds(now - begin_), passed = seconds(now - std::exchange(last_, now));
  const double share = std::clamp(report.share, 0.0, 1.0);
  const double estimate =
      std::isnan(report.seconds_left) ? elapsed * (1 - share) / share : std::max(0.0, report.seconds_left);
  if (report.open || elapsed < soon || !std::isfinite(estimate)) return left_ = nan;
  const double expected = std::max(0.0, left_ - passed);
  left_ = std::isnan(left_) ? estimate : expected + (1 - std::exp(-passed / smoothing)) * (estimate - expected);
  return left_;
}

}  // namespace tokid
