// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/copies.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <numeric>
#include <string_view>

#include "base/random.hpp"
#include "base/words.hpp"

namespace tokid {

namespace {

// Root mean square of a difference that is rounding, as a share of the usual departure of a channel. Sensors have more
// noise than this, and copies that were computed with anew differ by less.
constexpr double rounding_share = 4e-6;
// The same of the size of a channel: rounding of sums in double precision.
constexpr double arithmetic_share = 1e-12;
// Rounding to so few digits that the error is a larger share of the departures says nothing.
constexpr double coarsest_share = 0.05;
// Steps at which departures are measured, and those of them where experiments are compared.
constexpr Index most_measured = 256, most_probes = 16;
// Successors in an order that an experiment is compared with.
constexpr size_t most_successors = 16;
constexpr Index most_digits = 9;  // of text that was rounded

// What the decimal digits or the bits of a channel of an experiment resolve.
struct Precision {
  enum class Kind { full, single, decimal } kind = Kind::full;
  int significant = 0, decimals = 0;  // digits, of decimal ones

  bool operator==(const Precision&) const = default;

  // Half a unit of the last place of this value.
  double rounding(double value) const {
    if (kind == Kind::full || value == 0) return kind == Kind::decimal ? 0.5 * std::pow(10.0, -decimals) : 0.0;
    if (kind == Kind::single) return std::ldexp(std::abs(value), -24);
    const int magnitude = int(std::floor(std::log10(std::abs(value)))) + 1;
    return 0.5 * std::pow(10.0, std::max(-decimals, magnitude - significant));
  }
};

// Digits of the shortest text that reads as this value: significant ones, and those behind the point.
std::pair<int, int> digits_of(double value) {
  std::array<char, 32> text{};
  const auto end = std::to_chars(text.data(), text.data() + text.size(), value, std::chars_format::scientific).ptr;
  const std::string_view all(text.data(), size_t(end - text.data()));
  const size_t e = all.find('e');
  const int significant =
      int(std::count_if(all.begin(), all.begin() + std::ptrdiff_t(e), [](char c) { return c >= '0' && c <= '9'; }));
  int exponent = 0;
  const std::string_view tail = all.substr(e + (all[e + 1] == '+' ? 2 : 1));
  std::from_chars(tail.data(), tail.data() + tail.size(), exponent);
  return {significant, significant - 1 - exponent};
}

Precision precision_of(const Ensemble& e, Index n, Index channel, const std::vector<Index>& steps) {
  constexpr int enough = 12;
  Precision decimal{Precision::Kind::decimal, 0, -400};
  bool single = true;
  int looked_at = 0;
  for (const Index k : steps) {
    const double value = e.samples()(n, k * e.channels() + channel);
    if (!std::isfinite(value) || value == 0) continue;
    single = single && double(float(value)) == value;
    const auto [significant, decimals] = digits_of(value);
    decimal.significant = std::max(decimal.significant, significant);
    decimal.decimals = std::max(decimal.decimals, decimals);
    if (!single && decimal.significant > most_digits) return {};
    if (++looked_at == enough) break;
  }
  if (looked_at == 0) return {};
  if (decimal.significant <= most_digits) return decimal;
  return single ? Precision{Precision::Kind::single, 0, 0} : Precision{};
}

double median(std::vector<double>& values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + std::ptrdiff_t(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

// What copies are searched with: the sizes of the channels, and steps where experiments differ.
class Search {
 public:
  explicit Search(const Ensemble& ensemble) : e_(ensemble) {
    choose_steps();
    measure();
    for (Index n = 0; n < e_.experiments(); ++n)
      for (Index c = 0; c < e_.channels(); ++c) precision_.push_back(precision_of(e_, n, c, steps_));
    for (Index n = 1; n < e_.experiments(); ++n) several_ = several_ || !alike(0, n);
  }

  // Calls `same` for pairs that may be copies, often enough to link all copies of an experiment.
  template <class Same>
  void for_each_pair(Same&& same) const {
    RandomNumbers random(1);
    const Index d = e_.channels();
    const auto weights = [&] {
      Vector w(d);
      for (Index c = 0; c < d; ++c) w(c) = departure_(c) > 0 ? (2 * random.uniform() - 1) / departure_(c) : 0.0;
      return w;
    };
    // Experiments without a gap by all of their samples: two of them are hardly ever alike by chance.
    Vector whole = Vector::Zero(e_.experiments());
    for (Index k = 0; k < e_.steps(); ++k) whole += e_.samples().middleCols(k * d, d) * weights();
    compare(whole, std::sqrt(double(e_.steps() * d)), same);
    if (std::none_of(whole.begin(), whole.end(), [](double v) { return std::isnan(v); })) return;
    // Others by the samples that they have, few as they may be: copies mostly lack the same ones.
    Vector present = Vector::Zero(e_.experiments());
    for (Index k = 0; k < e_.steps(); ++k) {
      const auto samples = e_.samples().middleCols(k * d, d).array();
      present += samples.isNaN().select(0.0, samples).matrix() * weights();
    }
    compare(whole.array().isNaN().select(present, std::numeric_limits<double>::quiet_NaN()),
            std::sqrt(double(e_.steps() * d)), same);
    // And by steps at which both have samples. Many may be alike there, as where experiments begin at rest.
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
    // In steps of the golden section: experiments may share their beginning, or any stretch.
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
  // Neighbours in the order of these values, whose usual size is `size`.
  template <class Same>
  void compare(const Vector& values, double size, Same&& same) const {
    std::vector<std::pair<double, Index>> order;
    for (Index n = 0; n < e_.experiments(); ++n)
      if (std::isfinite(values(n))) order.emplace_back(values(n), n);
    std::sort(order.begin(), order.end());
    // Single differences are larger than their root mean square.
    const double close = 10 * rounding_share * size, far = several_ ? 4 * coarsest_share * size : close;
    for (size_t i = 0; i < order.size(); ++i)
      for (size_t j = i + 1; j < std::min(order.size(), i + 1 + most_successors); ++j) {
        const double apart = order[j].first - order[i].first;
        if (apart > far) break;
        const Index a = std::min(order[i].second, order[j].second), b = std::max(order[i].second, order[j].second);
        if (apart <= close || !alike(a, b)) same(a, b);
      }
  }

  // Root mean square that a difference of two experiments may have. Small experiments differ by less.
  double allowed(Index a, Index b, Index c, bool rounded) const {
    const double size = std::min(departure_(c), std::max(own_(a, c), own_(b, c)));
    return rounded ? coarsest_share * size : std::max(rounding_share * size, arithmetic_(c));
  }
  const Precision& precision(Index n, Index c) const { return precision_[size_t(n * e_.channels() + c)]; }
  bool alike(Index a, Index b) const {
    for (Index c = 0; c < e_.channels(); ++c)
      if (!(precision(a, c) == precision(b, c))) return false;
    return true;
  }

  void choose_steps() {
    constexpr double most_samples = 2e6;
    const double each = double(e_.experiments() * e_.channels());
    const Index count = std::min(e_.steps(), std::clamp(Index(most_samples / each), most_probes, most_measured));
    for (Index i = 0; i < count; ++i) steps_.push_back((2 * i + 1) * e_.steps() / (2 * count));
  }

  // Departures from the median over the experiments, root mean squares of each experiment, and their median: single
  // experiments that are far off change little.
  void measure() {
    const Index N = e_.experiments(), d = e_.channels();
    departure_ = Vector::Zero(d);
    arithmetic_ = Vector::Zero(d);
    own_ = Matrix::Zero(N, d);
    spread_ = Matrix::Zero(Index(steps_.size()), d);
    Vector motion(d);
    for (Index c = 0; c < d; ++c) {
      Vector square = Vector::Zero(N), count = Vector::Zero(N);
      std::vector<double> values, centres, sizes;
      for (size_t i = 0; i < steps_.size(); ++i) {
        const auto column = e_.samples().col(steps_[i] * d + c);
        values.clear();
        for (const double v : column)
          if (std::isfinite(v)) values.push_back(v);
        if (values.empty()) continue;
        const double centre = median(values);
        centres.push_back(centre);
        sizes.push_back(std::abs(centre));
        for (Index n = 0; n < N; ++n)
          if (std::isfinite(column(n))) {
            square(n) += (column(n) - centre) * (column(n) - centre);
            count(n) += 1;
          }
        for (double& v : values) v = std::abs(v - centre);
        spread_(Index(i), c) = median(values);
      }
      std::vector<double> usual;
      for (Index n = 0; n < N; ++n)
        if (square(n) > 0) usual.push_back(own_(n, c) = std::sqrt(square(n) / count(n)));
      departure_(c) = median(usual);
      const double size = median(sizes), middle = median(centres);
      for (double& v : centres) v = std::abs(v - middle);
      motion(c) = median(centres);
      arithmetic_(c) = arithmetic_share * std::max(size, departure_(c));
    }
    // One experiment, over and over.
    if ((departure_.array() <= rounding_share * motion.array()).all()) {
      departure_ = departure_.cwiseMax(motion);
      own_.rowwise() = departure_.transpose();
    }
  }

  // Of each stretch of the record the step where the experiments differ most.
  std::vector<Index> probes() const {
    const Index count = std::min(most_probes, Index(steps_.size()));
    std::vector<Index> result;
    for (Index p = 0; p < count; ++p) {
      const Index begin = p * Index(steps_.size()) / count, end = (p + 1) * Index(steps_.size()) / count;
      Index best = begin;
      const auto score = [&](Index i) {
        double sum = 0.0;
        for (Index c = 0; c < e_.channels(); ++c)
          if (departure_(c) > 0) sum += spread_(i, c) / departure_(c);
        return sum;
      };
      for (Index i = begin + 1; i < end; ++i)
        if (score(i) > score(best)) best = i;
      result.push_back(steps_[size_t(best)]);
    }
    return result;
  }

  const Ensemble& e_;
  std::vector<Index> steps_;
  Matrix spread_;      // (steps × d) median departure of each step
  Vector departure_;   // (d) usual departure of a channel
  Matrix own_;         // (N × d) departure of each experiment
  Vector arithmetic_;  // (d) rounding of sums in a channel
  std::vector<Precision> precision_;
  bool several_ = false;  // precisions
};

// The root of a tree of copies, shortened on the way.
Index root(std::vector<Index>& parent, Index n) {
  while (parent[size_t(n)] != n) n = parent[size_t(n)] = parent[size_t(parent[size_t(n)])];
  return n;
}

Index samples_of(const Ensemble& e, Index n) {
  Index count = 0;
  for (Index c = 0; c < e.samples().cols(); ++c) count += !std::isnan(e.samples()(n, c));
  return count;
}

}  // namespace

Copies find_copies(const Ensemble& e) {
  const Index N = e.experiments();
  Copies result;
  std::vector<Index> parent(static_cast<size_t>(N));
  std::iota(parent.begin(), parent.end(), Index{0});
  if (N > 1 && e.steps() > 0) {
    const Search search(e);
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
        return samples_of(e, a) < samples_of(e, b);  // the first one of several
      });
      std::rotate(group.begin(), most, most + 1);
    }
    result.used.push_back(group.front());
    if (group.size() > 1) result.groups.push_back(std::move(group));
  }
  std::sort(result.used.begin(), result.used.end());
  return result;
}

std::vector<std::string> warnings_of(const Copies& copies, const Ensemble& e, std::string_view consequence) {
  constexpr size_t most_told = 4;
  if (copies.groups.empty()) return {};
  std::vector<std::string> told;
  size_t count = 0, more = 0;
  for (const std::vector<Index>& group : copies.groups) {
    count += group.size() - 1;
    if (told.size() == most_told) {
      more += group.size() - 1;
      continue;
    }
    std::vector<std::string> names;
    for (size_t i = 1; i < std::min(group.size(), 1 + most_told); ++i) names.push_back(e.experiment(group[i]));
    std::string list = words::listed(names);
    if (group.size() > 1 + most_told)
      list = fmt::format("{} and {} more", fmt::join(names, ", "), group.size() - 1 - most_told);
    told.push_back(fmt::format("{} of {}", list, e.experiment(group.front())));
  }
  std::string text = fmt::format("{} of {} experiments {}, within rounding: {}", count, e.experiments(),
                                 count == 1 ? "is a copy of another" : "are copies of others", fmt::join(told, "; "));
  if (more > 0) text += fmt::format("; and {} more", more);
  return {fmt::format("{}. {}", text, consequence)};
}

}  // namespace tokid
