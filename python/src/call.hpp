// Long calls: without the GIL, with progress, and stopped by Ctrl-C.
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

// What stops a computation from within its progress callback. No std::exception, so that no part of the library takes
// it for one of the failures that it can go on without.
struct Stopped {};

// The progress of one call. It may be reported from any thread of the library; Python is asked 20 times a second at
// most.
class Call {
 public:
  explicit Call(nb::object listener) : listener_(std::move(listener)), next_(Clock::now() + interval) {}
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;

  Execution execution(int threads) {
    return {threads, [this](double share) { report(share); }};
  }

  // work() without the GIL; what a signal handler or the listener has raised is raised here.
  template <class Work>
  auto run(Work&& work) {
    try {
      const nb::gil_scoped_release release;
      const Interruptible here([this] { poll(); });
      return work();
    } catch (const Stopped&) {
      // handled behind the block, with the GIL held again
    }
    std::exception_ptr why = std::exchange(why_, nullptr);
    std::rethrow_exception(std::move(why));
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds interval{50};

  void report(double share);
  void poll();  // for Ctrl-C where nothing is reported
  template <class Ask>
  void ask(Ask&& python);

  nb::object listener_;  // called with the share, or None
  std::atomic<Clock::time_point> next_;
  std::exception_ptr why_;
};

// The same without progress.
template <class Work>
auto without_gil(Work&& work) {
  return Call(nb::none()).run(std::forward<Work>(work));
}

}  // namespace tokid::python
