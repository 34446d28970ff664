// SPDX-License-Identifier: BSD-3-Clause
#include "call.hpp"

#include <cmath>

namespace tokid::python {

void Call::report(const ProgressReport& now) {
  {
    const std::lock_guard lock(mutex_);
    last_ = now;
    fresh_ = true;
    reported_ = Clock::now();
  }
  if (Clock::now() < next_.load() && now.share < 1.0) return;
  ask([this] { tell(); });
}

void Call::poll() {
  if (Clock::now() < next_.load()) return;
  ask([this] {
    if (fresh_ || Clock::now() - told_ >= silence) tell();
  });
}

void Call::tell() {
  // Python releases the GIL while the listener runs. Another thread could otherwise call it then.
  if (listener_.is_none() || telling_) return;
  telling_ = true;
  const ScopeExit end([this] { telling_ = false; });
  ProgressReport now;
  {
    const std::lock_guard lock(mutex_);
    now = last_;
    fresh_ = false;
    now.seconds_left -= std::chrono::duration<double>(Clock::now() - reported_).count();
  }
  told_ = Clock::now();
  const double left = now.share < 1.0 ? time_left_.after(now) : 0.0;
  listener_(now.share, now.stage, std::isnan(left) ? nb::none() : nb::object(nb::float_(left)));
}

}  // namespace tokid::python
