// SPDX-License-Identifier: BSD-3-Clause
#include "data/experiment_names.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "base/words.hpp"

namespace tokid {

namespace {

bool any_twice(std::vector<Index> rows) {
  std::sort(rows.begin(), rows.end());
  return std::adjacent_find(rows.begin(), rows.end()) != rows.end();
}

}  // namespace

std::string fault_of_experiment_names(const std::vector<std::string>& names, Index experiments) {
  if (names.empty()) return "";
  if (Index(names.size()) != experiments)
    return fmt::format("experiment_names: {} found for {}", words::plural(Index(names.size()), "name"),
                       words::plural(experiments, "experiment"));
  std::unordered_map<std::string_view, size_t> rows;
  for (size_t n = 0; n < names.size(); ++n) {
    if (names[n].empty()) return fmt::format("experiment_names: an empty text found at row {}, a name needed", n);
    const auto [first, is_new] = rows.try_emplace(names[n], n);
    if (!is_new)
      return fmt::format("experiment_names: \"{}\" found at rows {} and {}, different names needed",
                         words::quoted(names[n]), first->second, n);
  }
  return "";
}

bool are_row_numbers(const std::vector<std::string>& names) {
  for (size_t n = 0; n < names.size(); ++n)
    if (names[n] != std::to_string(n)) return false;
  return true;
}

std::vector<std::string> names_of_subset(const std::vector<std::string>& names, const std::vector<Index>& chosen) {
  if (any_twice(chosen)) return {};
  std::vector<std::string> result;
  result.reserve(chosen.size());
  for (const Index n : chosen) result.push_back(names.empty() ? std::to_string(n) : names[size_t(n)]);
  if (are_row_numbers(result)) result.clear();
  return result;
}

}  // namespace tokid
