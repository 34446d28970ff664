// SPDX-License-Identifier: BSD-3-Clause
#include "identify/prepare.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <utility>

#include "choose/constant.hpp"
#include "choose/input_delays.hpp"
#include "choose/regression.hpp"
#include "data/content_order.hpp"
#include "model/input_delays.hpp"
#include "tokid/corrections.hpp"

namespace tokid {

namespace {

// Steps that share a model also share one mean motion. Each step is therefore replaced by its phase.
void count_in_phases(NominalTest& test, Index period) {
  for (NominalTest::Departure& departure : test.departures) {
    std::vector<Index>& steps = departure.steps;
    for (Index& k : steps) k %= period;
    std::sort(steps.begin(), steps.end());
    steps.erase(std::unique(steps.begin(), steps.end()), steps.end());
  }
}

// A model explains only the response to the inputs and to a state. Is there a significant mean motion, which must be
// removed first?
bool removes_nominal(const Ensemble& measured, const IdentifyOptions& options, NominalTest& test) {
  if (options.nominal) return *options.nominal != NominalChoice::none;
  test = test_nominal(options.period > 0 ? *selection_samples(measured, options).samples : measured);
  if (options.period > 0) count_in_phases(test, options.period);
  if (options.period == 1) {
    const Constant constant = test_constant(in_units(measured, units_of(measured)));
    test.constant_statistic = constant.statistic;
    test.constant_threshold = constant.threshold;
    test.significant = test.significant || constant.significant();
  }
  return test.significant;
}

void remove_nominal(const Vector& weights, Index period, Prepared& result) {
  Ensemble& data = result.data;
  if (data.experiments() < 2 && period == 0)
    throw std::invalid_argument("nominal: one experiment equals its own mean motion, at least 2 experiments needed");
  result.nominal = weights.minCoeff() < 1 ? weighted_nominal(data, weights) : nominal_trajectory(data);
  if (period > 0) share_phases(*result.nominal, period);
  data = departures(std::move(data), *result.nominal);
  if (data.free.experiments == 1) result.findings.push_back({.kind = Finding::Kind::free_response_single});
  data.free = free_departures(data.free);
}

// The mean of a record that starts far from rest is not the point of rest. One model for all steps has no constant, so
// departures are those from rest.
void move_to_rest(Prepared& result) {
  const Units units = units_of(result.data);
  const Constant constant = test_constant(in_units(result.data, units));
  if (!constant.significant()) return;
  const Eigen::RowVectorXd at_rest = constant.at_rest.cwiseProduct(units.output).transpose();
  for (Index k = 0; k < result.data.steps(); ++k) result.data.output(k).rowwise() -= at_rest;
  result.nominal->y.rowwise() += at_rest;
}

// Those that are stated, or are found.
std::vector<Index> delays_of(const Ensemble& departures, const IdentifyOptions& options) {
  if (!options.choices && !options.delays) {
    const bool stated = options.lags || options.states || options.method == Method::tvera;
    return stated ? std::vector<Index>{}
                  : find_delays(*selection_samples(departures, options).samples, options.execution);
  }
  const std::vector<Index>& delays = options.choices ? options.choices->delays : *options.delays;
  if (delays.empty()) return {};
  if (Index(delays.size()) != departures.inputs())
    throw std::invalid_argument(
        fmt::format("delays: {} found, {} needed, one for each input", delays.size(), departures.inputs()));
  for (const Index delay : delays)
    if (delay < 0 || delay >= departures.steps())
      throw std::invalid_argument(fmt::format("delays: {} steps found, from 0 to {} needed in data of {} steps", delay,
                                              departures.steps() - 1, departures.steps()));
  return held_inputs(delays) > 0 ? delays : std::vector<Index>{};
}

}  // namespace

Prepared prepare(const Ensemble& measured, const Vector& measured_weights, const IdentifyOptions& options) {
  const std::vector<Index> order = content_order(measured);
  const Vector weights = measured_weights(order);
  Prepared result;
  result.data = measured.subset(order);
  if (removes_nominal(result.data, options, result.nominal_test)) {
    remove_nominal(weights, options.period, result);
    if (options.period == 1 && !options.nominal) move_to_rest(result);
  }
  if (weights.minCoeff() < 1) result.data = weighted(std::move(result.data), weights);
  result.units = units_of(result.data);
  result.data = in_units(std::move(result.data), result.units);
  result.delays = delays_of(result.data, options);
  if (!result.delays.empty()) result.data = delayed(std::move(result.data), result.delays);
  return result;
}

}  // namespace tokid
