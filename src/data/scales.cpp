// SPDX-License-Identifier: BSD-3-Clause
#include "data/scales.hpp"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <string_view>
#include <utility>

namespace tokid {

namespace {

constexpr Index fewest_measured = 16, most_measured = 256;  // steps
constexpr int most_digits = 9;                              // significant digits of values that count as rounded text

// Digits of the shortest decimal text of this value: significant digits, and digits after the point.
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

std::vector<Index> spread_steps(const Ensemble& e) {
  constexpr double most_samples = 2e6;
  const double each = double(e.experiments() * e.channels());
  const Index count = std::min(e.steps(), std::clamp(Index(most_samples / each), fewest_measured, most_measured));
  std::vector<Index> steps;
  for (Index i = 0; i < count; ++i) steps.push_back((2 * i + 1) * e.steps() / (2 * count));
  return steps;
}

void measure(const Ensemble& e, Scales& s) {
  const Index N = e.experiments(), d = e.channels();
  s.departure = Vector::Zero(d);
  s.arithmetic = Vector::Zero(d);
  s.own = Matrix::Zero(N, d);
  s.spread = Matrix::Zero(Index(s.steps.size()), d);
  Vector motion(d);
  for (Index c = 0; c < d; ++c) {
    Vector square = Vector::Zero(N), count = Vector::Zero(N);
    std::vector<double> values, centres, sizes;
    for (size_t i = 0; i < s.steps.size(); ++i) {
      const auto column = e.samples().col(s.steps[i] * d + c);
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
      s.spread(Index(i), c) = median(values);
    }
    std::vector<double> usual;
    for (Index n = 0; n < N; ++n)
      if (square(n) > 0) usual.push_back(s.own(n, c) = std::sqrt(square(n) / count(n)));
    s.departure(c) = median(usual);
    const double size = median(sizes), middle = median(centres);
    for (double& v : centres) v = std::abs(v - middle);
    motion(c) = median(centres);
    s.arithmetic(c) = rounding_of_sizes * std::max(size, s.departure(c));
  }
  // If all experiments are equal, their motion over time is used in place of the departures.
  if ((s.departure.array() <= rounding_of_departures * motion.array()).all()) {
    s.departure = s.departure.cwiseMax(motion);
    s.own.rowwise() = s.departure.transpose();
  }
}

}  // namespace

double Precision::rounding(double value) const {
  if (kind == Kind::full || value == 0) return kind == Kind::decimal ? 0.5 * std::pow(10.0, -decimals) : 0.0;
  if (kind == Kind::single) return std::ldexp(std::abs(value), -24);
  const int magnitude = int(std::floor(std::log10(std::abs(value)))) + 1;
  return 0.5 * std::pow(10.0, std::max(-decimals, magnitude - significant));
}

Scales scales(const Ensemble& e) {
  Scales result;
  if (e.samples().size() == 0) return result;
  result.steps = spread_steps(e);
  measure(e, result);
  for (Index n = 0; n < e.experiments(); ++n)
    for (Index c = 0; c < e.channels(); ++c) result.precision.push_back(precision_of(e, n, c, result.steps));
  return result;
}

}  // namespace tokid
