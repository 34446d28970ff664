// SPDX-License-Identifier: BSD-3-Clause
#include "call.hpp"

namespace tokid::python {

template <class Ask>
void Call::ask(Ask&& python) {
  next_ = Clock::now() + interval;
  const nb::gil_scoped_acquire acquire;
  if (why_) throw Stopped();
  try {
    // Python handles signals only in its main thread; in other threads this call does nothing.
    if (PyErr_CheckSignals() != 0) throw nb::python_error();
    python();
  } catch (const nb::python_error&) {
    why_ = std::current_exception();
    throw Stopped();
  }
}

void Call::report(double share) {
  if (Clock::now() < next_.load() && share < 1.0) return;
  ask([&] {
    if (!listener_.is_none()) listener_(share);
  });
}

void Call::poll() {
  if (Clock::now() >= next_.load()) ask([] {});
}

}  // namespace tokid::python
