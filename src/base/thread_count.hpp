// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <thread>

#include "tokid/parallel.hpp"

namespace tokid {

// Threads that an Execution asks for, where 0 stands for as many as the machine has.
inline Index thread_count(const Execution& execution) {
  return execution.threads > 0 ? execution.threads : std::max(1, int(std::thread::hardware_concurrency()));
}

}  // namespace tokid
