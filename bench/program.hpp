// What the Google Benchmark programs have in common: their own --quick, and what they were built with.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <benchmark/benchmark.h>
#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cstring>
#include <vector>

#include "tokid/version.hpp"

namespace tokid::bench {

// Runs what `add(quick)` registers; quick: small sizes, to see that all of it works.
template <class Register>
int program(int argc, char** argv, Register&& add) {
  std::vector<char*> arguments(argv, argv + argc);
  const auto asked = [](const char* argument) { return std::strcmp(argument, "--quick") == 0; };
  const bool quick = std::erase_if(arguments, asked) > 0;
  int count = int(arguments.size());
  benchmark::AddCustomContext("tokid", version);
#ifdef __clang__
  benchmark::AddCustomContext("compiler", __VERSION__);  // names itself
#else
  benchmark::AddCustomContext("compiler", "GCC " __VERSION__);
#endif
  benchmark::AddCustomContext("eigen",
                              fmt::format("{}.{}.{}", EIGEN_WORLD_VERSION, EIGEN_MAJOR_VERSION, EIGEN_MINOR_VERSION));
  add(quick);
  benchmark::Initialize(&count, arguments.data());
  if (benchmark::ReportUnrecognizedArguments(count, arguments.data())) return 1;
  benchmark::RunSpecifiedBenchmarks();
  benchmark::Shutdown();
  return 0;
}

}  // namespace tokid::bench
