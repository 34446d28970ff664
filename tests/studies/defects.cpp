// How often a defect of one experiment, or of one sample, is named, how often healthy ones are, and what is left of the
// defect after the option `outliers`: the tables of docs/evidence.md.
// SPDX-License-Identifier: BSD-3-Clause
#include "studies/defects.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <cstring>

namespace {

using namespace tokid;
using namespace tokid::testing;

constexpr Index experiments = 60, steps = 80;

struct Row {
  int count = 0, right = 0, wrong = 0, dropped_right = 0;
  double worst_kept = 0.0, worst_dropped = 0.0, worst_downweighted = 0.0;
};

IdentifyOptions options_of(const NoisySystem& system, double hold_out) {
  IdentifyOptions options{.period = system.period};
  options.hold_out = hold_out;
  options.execution.threads = 0;
  return options;
}

void add(const NoisySystem& system, Defect defect, std::uint64_t seed, double hold_out, bool errors, Row& row) {
  const Place at{Index(seed * 7 + 3) % experiments, Index(seed) % system.model.outputs, 10 + Index(seed * 13) % 60};
  const Ensemble healthy = system.experiments(experiments, seed);
  const Ensemble data = with_defect(healthy, system, defect, at);
  IdentifyOptions options = options_of(system, hold_out);
  const Identification kept = identify(data, options);
  const Accused named = accused(kept, defect, at);
  ++row.count;
  row.right += named.right;
  row.wrong += named.wrong_experiments + named.wrong_samples > 0;
  if (!errors) return;
  const double best = one_step_error(system, identify(without_defect(data, defect, at), options).model, seed);
  row.worst_kept = std::max(row.worst_kept, one_step_error(system, kept.model, seed) / best);
  options.outliers = OutlierChoice::drop;
  row.worst_dropped = std::max(row.worst_dropped, one_step_error(system, identify(data, options).model, seed) / best);
  options.outliers = OutlierChoice::downweight;
  row.worst_downweighted =
      std::max(row.worst_downweighted, one_step_error(system, identify(data, options).model, seed) / best);
}

// Healthy ensembles with experiments or samples that are named.
void count_healthy(const std::string& name, int first, int seeds) {
  int with_experiments = 0, with_samples = 0;
  for (int seed = first; seed < first + seeds; ++seed) {
    const NoisySystem system = noisy_system(name, steps, std::uint64_t(seed));
    const Identification found =
        identify(system.experiments(experiments, std::uint64_t(seed + 1000)), options_of(system, 0.0));
    with_experiments += !found.outliers.empty();
    with_samples += !found.validation.outlying.empty();
  }
  fmt::print("{:>14} {:>10} {:>12} {:>9}\n", name, seeds, with_experiments, with_samples);
  std::fflush(stdout);
}

}  // namespace

// tokid_defects [SEEDS [HEALTHY [errors|names [FIRST_SEED [SYSTEM]]]]]
int main(int argc, char** argv) {
  const int seeds = argc > 1 ? std::atoi(argv[1]) : 10, healthy = argc > 2 ? std::atoi(argv[2]) : 100,
            first = argc > 4 ? std::atoi(argv[4]) : 1;
  const bool errors = argc <= 3 || std::strcmp(argv[3], "errors") == 0;
  const std::vector<std::string> systems = argc > 5 ? std::vector<std::string>{argv[5]} : noisy_systems();
  fmt::print("{:>14} {:>20} {:>8} {:>6} {:>7} {:>6} {:>9} {:>7} {:>11}\n", "system", "defect", "held out", "of",
             "named", "others", "kept", "dropped", "downweighted");
  for (const std::string& name : systems)
    for (const Defect defect : defects)
      for (const double hold_out : {0.0, 0.2}) {
        Row row;
        for (int seed = first; seed < first + seeds; ++seed)
          add(noisy_system(name, steps, std::uint64_t(seed)), defect, std::uint64_t(seed), hold_out,
              errors && hold_out == 0, row);
        fmt::print("{:>14} {:>20} {:>8} {:>6} {:>7} {:>6} {:>9.3f} {:>7.3f} {:>11.3f}\n", name,
                   tokid::testing::name(defect), hold_out, row.count, row.right, row.wrong, row.worst_kept,
                   row.worst_dropped, row.worst_downweighted);
        std::fflush(stdout);
      }
  fmt::print("\n{:>14} {:>10} {:>12} {:>9}\n", "healthy", "ensembles", "experiments", "samples");
  for (const std::string& name : systems) count_healthy(name, first, healthy);
}
