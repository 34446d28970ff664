// SPDX-License-Identifier: BSD-3-Clause
#include "repeats.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <unordered_map>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "words.hpp"

namespace tokid {

namespace {

constexpr size_t most_told = 4;

bool equal(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

// Of every experiment, of its inputs and of all of its samples; by columns, as they lie in memory.
struct Hashes {
  std::vector<std::uint64_t> inputs, all;
};

Hashes hashes(const Ensemble& e) {
  const size_t count = size_t(e.experiments());
  Hashes result{std::vector<std::uint64_t>(count, 0), std::vector<std::uint64_t>(count, 0)};
  for (Index column = 0; column < e.samples().cols(); ++column)
    for (Index n = 0; n < e.experiments(); ++n) {
      const double found = e.samples()(n, column);
      // One zero, and one NaN.
      const double value = std::isnan(found) ? std::numeric_limits<double>::quiet_NaN() : found + 0.0;
      const auto add = [&value](std::uint64_t& hash) { hash = XXH3_64bits_withSeed(&value, sizeof(value), hash); };
      add(result.all[size_t(n)]);
      if (column % e.channels() < e.inputs()) add(result.inputs[size_t(n)]);
    }
  return result;
}

// Experiments that agree in the first `channels` of all steps, in groups of one and more.
std::vector<std::vector<Index>> alike(const Ensemble& e, Index channels, const std::vector<std::uint64_t>& hash) {
  const Index d = e.channels();
  std::unordered_map<std::uint64_t, std::vector<std::vector<Index>>> groups;
  std::vector<std::vector<Index>> result;
  for (Index n = 0; n < e.experiments(); ++n) {
    std::vector<std::vector<Index>>& candidates = groups[hash[size_t(n)]];
    const auto same = std::find_if(candidates.begin(), candidates.end(), [&](const std::vector<Index>& group) {
      for (Index k = 0; k < e.steps(); ++k)
        for (Index c = 0; c < channels; ++c)
          if (!equal(e.samples()(n, k * d + c), e.samples()(group.front(), k * d + c))) return false;
      return true;
    });
    if (same == candidates.end())
      candidates.push_back({n});
    else
      same->push_back(n);
  }
  for (auto& [key, candidates] : groups)
    for (auto& group : candidates) result.push_back(std::move(group));
  std::sort(result.begin(), result.end());
  return result;
}

std::string listed(const std::vector<Index>& experiments, const Ensemble& e) {
  constexpr size_t most = 6;
  std::vector<std::string> names;
  for (size_t i = 0; i < std::min(experiments.size(), most); ++i) names.push_back(e.experiment(experiments[i]));
  if (experiments.size() > most)
    return fmt::format("{} and {} more", fmt::join(names, ", "), experiments.size() - most);
  return words::listed(names);
}

}  // namespace

Repeats repeats(const Ensemble& e) {
  Repeats result;
  const Hashes hash = hashes(e);
  result.courses = Index(alike(e, e.inputs(), hash.inputs).size());
  result.different = e.experiments();
  if (result.courses == e.experiments()) return result;
  for (std::vector<Index>& group : alike(e, e.channels(), hash.all)) {
    if (group.size() < 2) continue;
    result.different -= Index(group.size()) - 1;
    result.same.push_back(std::move(group));
  }
  return result;
}

std::vector<std::string> warnings_of(const Repeats& repeats, const Ensemble& e, Index needed, Index lags) {
  std::vector<std::string> result;
  const auto shortage = [&](Index found) {
    return found < needed ? fmt::format("; {} needed at lag order {}", needed, lags) : std::string();
  };
  if (!repeats.same.empty()) {
    std::string text = fmt::format("experiments {} are the same in every sample", listed(repeats.same.front(), e));
    for (size_t i = 1; i < std::min(most_told, repeats.same.size()); ++i)
      text += fmt::format(", and so are {}", listed(repeats.same[i], e));
    if (repeats.same.size() > most_told) text += ", and so on";
    result.push_back(fmt::format(
        "{}: {} of {} experiments are different, the others add nothing, and errors on experiments left out look too "
        "small{}",
        text, repeats.different, e.experiments(), shortage(repeats.different)));
  }
  if (repeats.courses > 1 && repeats.courses < repeats.different && repeats.courses < needed)
    result.push_back(
        fmt::format("{} repeat {} of the inputs: repetitions tell the noise, but excite no more than the first run "
                    "does{}",
                    words::plural(repeats.different, "experiment"), words::plural(repeats.courses, "course"),
                    shortage(repeats.courses)));
  return result;
}

}  // namespace tokid
