// Runs long calls of the library without the GIL, with progress, and so that Ctrl-C stops them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <chrono>
#include <exception>
#include <mutex>
#include <optional>
#include <utility>

#include "python.hpp"
#include "tokid/parallel.hpp"

namespace tokid::python {

// An exception that stops a computation from within its progress callback. It is no std::exception, because the library
// catches some of these and continues.
struct Stopped {};

// The progress of one call. Any thread of the library may report it. Python is called at most 20 times a second.
class Call {
 public:
  explicit Call(nb::object listener) : listener_(std::move(listener)), next_(Clock::now() + interval) {}
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;

  Execution execution(int threads) {
    return {threads, [this](const ProgressReport& now) { report(now); }};
  }
  // Runs python() with the GIL. An exception that it or a signal handler raises stops the computation.
  template <class Ask>
  void ask(Ask&& python) {
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

  // Runs work() without the GIL. If a signal handler or the listener has raised an exception, it is raised here.
  template <class Work>
  auto run(Work&& work) {
    try {
      const nb::gil_scoped_release release;
      const Interruptible here([this] { poll(); });
      return work();
    } catch (const Stopped&) {
      // handled after this block, where the GIL is held again
    }
    std::exception_ptr why = std::exchange(why_, nullptr);
    std::rethrow_exception(std::move(why));
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds interval{50}, silence{500};

  void report(const ProgressReport& now);
  // Notices Ctrl-C in computations that report no progress. Passes on a report that came too soon after another, and
  // repeats the last one after a silence.
  void poll();
  void tell();

  nb::object listener_;  // called with the finished share and the stage; or None
  std::atomic<Clock::time_point> next_;
  std::atomic<bool> fresh_ = false;  // Python has not got the last report
  std::mutex mutex_;                 // of the next member
  ProgressReport last_;
  // Used with the GIL alone:
  bool telling_ = false;  // the listener runs
  Clock::time_point told_ = Clock::now();
  std::exception_ptr why_;
};

// Runs work() like Call::run(), without progress.
template <class Work>
auto without_gil(Work&& work) {
  return Call(nb::none()).run(std::forward<Work>(work));
}

}  // namespace tokid::python
