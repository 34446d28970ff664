// How many digits of the results of every stage hold, over random cases: writes the tables of docs/accuracy.md anew.
// SPDX-License-Identifier: BSD-3-Clause
#include "accuracy.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

namespace {

using tokid::testing::Accuracy;
using List = std::vector<Accuracy>;

// A row for each stage and route.
std::string stages(const List& all) {
  std::string table =
      "| stage | route | cases | condition up to | × growth up to | ratio, median | largest |\n"
      "| --- | --- | ---: | ---: | ---: | ---: | ---: |\n";
  std::vector<std::pair<std::string, std::string>> rows;
  for (const Accuracy& a : all)
    if (std::pair row(a.stage, a.route); std::find(rows.begin(), rows.end(), row) == rows.end()) rows.push_back(row);
  std::stable_sort(rows.begin(), rows.end(), [&](const auto& a, const auto& b) {
    const auto first = [&](const auto& row) {
      return std::find_if(all.begin(), all.end(), [&](const Accuracy& x) { return x.stage == row.first; });
    };
    return first(a) < first(b);
  });
  std::string stage_before;
  for (const auto& [stage, route] : rows) {
    std::vector<double> ratios;
    double condition = 1.0, growth = 1.0;
    for (const Accuracy& a : all) {
      if (a.stage != stage || a.route != route) continue;
      ratios.push_back(a.ratio);
      condition = std::max(condition, a.condition);
      growth = std::max(growth, a.growth);
    }
    std::sort(ratios.begin(), ratios.end());
    table += fmt::format("| {} | {} | {} | {} | {:.0e} | {:.2g} | {:.2g} |\n", stage == stage_before ? "" : stage,
                         route, ratios.size(), condition > 1 ? fmt::format("{:.0e}", condition) : "–", growth,
                         ratios[ratios.size() / 2], ratios.back());
    stage_before = stage;
  }
  return table;
}

// A row for two decades of the condition number.
std::string digits(const List& all) {
  std::string table =
      "| condition number | coefficients | with noise | one-step fit | with noise | pulse responses of the model |\n"
      "| --- | ---: | ---: | ---: | ---: | ---: |\n";
  for (int decade = 0; decade < 12; decade += 2) {
    const auto fewest = [&](const char* stage, bool noisy) {
      double error = 0.0;
      for (const Accuracy& a : all)
        if (a.stage == stage && a.noisy == noisy && std::floor(std::log10(a.condition) / 2) == decade / 2)
          error = std::max(error, a.error);
      return error > 0 ? fmt::format("{:.1f}", -std::log10(error)) : std::string("–");
    };
    table += fmt::format("| $10^{{{}}}$ to $10^{{{}}}$ | {} | {} | {} | {} | {} |\n", decade, decade + 2,
                         fewest("coefficients", false), fewest("coefficients", true), fewest("fit", false),
                         fewest("fit", true), fewest("whole identification", false));
  }
  return table;
}

bool replace(std::string& text, const std::string& name, const std::string& table) {
  const std::string mark = "<!-- table: " + name + " -->\n";
  const size_t begin = text.find(mark), end = text.find("<!-- end -->", begin);
  if (begin == std::string::npos || end == std::string::npos) return false;
  text.replace(begin + mark.size(), end - begin - mark.size(), table);
  return true;
}

}  // namespace

// tokid_accuracy [DOCUMENT [MULTIPLE]]: the cases of the test, and more that follow them, three times as many or as
// told
int main(int argc, char** argv) {
  const int multiple = argc > 2 ? std::max(1, std::atoi(argv[2])) : 3;
  List all;
  for (const tokid::testing::AccuracyStudy& study : tokid::testing::accuracy_studies()) {
    const List found = study.run(multiple * study.cases);
    all.insert(all.end(), found.begin(), found.end());
  }
  const std::string stage_table = stages(all), digit_table = digits(all);
  fmt::print("{}\n{}", stage_table, digit_table);
  if (argc < 2) return 0;
  std::ifstream in(argv[1]);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  if (!replace(text, "stages", stage_table) || !replace(text, "digits", digit_table)) {
    fmt::print(stderr, "{}: no place for the tables\n", argv[1]);
    return 1;
  }
  std::ofstream(argv[1]) << text;
}
