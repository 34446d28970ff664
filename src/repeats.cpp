// SPDX-License-Identifier: BSD-3-Clause
#include "repeats.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>

#include "words.hpp"

namespace tokid {

namespace {

// Steps whose samples are compared at first.
constexpr Index sampled_steps = 16;
constexpr size_t most_told = 4;

bool equal(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

// Experiments that agree in the first `channels` of all steps, in groups of one and more.
std::vector<std::vector<Index>> alike(const Ensemble& e, Index channels) {
  const Index d = e.channels(), count = std::min(sampled_steps, e.steps());
  std::map<std::vector<double>, std::vector<std::vector<Index>>> groups;
  std::vector<std::vector<Index>> result;
  for (Index n = 0; n < e.experiments(); ++n) {
    std::vector<double> key;
    for (Index s = 0; s < count; ++s)
      for (Index c = 0; c < channels; ++c) {
        const double value = e.samples()(n, (2 * s + 1) * e.steps() / (2 * count) * d + c);
        key.push_back(std::isnan(value) ? std::numeric_limits<double>::infinity()
                                        : value);  // infinite ones are refused
      }
    std::vector<std::vector<Index>>& candidates = groups[key];
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

std::string listed(const std::vector<Index>& experiments) {
  std::string text = fmt::format("{}", experiments.front());
  const size_t shown = std::min<size_t>(experiments.size(), 6);
  for (size_t i = 1; i < shown; ++i)
    text += fmt::format("{}{}", i + 1 == experiments.size() ? " and " : ", ", experiments[i]);
  if (shown < experiments.size()) text += fmt::format(" and {} more", experiments.size() - shown);
  return text;
}

}  // namespace

Repeats repeats(const Ensemble& e) {
  Repeats result;
  result.courses = Index(alike(e, e.inputs()).size());
  result.different = e.experiments();
  if (result.courses == e.experiments()) return result;
  for (std::vector<Index>& group : alike(e, e.channels())) {
    if (group.size() < 2) continue;
    result.different -= Index(group.size()) - 1;
    result.same.push_back(std::move(group));
  }
  return result;
}

std::vector<std::string> warnings_of(const Repeats& repeats, Index experiments, Index needed, Index lags) {
  std::vector<std::string> result;
  const auto shortage = [&](Index found) {
    return found < needed ? fmt::format("; {} needed at lag order {}", needed, lags) : std::string();
  };
  if (!repeats.same.empty()) {
    std::string text = fmt::format("experiments {} are the same in every sample", listed(repeats.same.front()));
    for (size_t i = 1; i < std::min(most_told, repeats.same.size()); ++i)
      text += fmt::format(", and so are {}", listed(repeats.same[i]));
    if (repeats.same.size() > most_told) text += ", and so on";
    result.push_back(fmt::format("{}: {} of {} experiments are different, the others add nothing{}", text,
                                 repeats.different, experiments, shortage(repeats.different)));
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
