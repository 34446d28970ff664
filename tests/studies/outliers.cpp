// How often experiments are said not to fit, of campaigns that nothing is wrong with and of those that one experiment
// is wrong in: the rates of docs/evidence.md.
// SPDX-License-Identifier: BSD-3-Clause
#include "studies/campaigns.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>

namespace {

using namespace tokid;
using namespace tokid::testing;

std::vector<Campaign> grid(bool quick) {
  std::vector<Campaign> result;
  for (const Index experiments : quick ? std::vector<Index>{12, 40} : std::vector<Index>{5, 8, 12, 20, 40, 100})
    for (const double noise : quick ? std::vector<double>{0.05} : std::vector<double>{0.01, 0.05, 0.2}) {
      result.push_back({experiments, 80, {2, 1, 1}, noise, 2});
      result.push_back({experiments, 60, {3, 2, 2}, noise, 4});
    }
  return result;
}

}  // namespace

// tokid_outliers [SEEDS]; 0: a few of everything
int main(int argc, char** argv) {
  const int asked = argc > 1 ? std::atoi(argv[1]) : 4, seeds = std::max(1, asked);
  const std::vector<Campaign> campaigns = grid(asked <= 0);
  fmt::print("{:>32} {:>10} {:>8}\n", "nothing wrong", "ensembles", "accused");
  for (const CampaignKind& kind : healthy_campaigns()) {
    int all = 0, accused = 0;
    for (const Campaign& c : campaigns)
      for (int seed = 1; seed <= seeds; ++seed, ++all)
        accused += !identified_outliers(kind.make(c, std::uint64_t(seed)), c).empty();
    fmt::print("{:>32} {:>10} {:>8}\n", kind.name, all, accused);
    std::fflush(stdout);
  }
  fmt::print("\n{:>32} {:>10} {:>8} {:>8}\n", "one experiment wrong", "ensembles", "found", "others");
  for (const CampaignFault& fault : campaign_faults()) {
    int all = 0, right = 0, wrong = 0;
    for (const Campaign& c : campaigns) {
      if (c.size.m < 2 && std::string(fault.name) == "swapped channels") continue;
      for (int seed = 1; seed <= seeds; ++seed, ++all) {
        Ensemble e = campaign(c, std::uint64_t(seed));
        const Ensemble before = e;
        const Index n = c.experiments / 3;
        fault.change(e, before, n);
        const std::vector<Outlier> list = identified_outliers(e, c);
        right += std::any_of(list.begin(), list.end(), [n](const Outlier& o) { return o.experiment == n; });
        wrong += std::any_of(list.begin(), list.end(), [n](const Outlier& o) { return o.experiment != n; });
      }
    }
    fmt::print("{:>32} {:>10} {:>8} {:>8}\n", fault.name, all, right, wrong);
    std::fflush(stdout);
  }
}
