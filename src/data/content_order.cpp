// SPDX-License-Identifier: BSD-3-Clause
#include "data/content_order.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/integers.hpp"
#include "base/random.hpp"

namespace tokid {

namespace {

// Smallest and largest sample of a channel. No order of the experiments changes their last bits.
struct Range {
  double least = std::numeric_limits<double>::infinity(), largest = -least;
};

std::vector<Range> channel_ranges(const Ensemble& e) {
  std::vector<Range> ranges(size_t(e.channels()));
  for (Index c = 0; c < e.samples().cols(); ++c) {
    Range& range = ranges[size_t(c % e.channels())];
    for (const double x : e.samples().col(c))
      if (!std::isnan(x)) range = {std::min(range.least, x), std::max(range.largest, x)};
  }
  return ranges;
}

// Compares the samples one by one; missing samples are last.
bool less(const Ensemble& e, Index a, Index b) {
  for (Index c = 0; c < e.samples().cols(); ++c) {
    const double x = e.samples()(a, c), y = e.samples()(b, c);
    if (std::isnan(x) != std::isnan(y)) return std::isnan(y);
    if (x < y || y < x) return x < y;
  }
  return false;
}

}  // namespace

std::vector<Index> content_order(const Ensemble& e) {
  // A sum of all samples with random weights hardly ever differs by rounding errors alone.
  const std::vector<Range> ranges = channel_ranges(e);
  RandomNumbers random(1);
  Vector sums = Vector::Zero(e.experiments());
  for (Index c = 0; c < e.samples().cols(); ++c) {
    const double weight = 2 * random.uniform() - 1;
    const double least = ranges[size_t(c % e.channels())].least,
                 share = weight / (ranges[size_t(c % e.channels())].largest - least);
    if (!std::isfinite(share) || share == 0.0) continue;  // a constant channel, or an infinite sample
    const auto column = e.samples().col(c).array();
    sums.array() += column.isNaN().select(0.0, column - least) * share;
  }
  std::vector<Index> order = range(0, e.experiments());
  std::stable_sort(order.begin(), order.end(),
                   [&](Index a, Index b) { return sums(a) != sums(b) ? sums(a) < sums(b) : less(e, a, b); });
  return order;
}

}  // namespace tokid
