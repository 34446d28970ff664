// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/copies.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

#include "base/integers.hpp"
#include "base/random.hpp"
#include "data/check.hpp"
#include "data/extents.hpp"
#include "data/scales.hpp"
#include "data/subjects.hpp"
#include "data/unused.hpp"

namespace tokid {

namespace {

// Most single steps at which experiments with missing samples are compared.
constexpr Index most_probes = 16;
// Experiments are sorted by a sum of their samples. Each experiment is compared with at most this many successors.
constexpr size_t most_successors = 16;

// Search for copies in an ensemble.
class Search {
 public:
  Search(const Ensemble& ensemble, const Scales& scales) : e_(ensemble), scales_(scales) {
    for (Index n = 1; n < e_.experiments(); ++n) several_ = several_ || !alike(0, n);
  }

  // Calls `same` for pairs that may be copies. The pairs suffice to link all copies of an experiment.
  template <class Same>
  void for_each_pair(Same&& same) const {
    RandomNumbers random(1);
    const Index d = e_.channels();
    const auto weights = [&] {
      Vector w(d);
      for (Index c = 0; c < d; ++c)
        w(c) = scales_.departure(c) > 0 ? (2 * random.uniform() - 1) / scales_.departure(c) : 0.0;
      return w;
    };
    // Experiments without a missing sample are compared by a sum of all samples with random weights. The sums of two
    // different experiments are hardly ever equal.
    Vector whole = Vector::Zero(e_.experiments());
    for (Index k = 0; k < e_.steps(); ++k) whole += e_.samples().middleCols(k * d, d) * weights();
    compare(whole, std::sqrt(double(e_.steps() * d)), same);
    if (std::none_of(whole.begin(), whole.end(), [](double v) { return std::isnan(v); })) return;
    // Experiments with missing samples are compared by the sum of their present samples. Copies mostly lack the same
    // samples.
    Vector present = Vector::Zero(e_.experiments());
    for (Index k = 0; k < e_.steps(); ++k) {
      const auto samples = e_.samples().middleCols(k * d, d).array();
      present += samples.isNaN().select(0.0, samples).matrix() * weights();
    }
    compare(whole.array().isNaN().select(present, std::numeric_limits<double>::quiet_NaN()),
            std::sqrt(double(e_.steps() * d)), same);
    // Copies may also lack different samples, so these experiments are compared at single steps too. Different
    // experiments may agree at a step, so are_copies() must decide.
    for (const Index step : probes())
      compare(e_.samples().middleCols(step * d, d) * weights(), std::sqrt(double(d)), [&](Index a, Index b) {
        if (std::isnan(whole(a)) || std::isnan(whole(b))) same(a, b);
      });
  }

  bool are_copies(Index a, Index b) const {
    const Index d = e_.channels(), T = e_.steps();
    struct Sums {
      double square = 0.0;
      Index count = 0;
      bool rounded = false;
    };
    std::vector<Sums> sums(size_t(d), Sums{});
    for (Index c = 0; c < d; ++c) sums[size_t(c)].rounded = !(precision(a, c) == precision(b, c));
    Index own = 0, other = 0, common = 0;
    // Visits the steps in a scattered order. Different experiments may agree in a stretch, and a scattered order finds
    // a difference sooner.
    Index stride = std::max<Index>(1, Index(0.618 * double(T)));
    while (std::gcd(stride, T) != 1) ++stride;
    for (Index i = 0, k = T / 2; i < T; ++i, k = (k + stride) % T)
      for (Index c = 0; c < d; ++c) {
        const double x = e_.samples()(a, k * d + c), y = e_.samples()(b, k * d + c);
        own += !std::isnan(x);
        other += !std::isnan(y);
        if (std::isnan(x) || std::isnan(y)) continue;
        ++common;
        Sums& s = sums[size_t(c)];
        ++s.count;
        const double apart = std::abs(x - y);
        if (apart == 0) continue;
        s.square += apart * apart;
        if (s.rounded)
          s.rounded = apart <= (1 + 1e-6) * std::max(precision(a, c).rounding(x), precision(b, c).rounding(y));
        const double allowed = this->allowed(a, b, c, s.rounded);
        if (!(s.square <= allowed * allowed * double(T))) return false;
      }
    for (Index c = 0; c < d; ++c) {
      const Sums& s = sums[size_t(c)];
      const double allowed = this->allowed(a, b, c, s.rounded);
      if (s.square > allowed * allowed * double(s.count)) return false;
    }
    return common > 0 && 2 * common >= std::min(own, other);
  }

 private:
  // Calls `same` for experiments with nearly equal values. `size`: the typical size of a value.
  template <class Same>
  void compare(const Vector& values, double size, Same&& same) const {
    std::vector<std::pair<double, Index>> order;
    for (Index n = 0; n < e_.experiments(); ++n)
      if (std::isfinite(values(n))) order.emplace_back(values(n), n);
    std::sort(order.begin(), order.end());
    // The factors allow for single differences above the root mean square.
    const double close = 10 * rounding_of_departures * size, far = several_ ? 4 * coarsest_share * size : close;
    for (size_t i = 0; i < order.size(); ++i)
      for (size_t j = i + 1; j < std::min(order.size(), i + 1 + most_successors); ++j) {
        const double apart = order[j].first - order[i].first;
        if (apart > far) break;
        const Index a = std::min(order[i].second, order[j].second), b = std::max(order[i].second, order[j].second);
        if (apart <= close || !alike(a, b)) same(a, b);
      }
  }

  // Largest root mean square of the difference of two copies. The limit is lower for experiments with small departures.
  double allowed(Index a, Index b, Index c, bool rounded) const {
    const double size = std::min(scales_.departure(c), std::max(scales_.own(a, c), scales_.own(b, c)));
    return rounded ? coarsest_share * size : std::max(rounding_of_departures * size, scales_.arithmetic(c));
  }
  const Precision& precision(Index n, Index c) const { return scales_.precision_of(n, c); }
  bool alike(Index a, Index b) const {
    for (Index c = 0; c < e_.channels(); ++c)
      if (!(precision(a, c) == precision(b, c))) return false;
    return true;
  }

  // For each stretch of the record, the step where the experiments differ most.
  std::vector<Index> probes() const {
    const Index count = std::min(most_probes, Index(scales_.steps.size()));
    std::vector<Index> result;
    for (Index p = 0; p < count; ++p) {
      const Index begin = p * Index(scales_.steps.size()) / count, end = (p + 1) * Index(scales_.steps.size()) / count;
      Index best = begin;
      const auto score = [&](Index i) {
        double sum = 0.0;
        for (Index c = 0; c < e_.channels(); ++c)
          if (scales_.departure(c) > 0) sum += scales_.spread(i, c) / scales_.departure(c);
        return sum;
      };
      for (Index i = begin + 1; i < end; ++i)
        if (score(i) > score(best)) best = i;
      result.push_back(scales_.steps[size_t(best)]);
    }
    return result;
  }

  const Ensemble& e_;
  const Scales& scales_;
  bool several_ = false;  // the experiments have different precisions
};

// Root of the tree of copies that contains n. Shortens the path to the root.
Index root(std::vector<Index>& parent, Index n) {
  while (parent[size_t(n)] != n) n = parent[size_t(n)] = parent[size_t(parent[size_t(n)])];
  return n;
}

Index samples_of(const Ensemble& e, Index n) {
  Index count = 0;
  for (Index c = 0; c < e.samples().cols(); ++c) count += !std::isnan(e.samples()(n, c));
  return count;
}

Copies copies_of(const Ensemble& e) {
  const Index N = e.experiments();
  Copies result;
  std::vector<Index> parent = range(0, N);
  if (N > 1 && e.steps() > 0) {
    const Scales sizes = scales(e);
    const Search search(e, sizes);
    search.for_each_pair([&](Index a, Index b) {
      const Index one = root(parent, a), other = root(parent, b);
      if (one != other && search.are_copies(a, b)) parent[size_t(std::max(one, other))] = std::min(one, other);
    });
  }
  std::vector<std::vector<Index>> rows(static_cast<size_t>(N));
  for (Index n = 0; n < N; ++n) rows[size_t(root(parent, n))].push_back(n);
  for (std::vector<Index>& group : rows) {
    if (group.empty()) continue;
    if (group.size() > 1) {
      const auto most = std::max_element(group.begin(), group.end(), [&](Index a, Index b) {
        return samples_of(e, a) < samples_of(e, b);  // the first, if several have as many samples
      });
      std::rotate(group.begin(), most, most + 1);
    }
    result.used.push_back(group.front());
    if (group.size() > 1) result.groups.push_back(std::move(group));
  }
  std::sort(result.used.begin(), result.used.end());
  return result;
}

}  // namespace

Copies find_copies(const Ensemble& ensemble) {
  check_samples(ensemble);
  return copies_of(ensemble);
}

Findings findings_of(const Copies& copies, const Ensemble& e) {
  if (copies.groups.empty()) return {};
  Finding result{.kind = Finding::Kind::experiments_copied, .numbers = {{"experiments", double(e.experiments())}}};
  for (const std::vector<Index>& group : copies.groups)
    for (size_t i = 1; i < group.size(); ++i) {
      result.experiments.push_back(experiment(e, group[i]));
      result.groups.push_back({experiment(e, group.front())});
    }
  return {std::move(result)};
}

// If no experiment has a sample, all of them stay, so that the checks of the samples say so.
UsedExperiments used_experiments(const Ensemble& ensemble) {
  UsedExperiments result{copies_of(ensemble)};
  const std::vector<Extent> all = extents(ensemble);
  for (Index n = 0; n < ensemble.experiments(); ++n)
    if (all[size_t(n)].begin == all[size_t(n)].end) result.empty.push_back(n);
  if (Index(result.empty.size()) == ensemble.experiments()) result.empty.clear();
  std::set_difference(result.copies.used.begin(), result.copies.used.end(), result.empty.begin(), result.empty.end(),
                      std::back_inserter(result.rows));
  return result;
}

Findings findings_of(const UsedExperiments& used, const Ensemble& ensemble) {
  Findings result;
  if (!used.empty.empty())
    result.push_back({.kind = Finding::Kind::experiments_empty,
                      .experiments = experiments(ensemble, used.empty),
                      .numbers = {{"experiments", double(ensemble.experiments())}}});
  append(result, findings_of(used.copies, ensemble));
  return result;
}

std::string remark_on_unused(const Ensemble& ensemble) {
  std::string text;
  if (ensemble.samples().array().isInf().any()) return text;  // its message names the sample
  for (const std::string& sentence : in_words(findings_of(used_experiments(ensemble), ensemble)))
    text += "; " + sentence;
  return text;
}

}  // namespace tokid
