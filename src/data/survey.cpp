// SPDX-License-Identifier: BSD-3-Clause
#include "data/survey.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <stdexcept>
#include <string>
#include <utility>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "data/canonical.hpp"
#include "data/extents.hpp"
#include "data/scales.hpp"
#include "data/subjects.hpp"

namespace tokid {

namespace {

// "input u1", "output y2" of channel c, inputs first.
std::string channel_name(const Channels& names, Index inputs, Index c) {
  return c < inputs ? "input " + names.input(c) : "output " + names.output(c - inputs);
}

}  // namespace

std::string infinite_sample(const Channels& names, Index inputs, Index c, const std::string& experiment, Index k) {
  return fmt::format("{}: infinite value in experiment {} at step {}, finite or missing (NaN) needed",
                     channel_name(names, inputs, c), experiment, k);
}

void Survey::append(const Survey& later, Index begin) {
  if (channel.empty()) {
    channel.resize(later.channel.size());
    zero.resize(later.zero.size());
    same.resize(later.same.size());
    alone.resize(later.alone.size());
    absent.resize(later.absent.size());
  }
  for (size_t c = 0; c < channel.size(); ++c) {
    channel[c].present += later.channel[c].present;
    channel[c].min = std::min(channel[c].min, later.channel[c].min);
    channel[c].max = std::max(channel[c].max, later.channel[c].max);
  }
  for (size_t i = 0; i < zero.size(); ++i) {
    for (const Index k : later.zero[i]) zero[i].push_back(begin + k);
    for (const Index k : later.same[i]) same[i].push_back(begin + k);
    for (const Index k : later.alone[i]) alone[i].push_back(begin + k);
  }
  for (size_t c = 0; c < absent.size(); ++c)
    for (const Index k : later.absent[c]) absent[c].push_back(begin + k);
  missing += later.missing;
}

Survey survey(const Ensemble& e, Index begin, Index end, Index origin) {
  const Index d = e.channels();
  Survey result;
  result.channel.resize(size_t(d));
  result.zero.resize(size_t(e.inputs()));
  result.same.resize(size_t(e.inputs()));
  result.alone.resize(size_t(e.inputs()));
  result.absent.resize(size_t(d));
  Index absent = 0;
  for (Index k = begin; k < end; ++k)
    for (Index c = 0; c < d; ++c) {
      const auto column = e.samples().col(k * d + c);
      ChannelRange& range = result.channel[size_t(c)];
      Index present = column.size();
      double least = 0.0, most = 0.0;
      if ((0.0 * column.array()).sum() == 0.0) {  // neither NaN nor infinite
        least = column.minCoeff();
        most = column.maxCoeff();
      } else {
        for (Index n = 0; n < column.size(); ++n)
          if (std::isinf(column(n)))
            throw std::invalid_argument(infinite_sample(e.names, e.inputs(), c, e.experiment(n), origin + k));
        present = (column.array() == column.array()).count();
        least = column.minCoeff<Eigen::PropagateNumbers>();
        most = column.maxCoeff<Eigen::PropagateNumbers>();
      }
      absent += column.size() - present;
      range.present += present;
      if (present == 0) {
        result.absent[size_t(c)].push_back(k - begin);
        continue;
      }
      range.min = std::min(range.min, least);
      range.max = std::max(range.max, most);
      if (c < e.inputs() && spread_above_rounding(most - least, std::max(most, -least)) == 0) {
        const bool alone = present == 1 && column.size() > 1;
        (least == 0 ? result.zero : alone ? result.alone : result.same)[size_t(c)].push_back(k - begin);
      }
    }
  Index beyond = 0;
  for (const Index length : e.length) beyond += end - std::clamp(length, begin, end);
  result.missing = absent - beyond * d;
  return result;
}

void check_presence(const Survey& survey, const Channels& names, Index inputs, Index samples) {
  for (size_t c = 0; c < survey.channel.size(); ++c)
    if (survey.channel[c].present == 0)
      throw std::invalid_argument(fmt::format("{}: all {} samples are missing (NaN), at least one needed",
                                              channel_name(names, inputs, Index(c)), samples));
}

void check_magnitudes(const Survey& survey, const Channels& names, Index inputs) {
  constexpr double largest = 1e60, smallest = 1e-60;
  for (size_t c = 0; c < survey.channel.size(); ++c) {
    const ChannelRange& range = survey.channel[c];
    const double magnitude = range.present > 0 ? std::max(std::abs(range.min), std::abs(range.max)) : 0.0;
    if (magnitude > largest || (magnitude > 0 && magnitude < smallest))
      throw std::invalid_argument(
          fmt::format("{}: values up to {:.3g} found, {:.0e} to {:.0e} can be handled: choose another unit",
                      channel_name(names, inputs, Index(c)), magnitude, smallest, largest));
  }
}

Findings findings_of_inputs(const Survey& survey, const Channels& names) {
  Findings result;
  const auto add = [&](Finding::Kind kind, size_t i, const std::vector<Index>& steps,
                       std::map<std::string, double> numbers = {}) {
    if (!steps.empty())
      result.push_back(
          {.kind = kind, .channels = {input_channel(names, Index(i))}, .steps = steps, .numbers = std::move(numbers)});
  };
  for (size_t i = 0; i < survey.zero.size(); ++i) {
    add(Finding::Kind::input_zero, i, survey.zero[i]);
    add(Finding::Kind::input_same, i, survey.same[i]);
    add(Finding::Kind::input_same, i, survey.alone[i], {{"experiments", 1.0}});
  }
  return result;
}

Findings findings_of_inputs(const Survey& survey, const Channels& names, Index period, Index steps) {
  Findings result;
  for (size_t i = 0; i < survey.zero.size(); ++i) {
    const Finding::Channel input = input_channel(names, Index(i));
    if (const ChannelRange& range = survey.channel[i]; range.present > 0 && range.min == range.max) {
      result.push_back(
          {.kind = range.min == 0 ? Finding::Kind::input_zero_throughout : Finding::Kind::input_constant_throughout,
           .channels = {input}});
      continue;
    }
    std::vector<Index> zero_steps(size_t(period), 0), phases;
    for (const auto* nothing : {&survey.zero[i], &survey.absent[i]})
      for (const Index k : *nothing) ++zero_steps[size_t(k % period)];
    for (Index phase = 0; phase < std::min(period, steps); ++phase)
      if (zero_steps[size_t(phase)] == (steps - phase + period - 1) / period) phases.push_back(phase);
    if (!phases.empty())
      result.push_back({.kind = Finding::Kind::input_zero_at_phases, .channels = {input}, .steps = phases});
  }
  return result;
}

Findings findings_of_outputs(const Survey& survey, const Channels& names) {
  Findings result;
  const size_t inputs = survey.zero.size();
  for (size_t c = inputs; c < survey.channel.size(); ++c)
    if (const ChannelRange& range = survey.channel[c]; range.present > 0 && range.min == range.max)
      result.push_back(
          {.kind = Finding::Kind::output_constant, .channels = {output_channel(names, Index(c - inputs))}});
  return result;
}

Findings findings_of_absence(const Survey& survey, const Channels& names) {
  std::map<std::vector<Index>, std::vector<Finding::Channel>> channels;
  for (size_t c = 0; c < survey.absent.size(); ++c)
    if (!survey.absent[c].empty())
      channels[survey.absent[c]].push_back(channel(names, Index(survey.zero.size()), Index(c)));
  Findings result;
  for (const auto& [steps, missing] : channels)
    result.push_back({.kind = Finding::Kind::samples_missing, .channels = missing, .steps = steps});
  return result;
}

Findings findings_of_overlap(const Ensemble& e) {
  std::vector<Extent> all = extents(e);
  std::replace_if(
      all.begin(), all.end(), [](auto& own) { return own.begin == own.end; }, Extent{0, e.steps()});
  const auto late = std::max_element(all.begin(), all.end(), [](auto& a, auto& b) { return a.begin < b.begin; });
  const auto early = std::min_element(all.begin(), all.end(), [](auto& a, auto& b) { return a.end < b.end; });
  if (all.empty() || late->begin < early->end) return {};
  return {{.kind = Finding::Kind::experiments_without_overlap,
           .experiments = {experiment(e, late - all.begin()), experiment(e, early - all.begin())},
           .steps = {late->begin, early->end - 1}}};
}

std::uint64_t digest(const Ensemble& e, Index k) {
  const auto samples = e.samples().middleCols(k * e.channels(), e.channels()).reshaped();
  XXH3_state_t state;
  XXH3_64bits_reset(&state);
  std::array<double, 512> piece = {};
  for (Index begin = 0; begin < samples.size(); begin += Index(piece.size())) {
    const Index count = std::min(Index(piece.size()), samples.size() - begin);
    copy_canonical(samples.data() + begin, count, piece.data());
    XXH3_64bits_update(&state, piece.data(), size_t(count) * sizeof(double));
  }
  return XXH3_64bits_digest(&state);
}

std::string fingerprint(Index experiments, Index inputs, Index outputs, const std::vector<std::uint64_t>& digests) {
  XXH3_state_t state;
  XXH3_64bits_reset(&state);
  const std::int64_t shape[] = {experiments, std::int64_t(digests.size()), inputs, outputs};
  XXH3_64bits_update(&state, shape, sizeof(shape));
  XXH3_64bits_update(&state, digests.data(), digests.size() * sizeof(std::uint64_t));
  return fmt::format("{:016x}", XXH3_64bits_digest(&state));
}

std::string fingerprint(const Ensemble& e) {
  std::vector<std::uint64_t> digests;
  for (Index k = 0; k < e.steps(); ++k) digests.push_back(digest(e, k));
  return fingerprint(e.experiments(), e.inputs(), e.outputs(), digests);
}

}  // namespace tokid
