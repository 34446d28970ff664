// The time of each stage, from the file to the model and on to its use, at both ends: few experiments of a small system
// over many steps, and many experiments of a large one.
// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

#include "ensembles.hpp"
#include "program.hpp"
#include "tokid/tokid.hpp"

namespace {

using namespace tokid;
using namespace tokid::bench;
namespace fs = std::filesystem;

struct End {
  std::string name;
  testing::SystemSize size;
  Index experiments, steps, lags;
  Index columns;  // block columns of H_k
  bool noise;
};

// What every stage hands to the next, made once.
struct Results {
  explicit Results(const End& e)
      : folder(fs::temp_directory_path() / fmt::format("tokid-stages-{}-{}", getpid(), e.name)),
        data(e.noise ? noisy(e.size, e.experiments, e.steps) : example(e.experiments, e.steps)),
        tvera_options{.rows = e.lags + 1, .cols = e.columns, .states = e.size.n},
        subspace_options{.states = e.size.n, .noisy = e.noise} {
    arx = gtv_arx(data, {.lags = {e.lags}});
    parameters = markov(arx, tvera_options.rows + tvera_options.cols - 1);
    hankel = hankel_factors(parameters, {}, tvera_options);
    predictor = predictor_factors(data, arx, subspace_options);
    model = realise(parameters, hankel, tvera_options);
    fs::create_directories(folder);
    save_ensemble(data, data_file(".npz"));
    save_ensemble(data, data_file(".h5"));
  }
  ~Results() { fs::remove_all(folder); }
  Results(const Results&) = delete;
  Results& operator=(const Results&) = delete;

  fs::path data_file(const std::string& extension) const { return folder / ("data" + extension); }

  fs::path folder;  // each end its own
  Ensemble data;
  TveraOptions tvera_options;
  SubspaceOptions subspace_options;
  GtvArx arx;
  Markov parameters;
  HankelFactors hankel;
  PredictorFactors predictor;
  Model model;
};

using Stage = std::function<void(const End&, Results&, int threads)>;

template <class Options>
Options threaded(Options options, int threads) {
  options.execution.threads = threads;
  return options;
}

// All choices made: what is left is the way from the data to one model.
IdentifyOptions identify_options(const End& e, Method method, int threads) {
  IdentifyOptions o{.states = e.size.n,
                    .lags = e.lags,
                    .method = method,
                    .refine = false,
                    .cols = e.columns,
                    .execution = {threads, {}}};
  if (e.noise && method == Method::subspace) o.choices = NoisyChoices{};
  return o;
}

template <class Value>
void keep(Value&& value) {
  benchmark::DoNotOptimize(value);
}

// In the order in which they follow each other.
const std::vector<std::pair<std::string, Stage>> stages = {
    {"load_npz", [](const End&, Results& r, int) { keep(load_ensemble(r.data_file(".npz"))); }},
    {"load_h5", [](const End&, Results& r, int) { keep(load_ensemble(r.data_file(".h5"))); }},
    {"fingerprint", [](const End&, Results& r, int) { keep(fingerprint(r.data)); }},
    {"test_nominal", [](const End&, Results& r, int) { keep(test_nominal(r.data)); }},
    {"lag_order_errors",
     [](const End& e, Results& r, int threads) {
       keep(lag_order_errors(r.data, {.p_max = e.lags, .steps = 8, .execution = {threads, {}}}));
     }},
    {"gtv_arx",
     [](const End& e, Results& r, int threads) {
       keep(gtv_arx(r.data, {.lags = {e.lags}, .execution = {threads, {}}}));
     }},
    {"markov",
     [](const End&, Results& r, int threads) {
       keep(markov(r.arx, r.parameters.band, {threads, {}}));
     }},
    {"hankel_factors", [](const End&, Results& r,
                          int threads) { keep(hankel_factors(r.parameters, {}, threaded(r.tvera_options, threads))); }},
    {"tvera_realise", [](const End&, Results& r,
                         int threads) { keep(realise(r.parameters, r.hankel, threaded(r.tvera_options, threads))); }},
    {"predictor_factors",
     [](const End&, Results& r, int threads) {
       keep(predictor_factors(r.data, r.arx, threaded(r.subspace_options, threads)));
     }},
    {"subspace_realise",
     [](const End&, Results& r, int threads) {
       keep(realise(r.data, r.arx, r.predictor, threaded(r.subspace_options, threads)));
     }},
    {"simulate", [](const End&, Results& r, int) { keep(simulate(r.model, r.data)); }},
    {"predict", [](const End&, Results& r, int) { keep(predict(r.model, r.data)); }},
    {"validate", [](const End&, Results& r, int) { keep(validate(r.model, r.data)); }},
    {"save_npz", [](const End&, Results& r, int) { save_model(r.model, r.folder / "model.npz"); }},
    {"identify_tvera", [](const End& e, Results& r,
                          int threads) { keep(identify(r.data, identify_options(e, Method::tvera, threads))); }},
    {"identify_subspace", [](const End& e, Results& r,
                             int threads) { keep(identify(r.data, identify_options(e, Method::subspace, threads))); }},
};

void add_all(bool quick) {
  const std::vector<End> ends =
      quick ? std::vector<End>{{"small", {4, 2, 2}, 50, 200, 2, 4, false}, {"large", {8, 4, 4}, 200, 40, 4, 12, true}}
            : std::vector<End>{{"small", {4, 2, 2}, 50, 3200, 2, 4, false},
                               {"large", {16, 8, 8}, 4000, 40, 16, 48, true}};
  for (const End& end : ends) {
    const auto results = std::make_shared<std::unique_ptr<Results>>();
    for (const auto& [name, stage] : stages)
      for (const int threads : {1, 2})
        benchmark::RegisterBenchmark(fmt::format("{}/{}/threads:{}", end.name, name, threads).c_str(),
                                     [end, results, stage = stage, threads](benchmark::State& state) {
                                       if (!*results) *results = std::make_unique<Results>(end);
                                       for ([[maybe_unused]] auto _ : state) stage(end, **results, threads);
                                       state.SetItemsProcessed(state.iterations() * end.steps);
                                     })
            ->Unit(benchmark::kMillisecond)
            ->UseRealTime();
  }
}

}  // namespace

int main(int argc, char** argv) { return tokid::bench::program(argc, argv, add_all); }
