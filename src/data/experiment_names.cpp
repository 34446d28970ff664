// SPDX-License-Identifier: BSD-3-Clause
#include "data/experiment_names.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "base/words.hpp"

namespace tokid {

namespace {

bool are_row_numbers(const std::vector<std::string>& names) {
  for (size_t n = 0; n < names.size(); ++n)
    if (names[n] != std::to_string(n)) return false;
  return true;
}

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

void set_experiment_names(Ensemble& e, std::vector<std::string> names) {
  const std::string fault = fault_of_experiment_names(names, e.experiments());
  if (!fault.empty()) throw std::invalid_argument(fault);
  if (are_row_numbers(names)) names.clear();
  e.experiment_names = std::move(names);
}

std::string Ensemble::experiment_name(Index n) const {
  return size_t(n) < experiment_names.size() ? experiment_names[size_t(n)] : std::string();
}

std::string Ensemble::experiment(Index n) const { return words::experiment(n, experiment_name(n)); }

std::vector<std::string> names_of_subset(const Ensemble& e, const std::vector<Index>& chosen) {
  if (any_twice(chosen)) return {};
  std::vector<std::string> names;
  names.reserve(chosen.size());
  for (const Index n : chosen)
    names.push_back(e.experiment_names.empty() ? std::to_string(n) : e.experiment_names[size_t(n)]);
  if (are_row_numbers(names)) names.clear();
  return names;
}

}  // namespace tokid
