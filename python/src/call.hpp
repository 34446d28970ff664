// Runs long calls of the library without the GIL, with progress, and so that Ctrl-C stops them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <atomic>
#include <chrono>
#include <exception>
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
    return {threads, [this](double share) { report(share); }};
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
  static constexpr std::chrono::milliseconds interval{50};

  void report(double share);
  void poll();  // notices Ctrl-C in computations that report no progress
  template <class Ask>
  void ask(Ask&& python);

  nb::object listener_;  // called with the finished share of the work; or None
  std::atomic<Clock::time_point> next_;
  std::exception_ptr why_;
};

// Runs work() like Call::run(), without progress.
template <class Work>
auto without_gil(Work&& work) {
  return Call(nb::none()).run(std::forward<Work>(work));
}

}  // namespace tokid::python
