// How many digits of the results of every stage hold, over random cases: writes the tables of docs/evidence.md anew.
// SPDX-License-Identifier: BSD-3-Clause
#include "studies/accuracy.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cstdlib>
#include <exception>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "studies/accuracy_tables.hpp"

namespace {

constexpr const char* tables_alone = "<!-- table: digits -->\n<!-- end -->\n\n<!-- table: stages -->\n<!-- end -->\n";

}  // namespace

// tokid_accuracy [DOCUMENT [MULTIPLE]]: the cases of the test, and more that follow them, three times as many or as
// told
int main(int argc, char** argv) try {
  using namespace tokid::testing;
  const int multiple = argc > 2 ? std::max(1, std::atoi(argv[2])) : 3;
  std::vector<Accuracy> all;
  for (const AccuracyStudy& study : accuracy_studies()) {
    const AccuracyFindings found = study.run(multiple * study.cases);
    fmt::print("{}: {} judged, {} left out\n", study.name, found.judged, found.left_out);
    all.insert(all.end(), found.all.begin(), found.all.end());
  }
  const std::vector<AccuracyRow> rows = accuracy_rows(all);
  const std::vector<DigitsRow> digits = digits_rows(all);
  fmt::print("\n{}", with_tables(tables_alone, rows, digits));
  if (argc < 2) return 0;
  std::ifstream in(argv[1]);
  const std::string text = with_tables({std::istreambuf_iterator<char>(in), {}}, rows, digits);
  std::ofstream(argv[1]) << text;
} catch (const std::exception& error) {
  fmt::print(stderr, "tokid_accuracy: {}\n", error.what());
  return 1;
}
