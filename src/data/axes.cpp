// SPDX-License-Identifier: BSD-3-Clause
#include "data/axes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <vector>

namespace tokid {

namespace {

// A line is the samples of one channel in one experiment, or at one step. Its positions are the steps, or the
// experiments. These are limits of the numbers of lines, positions and channels that are compared.
constexpr Index most_lines = 96, most_positions = 128, fewest_lines = 6, fewest_positions = 3;
constexpr Index most_inputs = 2, most_outputs = 3;
// If the lines have no order, neighbouring lines reach this deviation in fewer than one of 100,000 ensembles.
constexpr double alike = 4.5;
// Both halves of the pairs must reach this deviation. Otherwise pairs of copies that are stored side by side would look
// like an order.
constexpr double alike_by_halves = 2.0;
// If at least this many experiments have one step each, they are more likely the steps of one experiment.
constexpr Index shortest_record = 10;
// Below these limits of deviation and mean rank, the lines along the other axis have no order.
constexpr double unlike = 2.5, mostly_unlike = 0.8;

// For each channel, the lines as columns (positions × lines) of norm 1. The means of each line and of each position are
// removed. Otherwise a mean motion would make all experiments similar, and an offset would make all steps of an
// experiment similar.
using Lines = std::vector<Matrix>;
using Sample = std::function<double(Index line, Index position, Index channel)>;

void remove_mean(Eigen::Ref<Vector> values) {
  double sum = 0.0;
  Index count = 0;
  for (const double value : values)
    if (!std::isnan(value)) sum += value, ++count;
  if (count > 0) values.array() -= sum / double(count);
}

Lines lines_of(Index lines, Index positions, const std::vector<Index>& channels, const Sample& sample) {
  const Index used_lines = std::min(lines, most_lines), used_positions = std::min(positions, most_positions);
  const Index first = (lines - used_lines) / 2;
  Lines result;
  for (const Index channel : channels) {
    Matrix x(used_positions, used_lines);
    for (Index l = 0; l < used_lines; ++l)
      for (Index p = 0; p < used_positions; ++p) x(p, l) = sample(first + l, p * positions / used_positions, channel);
    for (Index l = 0; l < used_lines; ++l) remove_mean(x.col(l));
    for (Index p = 0; p < used_positions; ++p) {
      Vector row = x.row(p).transpose();
      remove_mean(row);
      x.row(p) = row.transpose();
    }
    x = x.unaryExpr([](double value) { return std::isnan(value) ? 0.0 : value; });
    // A constant line has only rounding errors left, so it is set to zero.
    const Vector norm = x.colwise().norm();
    const double rounding = 1e-9 * norm.maxCoeff();
    for (Index l = 0; l < used_lines; ++l)
      if (norm(l) > rounding)
        x.col(l) /= norm(l);
      else
        x.col(l).setZero();
    result.push_back(std::move(x));
  }
  return result;
}

// How similar neighbouring lines are, compared with other lines. `rank`: the mean rank of neighbours among all lines,
// sorted by similarity, from 0 to 1. `deviation`: the difference between `rank` and 0.5, which is its mean over all
// orders of the lines, in standard deviations. `of_half`: the smaller deviation of the pairs 0-1, 2-3, … and the pairs
// 1-2, 3-4, …
struct Neighbours {
  double rank = 0.5, deviation = 0.0, of_half = 0.0;
};

// The difference between the mean rank and 0.5, in standard deviations. Ranks are uniform between 0 and 1, with
// variance 1/12. Each pair of neighbours has two ranks, which are nearly equal and count as one.
double deviation(double sum, Index ranks) {
  return ranks > 0 ? (sum / double(ranks) - 0.5) * std::sqrt(12 * double(ranks) / 2) : 0.0;
}

Neighbours neighbours(const Matrix& likeness, const std::vector<bool>& live) {
  std::array<double, 2> sum{};
  std::array<Index, 2> ranks{};
  for (Index i = 0; i + 1 < likeness.rows(); ++i)
    for (const auto& [line, next] : {std::pair(i, i + 1), std::pair(i + 1, i)}) {
      double less = 0.0;
      Index others = 0;
      for (Index j = 0; j < likeness.rows(); ++j) {
        if (std::abs(j - line) <= 1 || !live[size_t(j)]) continue;
        ++others;
        less += likeness(line, j) < likeness(line, next) ? 1.0 : likeness(line, j) == likeness(line, next) ? 0.5 : 0.0;
      }
      if (!live[size_t(line)] || !live[size_t(next)] || others < 3) continue;
      sum[size_t(i % 2)] += less / double(others);
      ++ranks[size_t(i % 2)];
    }
  const double all = sum[0] + sum[1];
  const Index count = ranks[0] + ranks[1];
  if (count < 8) return {};
  return {all / double(count), deviation(all, count),
          std::min(deviation(sum[0], ranks[0]), deviation(sum[1], ranks[1]))};
}

// Takes the better of two measures of similarity. Squared products find outputs that depend on the step before with any
// sign. Signed products find slow signals, which keep their sign.
Neighbours neighbours(const Lines& lines) {
  const Index count = lines.front().cols();
  if (count < fewest_lines || lines.front().rows() < fewest_positions) return {};
  Matrix related = Matrix::Zero(count, count), alike_by_sign = related;
  for (size_t a = 0; a < lines.size(); ++a)
    for (size_t b = 0; b < lines.size(); ++b) {
      const Matrix products = lines[a].transpose() * lines[b];
      related += products.cwiseAbs2();
      if (a == b) alike_by_sign += products;
    }
  std::vector<bool> live;
  for (Index l = 0; l < count; ++l) live.push_back(alike_by_sign(l, l) > 0.5);
  const Neighbours any = neighbours(related + related.transpose(), live), same = neighbours(alike_by_sign, live);
  return any.deviation > same.deviation ? any : same;
}

// Are the axes (T, N, channels)? If so, neighbouring experiments are similar, but neighbouring steps are not.
bool is_time_along_experiments(const Ensemble& e) {
  std::vector<Index> channels;
  for (Index i = 0; i < std::min(e.inputs(), most_inputs); ++i) channels.push_back(i);
  for (Index j = 0; j < std::min(e.outputs(), most_outputs); ++j) channels.push_back(e.inputs() + j);
  const Index d = e.channels();
  const Neighbours experiments = neighbours(lines_of(
      e.experiments(), e.steps(), channels, [&](Index n, Index k, Index c) { return e.samples()(n, k * d + c); }));
  if (experiments.deviation < alike || experiments.of_half < alike_by_halves) return false;
  const Neighbours steps = neighbours(lines_of(e.steps(), e.experiments(), channels,
                                               [&](Index k, Index n, Index c) { return e.samples()(n, k * d + c); }));
  return steps.deviation < unlike && steps.rank < mostly_unlike;
}

}  // namespace

std::optional<Finding> swapped_axes(const Ensemble& e) {
  const Index N = e.experiments(), T = e.steps(), r = e.inputs(), m = e.outputs();
  if (N == 0 || T == 0) return std::nullopt;
  const bool channels_alike = m == 0 || r == m;
  const auto found = [&](Finding::Kind kind) {
    return Finding{
        .kind = kind,
        .numbers = {{"experiments", double(N)}, {"steps", double(T)}, {"inputs", double(r)}, {"outputs", double(m)}}};
  };
  if (N == 1 && r > T && channels_alike) return found(Finding::Kind::axes_of_one_experiment);
  if (T == 1 && N >= shortest_record) return found(Finding::Kind::axes_of_one_step);
  if (r > T && channels_alike) return found(Finding::Kind::axes_channels_before_time);
  if (is_time_along_experiments(e)) return found(Finding::Kind::axes_time_before_experiments);
  return std::nullopt;
}

}  // namespace tokid
