// The least-squares stage beside loops over the steps with Eigen and with LAPACK, and beside the rate of dgemm.
// SPDX-License-Identifier: BSD-3-Clause
#include <cblas.h>

#include <map>
#include <memory>
#include <string>

#include "ensembles.hpp"
#include "loops.hpp"
#include "program.hpp"
#include "tokid/gtv_arx.hpp"

namespace {

using namespace tokid;
using namespace tokid::bench;

struct Case {
  std::string name;
  testing::SystemSize size;
  Index experiments, steps, lags;
  Index looped;  // steps that the loops go through: their time does not depend on which
  Ensemble (*make)(const Case&);

  Index regressors() const { return minimum_experiments(size.r, size.m, lags); }  // L
  double naive_flops() const {                                                    // 2 N (L+m)² per step
    const double width = double(regressors() + size.m);
    return 2 * double(experiments) * width * width;
  }
};

Ensemble make_example(const Case& c) { return example(c.experiments, c.steps); }
Ensemble make_noisy(const Case& c) { return noisy(c.size, c.experiments, c.steps); }

GtvArx regressions(const Case& c, const Ensemble& data, int threads) {
  // Steps with a whole window only, so that all of them cost the same.
  return gtv_arx(
      data,
      {.lags = {c.lags}, .initial_state = InitialState::unknown, .noise_shape = false, .execution = {threads, {}}});
}

void run_loop(Loop* loop, const Case& c, const Ensemble& data, Index begin, Index end, double* results) {
  loop({data.samples().data(), c.experiments, c.size.r, c.size.m, c.lags}, begin, end, results);
}

// All competitors solve the same problem: coefficients and residuals of the first and the last step with a whole
// window.
std::string disagreement(const Case& c, const Ensemble& data) {
  const Index first = (c.steps - c.lags) / 2;
  const Ensemble piece = stretch(data, first, first + c.lags + 2);
  const GtvArx arx = regressions(c, piece, 1);
  const Index rows = c.regressors() + 1, m = c.size.m, steps = piece.steps() - c.lags;
  Matrix results(rows, m * steps);
  for (Loop* loop : {eigen_loop, eigen_native_loop, dgels_loop}) {
    run_loop(loop, c, piece, c.lags, piece.steps(), results.data());
    for (Index s = 0; s < steps; ++s) {
      const GtvArxStep& own = arx.step[size_t(c.lags + s)];
      const GtvArx::View coefficients = arx.coefficients(c.lags + s);
      const Matrix difference = results.middleCols(s * m, m).topRows(rows - 1) - coefficients.transpose();
      const double tolerance = 1e-12 * own.condition;
      if (own.rank != rows - 1 || !(difference.norm() <= tolerance * coefficients.norm()))
        return fmt::format("step {}: rank {} of {}, coefficients differ by {:.1e}, {:.1e} allowed", c.lags + s,
                           own.rank, rows - 1, difference.norm() / coefficients.norm(), tolerance);
    }
  }
  return {};
}

// Made once, by the first that needs it.
const Ensemble& data_of(const Case& c, std::string& error) {
  struct Entry {
    Ensemble data;
    std::string error;
  };
  static std::map<std::string, Entry> made;
  auto [entry, added] = made.try_emplace(c.name);
  if (added) {
    entry->second.data = c.make(c);
    entry->second.error = disagreement(c, entry->second.data);
  }
  error = entry->second.error;
  return entry->second.data;
}

void count(benchmark::State& state, const Case& c, Index steps) {
  state.SetItemsProcessed(state.iterations() * steps);
  state.counters["naive_flops"] =
      benchmark::Counter(c.naive_flops() * double(steps), benchmark::Counter::kIsIterationInvariantRate);
  state.counters["naive_flops_per_step"] = c.naive_flops();
}

void run_tokid(benchmark::State& state, const Case& c, int threads) {
  std::string error;
  const Ensemble& data = data_of(c, error);
  if (!error.empty()) return state.SkipWithError(error.c_str());
  for ([[maybe_unused]] auto _ : state) benchmark::DoNotOptimize(regressions(c, data, threads));
  count(state, c, c.steps - c.lags);
}

void run_competitor(benchmark::State& state, const Case& c, Loop* loop, int threads) {
  std::string error;
  const Ensemble& data = data_of(c, error);
  if (!error.empty()) return state.SkipWithError(error.c_str());
  // From rest, the first windows have no full rank.
  const Index begin = c.lags + c.size.n, end = std::min(c.steps, begin + c.looped);
  const Index size = (c.regressors() + 1) * c.size.m;
  std::vector<double> results(size_t((end - begin) * size));
  for ([[maybe_unused]] auto _ : state) {
    parallel_for(begin, end, {threads, {}}, [&](Index from, Index to) {
      run_loop(loop, c, data, from, to, results.data() + (from - begin) * size);
    });
    benchmark::ClobberMemory();
  }
  count(state, c, end - begin);
}

// Each thread multiplies its own matrices.
void run_dgemm(benchmark::State& state, Index n, int threads) {
  testing::Random random(1);
  const Matrix a = random.matrix(n, n), b = random.matrix(n, n);
  std::vector<Matrix> products(size_t(threads), Matrix::Zero(n, n));
  for ([[maybe_unused]] auto _ : state) {
    parallel_for(0, threads, {threads, {}}, [&](Index from, Index to) {
      for (Index i = from; i < to; ++i)
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, int(n), int(n), int(n), 1.0, a.data(), int(n), b.data(),
                    int(n), 0.0, products[size_t(i)].data(), int(n));
    });
    benchmark::ClobberMemory();
  }
  state.counters["flops"] = benchmark::Counter(2.0 * double(n) * double(n) * double(n) * threads,
                                               benchmark::Counter::kIsIterationInvariantRate);
}

template <class Run>
void add(const std::string& name, int threads, Run&& run) {
  benchmark::RegisterBenchmark(fmt::format("{}/threads:{}", name, threads).c_str(), run)
      ->Unit(benchmark::kMillisecond)
      ->UseRealTime();
}

void add_all(bool quick) {
  benchmark::AddCustomContext("openblas", openblas_get_config());
  benchmark::AddCustomContext("openblas_core", openblas_get_corename());
  const std::vector<Case> cases = quick ? std::vector<Case>{{"large", {16, 8, 8}, 600, 40, 16, 1, make_noisy},
                                                            {"small", {4, 2, 2}, 50, 500, 2, 100, make_example},
                                                            {"middle", {8, 4, 4}, 200, 40, 8, 4, make_noisy}}
                                        : std::vector<Case>{{"large", {16, 8, 8}, 4000, 200, 16, 8, make_noisy},
                                                            {"small", {4, 2, 2}, 50, 100'000, 2, 10'000, make_example},
                                                            {"middle", {8, 4, 4}, 200, 1000, 8, 200, make_noisy}};
  const Index n = quick ? 300 : 1500;
  for (const int threads : {1, 2}) {
    add("dgemm", threads, [n, threads](benchmark::State& state) { run_dgemm(state, n, threads); });
    for (const Case& c : cases) {
      add(c.name + "/tokid", threads, [c, threads](benchmark::State& state) { run_tokid(state, c, threads); });
      for (const auto& [name, loop] : {std::pair<const char*, Loop*>{"eigen", eigen_loop},
                                       {"eigen_native", eigen_native_loop},
                                       {"dgels", dgels_loop}})
        add(c.name + "/" + name, threads,
            [c, loop = loop, threads](benchmark::State& state) { run_competitor(state, c, loop, threads); });
    }
  }
}

}  // namespace

int main(int argc, char** argv) { return tokid::bench::program(argc, argv, add_all); }
