// SPDX-License-Identifier: BSD-3-Clause
#include "suggestion.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <numeric>
#include <utility>

namespace tokid::app {

namespace {

// Number of insertions, deletions, replacements and swaps of neighbouring letters that change one word into the other.
size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<size_t> before, last(b.size() + 1), row(b.size() + 1);
  std::iota(row.begin(), row.end(), size_t{0});
  for (size_t i = 0; i < a.size(); ++i) {
    before = std::exchange(last, row);
    row[0] = i + 1;
    for (size_t j = 0; j < b.size(); ++j) {
      row[j + 1] = std::min({row[j] + 1, last[j + 1] + 1, last[j] + (a[i] == b[j] ? 0 : 1)});
      if (i > 0 && j > 0 && a[i] == b[j - 1] && a[i - 1] == b[j]) row[j + 1] = std::min(row[j + 1], before[j - 1] + 1);
    }
  }
  return row.back();
}

// The option for a name that other programs and papers use for the same thing.
std::vector<std::string> also_called(std::string_view word) {
  static const std::multimap<std::string, std::string, std::less<>> names{{"--order", "--states"},
                                                                          {"--order", "--lags"},
                                                                          {"--model-order", "--states"},
                                                                          {"--nx", "--states"},
                                                                          {"--n", "--states"},
                                                                          {"--dimension", "--states"},
                                                                          {"--p", "--lags"},
                                                                          {"--past", "--lags"},
                                                                          {"--lambda", "--smoothing"},
                                                                          {"--regularization", "--smoothing"},
                                                                          {"--test", "--hold-out"},
                                                                          {"--test-size", "--hold-out"},
                                                                          {"--validation", "--hold-out"},
                                                                          {"--mean", "--nominal"},
                                                                          {"--x0", "--initial-state"},
                                                                          {"--jobs", "--threads"},
                                                                          {"--folds", "--cross-validate"},
                                                                          {"--realisation", "--method"},
                                                                          {"--out", "--output"}};
  std::vector<std::string> meant;
  for (auto [at, end] = names.equal_range(word); at != end; ++at) meant.push_back(at->second);
  return meant;
}

}  // namespace

std::string did_you_mean(std::string_view word, const std::vector<std::string>& known) {
  std::vector<std::string> meant;
  const auto is_known = [&](const std::string& name) {
    return std::find(known.begin(), known.end(), name) != known.end();
  };
  for (const std::string& name : also_called(word))
    if (is_known(name)) meant.push_back(name);
  // A word may have one error for every three letters, but at least one. Dashes do not count as letters. A truncated
  // word counts as one error.
  const size_t letters = word.size() - std::min(word.size(), word.find_first_not_of('-'));
  size_t nearest = std::max<size_t>(1, letters / 3) + 1;
  std::vector<std::string> alike;
  for (const std::string& name : known) {
    const size_t distance = letters >= 3 && name.starts_with(word) ? 1 : edit_distance(word, name);
    if (distance > nearest || distance > std::max<size_t>(1, letters / 3)) continue;
    if (distance < nearest) alike.clear();
    nearest = distance;
    alike.push_back(name);
  }
  if (meant.empty()) meant = std::move(alike);
  return meant.empty() ? "" : fmt::format(". Did you mean {}?", fmt::join(meant, " or "));
}

}  // namespace tokid::app
