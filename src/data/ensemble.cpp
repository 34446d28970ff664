// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/ensemble.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <stdexcept>

#include "base/integers.hpp"
#include "base/large_pages.hpp"
#include "base/statistics.hpp"
#include "base/words.hpp"
#include "data/experiment_names.hpp"

namespace tokid {

namespace {

std::string channel_name(const std::vector<std::string>& names, char prefix, Index i) {
  return static_cast<size_t>(i) < names.size() ? names[static_cast<size_t>(i)] : fmt::format("{}{}", prefix, i + 1);
}

}  // namespace

const char* to_string(InitialState state) { return state == InitialState::zero ? "zero" : "unknown"; }

InitialState initial_state_from(const std::string& text) {
  if (text == "zero") return InitialState::zero;
  if (text == "unknown") return InitialState::unknown;
  throw std::invalid_argument(fmt::format("initial_state: \"{}\" found, \"zero\" or \"unknown\" needed", text));
}

std::string Channels::input(Index i) const { return channel_name(input_names, 'u', i); }
std::string Channels::output(Index j) const { return channel_name(output_names, 'y', j); }

Channels complete(const Channels& names, Index inputs, Index outputs) {
  Channels result{{}, {}, names.input_units, names.output_units};
  for (Index i = 0; i < inputs; ++i) result.input_names.push_back(names.input(i));
  for (Index j = 0; j < outputs; ++j) result.output_names.push_back(names.output(j));
  result.input_units.resize(size_t(inputs));
  result.output_units.resize(size_t(outputs));
  return result;
}

FreeResponse complete(const FreeResponse& free) {
  FreeResponse kept{0, free.steps, Matrix(free.y.rows(), free.y.cols())};
  for (Index n = 0; n < free.experiments; ++n)
    if (free.y.row(n).allFinite()) kept.y.row(kept.experiments++) = free.y.row(n);
  kept.y.conservativeResize(kept.experiments, Eigen::NoChange);
  return kept;
}

Ensemble::Ensemble(Index experiments, Index steps, Index inputs, Index outputs, double sample_time, Samples samples)
    : dt(sample_time), steps_(steps), inputs_(inputs), outputs_(outputs) {
  if (experiments < 0 || steps < 0 || inputs < 0 || outputs < 0 || inputs + outputs == 0)
    throw std::invalid_argument(fmt::format("ensemble: {} experiments x {} steps with {} inputs and {} outputs",
                                            experiments, steps, inputs, outputs));
  if (!(sample_time > 0) || !std::isfinite(sample_time))
    throw std::invalid_argument(fmt::format("dt: {} found, a positive time in seconds needed", sample_time));
  samples_.resize(experiments, steps * (inputs + outputs));
  prefer_large_pages(samples_.data(), size_t(samples_.size()) * sizeof(double));
  if (samples == Samples::missing) samples_.setConstant(std::numeric_limits<double>::quiet_NaN());
}

Index Ensemble::missing() const {
  Index count = 0;
  // The sum is NaN if a sample is missing. Other columns need no count.
  for (Index c = 0; c < samples_.cols(); ++c)
    if (const auto column = samples_.col(c).array(); (0.0 * column).sum() != 0) count += column.isNaN().count();
  return count;
}

Matrix Ensemble::inputs_of(Index n) const {
  Matrix u(steps_, inputs_);
  for (Index k = 0; k < steps_; ++k) u.row(k) = input(k).row(n);
  return u;
}

Matrix Ensemble::outputs_of(Index n) const {
  Matrix y(steps_, outputs_);
  for (Index k = 0; k < steps_; ++k) y.row(k) = output(k).row(n);
  return y;
}

std::vector<Index> Ensemble::complete_rows(Index k, Index p) const {
  const auto block = window_and_output(k, p);
  // The sum over a row is NaN if a sample of the row is missing.
  Vector sum = Vector::Zero(experiments());
  for (Index c = 0; c < block.cols(); ++c) sum += 0.0 * block.col(c);
  std::vector<Index> rows;
  rows.reserve(static_cast<size_t>(experiments()));
  for (Index n = 0; n < experiments(); ++n)
    if (!std::isnan(sum(n))) rows.push_back(n);
  return rows;
}

Ensemble Ensemble::subset(const std::vector<Index>& chosen) const {
  Ensemble result;
  result.steps_ = steps_;
  result.inputs_ = inputs_;
  result.outputs_ = outputs_;
  result.samples_ = samples_(chosen, Eigen::all);
  result.dt = dt;
  result.dt_stated = dt_stated;
  result.names = names;
  result.initial_state = initial_state;
  if (!length.empty())
    for (const Index n : chosen) result.length.push_back(length[static_cast<size_t>(n)]);
  result.experiment_names = names_of_subset(experiment_names, chosen);
  result.free = free;
  return result;
}

namespace {

std::vector<std::string> chosen_of(const std::vector<std::string>& list, const std::vector<Index>& chosen) {
  std::vector<std::string> result;
  if (!list.empty())
    for (const Index c : chosen) result.push_back(list[size_t(c)]);
  return result;
}

// Positions of the wanted names among the names of the data; empty if a name is missing or occurs twice.
std::optional<std::vector<Index>> places_of(const std::vector<std::string>& wanted,
                                            const std::vector<std::string>& found) {
  std::vector<Index> places;
  for (const std::string& name : wanted) {
    const auto at = std::find(found.begin(), found.end(), name);
    if (at == found.end() || std::find(at + 1, found.end(), name) != found.end()) return std::nullopt;
    places.push_back(at - found.begin());
  }
  return places;
}

}  // namespace

Ensemble Ensemble::select(const std::vector<Index>& inputs, const std::vector<Index>& outputs) const {
  Ensemble result(experiments(), steps_, Index(inputs.size()), Index(outputs.size()), dt, Samples::unset);
  for (Index k = 0; k < steps_; ++k) {
    for (size_t i = 0; i < inputs.size(); ++i) result.input(k).col(Index(i)) = input(k).col(inputs[i]);
    for (size_t j = 0; j < outputs.size(); ++j) result.output(k).col(Index(j)) = output(k).col(outputs[j]);
  }
  result.names = {chosen_of(names.input_names, inputs), chosen_of(names.output_names, outputs),
                  chosen_of(names.input_units, inputs), chosen_of(names.output_units, outputs)};
  result.dt_stated = dt_stated;
  result.remarks = remarks;
  result.initial_state = initial_state;
  result.length = length;
  result.experiment_names = experiment_names;
  if (free.experiments > 0) {
    result.free = {free.experiments, free.steps, Matrix(free.experiments, free.steps * Index(outputs.size()))};
    for (Index k = 0; k < free.steps; ++k)
      for (size_t j = 0; j < outputs.size(); ++j)
        result.free.y.col(k * Index(outputs.size()) + Index(j)) = free.y.col(k * outputs_ + outputs[j]);
  }
  return result;
}

std::optional<Ensemble> in_order(const Ensemble& e, const Channels& wanted) {
  const auto unnamed = [](const Channels& names) { return names.input_names.empty() && names.output_names.empty(); };
  if (unnamed(e.names) || unnamed(wanted)) return std::nullopt;
  const Channels found = complete(e.names, e.inputs(), e.outputs());
  const auto inputs = places_of(wanted.input_names, found.input_names);
  const auto outputs =
      e.outputs() > 0 ? places_of(wanted.output_names, found.output_names) : std::optional(std::vector<Index>());
  if (!inputs || !outputs || (*inputs == range(0, e.inputs()) && *outputs == range(0, e.outputs())))
    return std::nullopt;
  return e.select(*inputs, *outputs);
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

std::string Ensemble::experiment_label(Index n) const {
  const std::string name = experiment_name(n);
  return name.empty() ? std::to_string(n) : name;
}

std::string Ensemble::experiment(Index n) const { return words::experiment(n, experiment_name(n)); }

void share_phases(Nominal& nominal, Index period) {
  for (Matrix* motion : {&nominal.u, &nominal.y})
    for (Index phase = 0; phase < std::min(period, motion->rows()); ++phase)
      for (Index c = 0; c < motion->cols(); ++c) {
        double mean = 0.0;  // updated step by step, to keep constant values exact
        Index count = 0;
        for (Index k = phase; k < motion->rows(); k += period)
          if (const double value = (*motion)(k, c); !std::isnan(value)) mean += (value - mean) / double(++count);
        for (Index k = phase; k < motion->rows(); k += period) (*motion)(k, c) = mean;
      }
}

Split split(const Ensemble& ensemble, double fraction, Index period) {
  const Index total = ensemble.experiments();
  if (!(fraction > 0 && fraction < 1))
    throw std::invalid_argument(fmt::format("hold-out fraction: {} found, between 0 and 1 needed", fraction));
  if (total == 1 && period > 0) {
    const Index steps = ensemble.steps(), kept = Index(std::ceil(double(steps) * (1 - fraction)));
    const Index begin = kept / period * period;
    if (begin < 1 || begin >= steps)
      throw std::invalid_argument(fmt::format(
          "hold-out fraction: {} of {} steps leaves {} steps to identify with: leave at least one period, and hold out at least one step",
          fraction, steps, begin));
    return {stretch(ensemble, 0, begin), stretch(ensemble, begin, steps), {0}};
  }
  const Index held = static_cast<Index>(std::llround(fraction * double(total)));
  if (held < 1 || held >= total)
    throw std::invalid_argument(fmt::format(
        "hold-out fraction: {} of {} experiments leaves one part empty: choose a fraction that leaves at least one experiment in each part",
        fraction, total));
  std::vector<Index> training, held_out;
  // Bresenham's method spreads `held` experiments evenly over `total`.
  for (Index n = 0; n < total; ++n) ((n + 1) * held / total > n * held / total ? held_out : training).push_back(n);
  return {ensemble.subset(training), ensemble.subset(held_out), held_out};
}

namespace {

struct Moments {
  double mean = 0.0, variance = 0.0;
  Index count = 0;
};

// Moments of the samples that are not missing. Two passes avoid cancellation.
Moments moments(const Eigen::Ref<const Vector>& x) {
  Moments m;
  const auto first = std::find_if(x.begin(), x.end(), [](double v) { return !std::isnan(v); });
  if (first == x.end()) return m;
  // The mean of the differences from the first sample is exact if the channel is constant. A rounding error of the mean
  // would look like motion.
  for (const double v : x)
    if (!std::isnan(v)) m.mean += v - *first, ++m.count;
  m.mean = *first + m.mean / double(m.count);
  for (const double v : x)
    if (!std::isnan(v)) m.variance += (v - m.mean) * (v - m.mean);
  m.variance = m.count > 1 ? m.variance / double(m.count - 1) : 0.0;
  return m;
}

}  // namespace

Ensemble stretch(const Ensemble& e, Index begin, Index end) {
  if (begin < 0 || begin >= end || end > e.steps())
    throw std::invalid_argument(
        fmt::format("stretch: steps {} to {} asked for, the ensemble has {}", begin, end - 1, e.steps()));
  Ensemble part(e.experiments(), end - begin, e.inputs(), e.outputs(), e.dt);
  for (Index k = begin; k < end; ++k) {
    part.input(k - begin) = e.input(k);
    part.output(k - begin) = e.output(k);
  }
  part.dt_stated = e.dt_stated;
  part.names = e.names;
  part.experiment_names = e.experiment_names;
  part.initial_state = begin == 0 ? e.initial_state : InitialState::unknown;
  for (const Index length : e.length) part.length.push_back(std::clamp<Index>(length - begin, 0, end - begin));
  return part;
}

Ensemble cut(const Ensemble& e, Index length) {
  if (length < 1 || length > e.steps())
    throw std::invalid_argument(fmt::format("cut: length {} found, 1 to {} needed", length, e.steps()));
  const Index pieces = e.steps() / length;
  Ensemble all(pieces * e.experiments(), length, e.inputs(), e.outputs(), e.dt);
  for (Index piece = 0; piece < pieces; ++piece)
    for (Index k = 0; k < length; ++k) {
      all.input(k).middleRows(piece * e.experiments(), e.experiments()) = e.input(piece * length + k);
      all.output(k).middleRows(piece * e.experiments(), e.experiments()) = e.output(piece * length + k);
    }
  all.dt_stated = e.dt_stated;
  all.names = e.names;
  if (!e.experiment_names.empty())
    for (Index piece = 0; piece < pieces; ++piece)
      for (const std::string& name : e.experiment_names)
        all.experiment_names.push_back(fmt::format("{} from step {} on", name, piece * length));
  all.initial_state = InitialState::unknown;
  return all;
}

Nominal nominal_trajectory(const Ensemble& e) {
  Nominal nominal{Matrix(e.steps(), e.inputs()), Matrix(e.steps(), e.outputs())};
  for (Index k = 0; k < e.steps(); ++k) {
    for (Index i = 0; i < e.inputs(); ++i) nominal.u(k, i) = moments(e.input(k).col(i)).mean;
    for (Index j = 0; j < e.outputs(); ++j) nominal.y(k, j) = moments(e.output(k).col(j)).mean;
  }
  return nominal;
}

Ensemble departures(Ensemble ensemble, const Nominal& nominal) {
  for (Index k = 0; k < ensemble.steps(); ++k) {
    ensemble.input(k).rowwise() -= nominal.u.row(k);
    ensemble.output(k).rowwise() -= nominal.y.row(k);
  }
  return ensemble;
}

FreeResponse free_departures(const FreeResponse& free) {
  if (free.experiments < 2) return {};
  FreeResponse result = complete(free);
  result.y.rowwise() -= Eigen::RowVectorXd(result.y.colwise().mean());
  return result;
}

NominalTest test_nominal(const Ensemble& e) {
  constexpr double error = 0.001 / 2;  // false-alarm probability of each of the two tests
  NominalTest test;
  if (e.experiments() < 2) return test;
  const Index samples = e.steps() * e.channels();
  std::map<Index, double> bounds;  // number of samples of a step → bound of t², the squared t statistic
  const auto bound = [&](Index count) {
    const auto [found, added] = bounds.try_emplace(count, 0.0);
    if (added) found->second = statistics::f_quantile(1 - error / double(samples), 1.0, double(count - 1));
    return found->second;
  };
  double sum = 0.0;
  std::vector<Moments> step(static_cast<size_t>(e.steps()));
  for (Index c = 0; c < e.channels(); ++c) {
    double square = 0.0, squares = 0.0, freedom = 0.0;
    for (Index k = 0; k < e.steps(); ++k) {
      Moments& m = step[static_cast<size_t>(k)] = moments(e.samples().col(k * e.channels() + c));
      square = std::max(square, m.mean * m.mean + m.variance);
      if (m.count < 2) continue;
      squares += double(m.count - 1) * m.variance;
      freedom += double(m.count - 1);
    }
    if (freedom == 0) continue;
    // A variance or a mean at rounding level counts as zero. The variance of one step may be small by chance, for
    // example if a few binary inputs are equal. The mean variance over the steps is therefore the least variance that
    // is used.
    const double floor = 1e-24 * square, least = std::max(floor, squares / freedom);
    NominalTest::Departure departure{c, {}};
    for (Index k = 0; k < e.steps(); ++k) {
      const Moments& m = step[static_cast<size_t>(k)];
      if (m.count < 2 || m.mean * m.mean <= floor) continue;
      const double t2 = double(m.count) * m.mean * m.mean / std::max(m.variance, least), limit = bound(m.count);
      sum += t2;
      if (t2 > limit) departure.steps.push_back(k);
      if (t2 * test.step_threshold >= test.step_statistic * limit)
        test.step_statistic = t2, test.step_threshold = limit;
    }
    if (!departure.steps.empty()) test.departures.push_back(std::move(departure));
  }
  test.statistic = sum / double(samples);
  test.threshold = statistics::f_quantile(1 - error, 1.0, double(e.experiments() - 1));
  test.significant = test.statistic > test.threshold || !test.departures.empty();
  return test;
}

}  // namespace tokid
