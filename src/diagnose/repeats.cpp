// SPDX-License-Identifier: BSD-3-Clause
#include "diagnose/repeats.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <unordered_map>

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace tokid {

namespace {

bool equal(double a, double b) { return a == b || (std::isnan(a) && std::isnan(b)); }

// Hashes of the inputs of every experiment. The loops follow the columns, as the samples lie in memory.
std::vector<std::uint64_t> input_hashes(const Ensemble& e) {
  std::vector<std::uint64_t> result(size_t(e.experiments()), 0);
  for (Index k = 0; k < e.steps(); ++k)
    for (Index i = 0; i < e.inputs(); ++i)
      for (Index n = 0; n < e.experiments(); ++n) {
        const double found = e.u(n, k, i);
        // Both zeros are equal, and all NaN are equal.
        const double value = std::isnan(found) ? std::numeric_limits<double>::quiet_NaN() : found + 0.0;
        result[size_t(n)] = XXH3_64bits_withSeed(&value, sizeof(value), result[size_t(n)]);
      }
  return result;
}

bool same_inputs(const Ensemble& e, Index a, Index b) {
  for (Index k = 0; k < e.steps(); ++k)
    for (Index i = 0; i < e.inputs(); ++i)
      if (!equal(e.u(a, k, i), e.u(b, k, i))) return false;
  return true;
}

}  // namespace

Index input_courses(const Ensemble& e) {
  const std::vector<std::uint64_t> hashes = input_hashes(e);
  // hash → first experiment of each course with this hash
  std::unordered_map<std::uint64_t, std::vector<Index>> courses;
  Index count = 0;
  for (Index n = 0; n < e.experiments(); ++n) {
    std::vector<Index>& known = courses[hashes[size_t(n)]];
    if (std::any_of(known.begin(), known.end(), [&](Index other) { return same_inputs(e, other, n); })) continue;
    known.push_back(n);
    ++count;
  }
  return count;
}

Findings findings_of_repeats(const Ensemble& e, Index needed, Index lags) {
  if (needed <= 1) return {};
  const Index courses = input_courses(e);
  if (courses <= 1 || courses >= e.experiments() || courses >= needed) return {};
  return {{.kind = Finding::Kind::inputs_repeated,
           .numbers = {{"experiments", double(e.experiments())},
                       {"courses", double(courses)},
                       {"needed", double(needed)},
                       {"lags", double(lags)}}}};
}

}  // namespace tokid
