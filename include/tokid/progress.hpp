// The progress of long calls: what tokid reports while it works.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>

namespace tokid {

struct ProgressReport {
  double share = 0.0;      // finished share of the whole work, 0 … 1. It never decreases, and it ends at 1
  std::string stage = {};  // what tokid does now, such as "choosing lags and lambda"; empty for work of one stage
};
// tokid calls it from one thread at a time. An exception that it throws cancels the call, whose caller receives the
// exception. It must not be a std::exception, because some stages catch every std::exception. Interruptible of
// parallel.hpp also cancels calls that report no progress.
using Progress = std::function<void(const ProgressReport&)>;

}  // namespace tokid
