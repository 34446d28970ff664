// SPDX-License-Identifier: BSD-3-Clause
#include "call.hpp"

namespace tokid::python {

void Call::report(const ProgressReport& now) {
  {
    const std::lock_guard lock(mutex_);
    last_ = now;
    fresh_ = true;
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
  ProgressReport now;
  {
    const std::lock_guard lock(mutex_);
    now = last_;
    fresh_ = false;
  }
  told_ = Clock::now();
  listener_(now.share, now.stage);  // after an exception, ask() calls it no more
  telling_ = false;
}

}  // namespace tokid::python
