// Time of the least-squares stage and of a whole identification, over two decades of steps and of experiments.
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <memory>
#include <string>

#include "ensembles.hpp"
#include "program.hpp"
#include "tokid/identify.hpp"

namespace {

using namespace tokid;
using namespace tokid::bench;

// Half decades from `first` over two decades.
std::vector<Index> decades(Index first) {
  std::vector<Index> sizes;
  for (int i = 0; i <= 4; ++i) sizes.push_back(Index(std::lround(double(first) * std::pow(10.0, double(i) / 2))));
  return sizes;
}

void add(const std::string& name, Index experiments_count, Index steps) {
  const auto data = std::make_shared<Ensemble>();
  const auto prepare = [=] {
    if (data->steps() == 0) *data = example(experiments_count, steps);
  };
  const auto finish = [=](benchmark::State& state) {
    state.counters["steps"] = double(steps);
    state.counters["experiments"] = double(experiments_count);
  };
  benchmark::RegisterBenchmark((name + "/gtv_arx").c_str(),
                               [=](benchmark::State& state) {
                                 prepare();
                                 for ([[maybe_unused]] auto _ : state)
                                   benchmark::DoNotOptimize(gtv_arx(*data, {.lags = {2}}));
                                 finish(state);
                               })
      ->Unit(benchmark::kMillisecond)
      ->UseRealTime();
  benchmark::RegisterBenchmark((name + "/identify").c_str(),
                               [=](benchmark::State& state) {
                                 prepare();
                                 for ([[maybe_unused]] auto _ : state) benchmark::DoNotOptimize(identify(*data));
                                 finish(state);
                               })
      ->Unit(benchmark::kMillisecond)
      ->UseRealTime();
}

void add_all(bool quick) {
  for (const Index steps : decades(quick ? 20 : 1000)) add(fmt::format("steps:{}", steps), 50, steps);
  for (const Index count : decades(quick ? 20 : 50)) add(fmt::format("experiments:{}", count), count, quick ? 20 : 200);
}

}  // namespace

int main(int argc, char** argv) { return tokid::bench::program(argc, argv, add_all); }
