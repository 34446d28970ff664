// SPDX-License-Identifier: BSD-3-Clause
#include "data/check.hpp"

#include <fmt/format.h>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string_view>
#include <unordered_map>
#include <utility>

#include "base/words.hpp"
#include "data/experiment_names.hpp"

namespace tokid {

namespace {

void check_names(const std::vector<std::string>& names, const char* what) {
  std::unordered_map<std::string_view, size_t> places;
  for (size_t i = 0; i < names.size(); ++i)
    if (const auto [first, is_new] = places.try_emplace(names[i], i); !is_new && !names[i].empty())
      throw std::invalid_argument(fmt::format("{}: \"{}\" found for the channels {} and {}, different names needed",
                                              what, words::quoted(names[i]), first->second + 1, i + 1));
}

void check_count(const std::vector<std::string>& list, const char* what, Index channels) {
  if (!list.empty() && static_cast<Index>(list.size()) != channels)
    throw std::invalid_argument(
        fmt::format("{}: {} found, {} needed, one for each channel", what, list.size(), channels));
}

void check_length(const Ensemble& e, const std::vector<Index>& length) {
  if (!length.empty() && static_cast<Index>(length.size()) != e.experiments())
    throw std::invalid_argument(
        fmt::format("length: {} entries found, {} needed, one for each experiment", length.size(), e.experiments()));
  for (const Index l : length)
    if (l < 0 || l > e.steps())
      throw std::invalid_argument(fmt::format("length: {} found, 0 to {} needed", l, e.steps()));
}

// NaN marks a missing sample. Infinite samples are not allowed.
void check_free_response(const FreeResponse& free, Index outputs) {
  if (free.experiments == 0) return;
  if (free.y.rows() != free.experiments || free.y.cols() != free.steps * outputs)
    throw std::invalid_argument(
        fmt::format("free_y: {} x {} samples found, {} experiments x {} steps x {} outputs needed", free.y.rows(),
                    free.y.cols(), free.experiments, free.steps, outputs));
  if (free.y.array().isInf().any()) throw std::invalid_argument("free_y: infinite value");
}

}  // namespace

void Ensemble::check(bool outputs_needed) const { checked(*this, outputs_needed); }

void check_names(const Channels& names, Index inputs, Index outputs) {
  check_count(names.input_names, "input_names", inputs);
  check_count(names.output_names, "output_names", outputs);
  check_count(names.input_units, "input_units", inputs);
  check_count(names.output_units, "output_units", outputs);
  check_names(names.input_names, "input_names");
  check_names(names.output_names, "output_names");
}

void check_samples(const Ensemble& e, bool with_outputs) {
  check_count(e.names.input_names, "input_names", e.inputs());
  check_count(e.names.input_units, "input_units", e.inputs());
  if (with_outputs) {
    check_count(e.names.output_names, "output_names", e.outputs());
    check_count(e.names.output_units, "output_units", e.outputs());
  }
  check_length(e, e.length);
  const Index checked = with_outputs ? e.channels() : e.inputs();
  for (Index k = 0; k < e.steps(); ++k)
    for (Index c = 0; c < checked; ++c) {
      const auto column = e.samples().col(k * e.channels() + c);
      if ((0.0 * column.array()).sum() == 0.0) continue;  // neither NaN nor infinite
      for (Index n = 0; n < column.size(); ++n)
        if (std::isinf(column(n)))
          throw std::invalid_argument(infinite_sample(e.names, e.inputs(), c, e.experiment(n), k));
    }
}

Survey checked(const Ensemble& e, bool outputs_needed) {
  if (!(e.dt > 0) || !std::isfinite(e.dt))
    throw std::invalid_argument(fmt::format("dt: {} found, a positive time in seconds needed", e.dt));
  if (e.experiments() == 0 || e.steps() == 0)
    throw std::invalid_argument(
        fmt::format("ensemble: {} experiments of {} steps found, at least one experiment of one step needed",
                    e.experiments(), e.steps()));
  check_names(e.names, e.inputs(), e.outputs());
  if (!e.experiment_names.empty() && Index(e.experiment_names.size()) != e.experiments())
    throw std::invalid_argument(fault_of_experiment_names(e.experiment_names, e.experiments()));
  check_length(e, e.length);

  Survey samples = survey(e, 0, e.steps());
  if (!outputs_needed) samples.channel.resize(size_t(e.inputs()));
  check_presence(samples, e.names, e.inputs(), e.experiments() * e.steps());
  check_free_response(e.free, e.outputs());
  return samples;
}

void set_length(Ensemble& ensemble, std::vector<Index> length) {
  const Index T = ensemble.steps(), d = ensemble.channels();
  check_length(ensemble, length);
  for (size_t n = 0; n < length.size(); ++n)
    ensemble.samples().row(Index(n)).tail((T - length[n]) * d).setConstant(std::numeric_limits<double>::quiet_NaN());
  ensemble.length = std::move(length);
}

}  // namespace tokid
