// The progress of long calls: what tokid reports while it works, and the time left that follows from it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <functional>
#include <limits>
#include <string>

namespace tokid {

struct ProgressReport {
  double share = 0.0;  // finished share of the whole work, 0 … 1. It never decreases, and it ends at 1
  // What tokid does now, such as "choosing lags and lambda". Empty if the work has one stage only.
  std::string stage = {};
  double stage_share = std::numeric_limits<double>::quiet_NaN();  // finished share of this stage; NaN: not known
  bool open = false;  // the amount of work that follows is not known yet, because it depends on a decision
  // [s] Expected time until the end. NaN: no better one is known than from the share and the time so far.
  double seconds_left = std::numeric_limits<double>::quiet_NaN();
};
// tokid calls it from one thread at a time. An exception that it throws cancels the call, whose caller receives the
// exception. It must not be a std::exception, because some stages catch every std::exception. Interruptible of
// parallel.hpp also cancels calls that report no progress.
using Progress = std::function<void(const ProgressReport&)>;

// The time left, from the reports of one call, smoothed over about a second.
class TimeLeft {
 public:
  using Clock = std::chrono::steady_clock;

  explicit TimeLeft(Clock::time_point begin = Clock::now()) : begin_(begin), last_(begin) {}
  // [s] NaN: not known. It is not known in the first half second, and while the reports are open.
  double after(const ProgressReport& report, Clock::time_point now = Clock::now());

 private:
  Clock::time_point begin_, last_;
  double left_ = std::numeric_limits<double>::quiet_NaN();
};

}  // namespace tokid
