// The time of what a model is used for: a step of the online observer, and controllers.
// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/control.hpp"
#include "program.hpp"
#include "testing.hpp"
#include "tokid/online_observer.hpp"

namespace {

using namespace tokid;

Model model_of(const testing::SystemSize& size, Index steps, bool noise) {
  testing::Random random(1);
  Model model = testing::random_system(size, steps, 0.9, 1);
  for (Step& step : model.step) {
    step.G() = 0.1 * random.matrix(size.n, size.m);
    step.set_innovation_cov(Matrix::Identity(size.m, size.m));
    if (!noise) continue;
    step.set_Q(Matrix::Identity(size.n, size.n));
    step.set_R(Matrix::Identity(size.m, size.m));
  }
  model.period = steps;  // the observer goes on
  return model;
}

// One call of step() with samples that are all present.
void observer_step(benchmark::State& state, const testing::SystemSize& size, bool filter) {
  testing::Random random(2);
  OnlineObserver observer(model_of(size, 1000, filter), {.samples_missing = filter});
  const Vector u = random.matrix(size.r, 1), y = random.matrix(size.m, 1);
  for (auto _ : state) benchmark::DoNotOptimize(observer.step(u, y));
}

// The gains of all steps, with weights on outputs and inputs, and on input rates.
void lqr_of(benchmark::State& state, const testing::SystemSize& size, Index steps, bool rate) {
  const Model model = model_of(size, steps, false);
  CostWeights weights{.output = {Matrix::Identity(size.m, size.m)}, .input = {Matrix::Identity(size.r, size.r)}};
  if (rate) weights.input_rate = weights.input;
  for (auto _ : state) benchmark::DoNotOptimize(lqr(model, weights));
}

void add(bool quick) {
  std::vector<testing::SystemSize> sizes{{4, 2, 2}};
  if (!quick) sizes.insert(sizes.end(), {{2, 1, 1}, {10, 4, 4}, {20, 6, 6}});
  for (const testing::SystemSize& size : sizes)
    for (const bool filter : {false, true})
      benchmark::RegisterBenchmark(
          fmt::format("{} n={} m={} r={}", filter ? "filter_step" : "observer_step", size.n, size.m, size.r).c_str(),
          [size, filter](benchmark::State& state) { observer_step(state, size, filter); });
  const Index steps = quick ? 100 : 10000;
  for (const testing::SystemSize& size : sizes)
    for (const bool rate : {false, true})
      benchmark::RegisterBenchmark(
          fmt::format("{} n={} m={} r={} T={}", rate ? "lqr_with_rate" : "lqr", size.n, size.m, size.r, steps).c_str(),
          [size, rate, steps](benchmark::State& state) { lqr_of(state, size, steps, rate); })
          ->Unit(benchmark::kMillisecond);
}

}  // namespace

int main(int argc, char** argv) { return tokid::bench::program(argc, argv, add); }
