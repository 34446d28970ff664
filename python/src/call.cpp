// SPDX-License-Identifier: BSD-3-Clause
#include "call.hpp"

namespace tokid::python {

void Call::report(double share) {
  const Clock::time_point now = Clock::now();
  if (now < next_.load() && share < 1.0) return;
  next_ = now + std::chrono::milliseconds(50);
  nb::gil_scoped_acquire acquire;
  if (why_) throw Stopped();
  try {
    // Signals are Python's main thread's business: elsewhere this does nothing.
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    if (!listener_.is_none()) listener_(share);
  } catch (const nb::python_error&) {
    why_ = std::current_exception();
    throw Stopped();
  }
}

}  // namespace tokid::python
