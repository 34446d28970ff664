// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/corrections.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <stdexcept>
#include <utility>

namespace tokid {

Corrected corrected(const Ensemble& ensemble, const Corrections& corrections) {
  std::map<std::string, double> weight;
  for (const Corrections::Experiment& e : corrections.experiments) weight.emplace(e.label, e.weight);
  Corrected result;
  std::vector<double> weights;
  std::map<std::string, Index> row;  // among the experiments that remain
  for (Index n = 0; n < ensemble.experiments(); ++n) {
    const std::string label = ensemble.experiment_label(n);
    const auto found = weight.find(label);
    if (found != weight.end() && found->second == 0) continue;
    row.emplace(label, Index(result.rows.size()));
    result.rows.push_back(n);
    weights.push_back(found == weight.end() ? 1.0 : found->second);
  }
  const bool all = Index(result.rows.size()) == ensemble.experiments();
  result.data = all ? ensemble : ensemble.subset(result.rows);
  for (const Corrections::Sample& s : corrections.samples)
    if (const auto at = row.find(s.label);
        at != row.end() && s.step < ensemble.steps() && s.output < ensemble.outputs())
      result.data.y(at->second, s.step, s.output) = s.value;
  result.weights = Eigen::Map<const Vector>(weights.data(), Index(weights.size()));
  return result;
}

Corrected corrected(const Ensemble& ensemble, const std::vector<Index>& rows, const Corrections& corrections) {
  Corrected result = corrected(ensemble.subset(rows), corrections);
  for (Index& n : result.rows) n = rows[size_t(n)];
  return result;
}

Nominal weighted_nominal(const Ensemble& data, const Vector& weights) {
  Nominal nominal{Matrix(data.steps(), data.inputs()), Matrix(data.steps(), data.outputs())};
  const auto mean = [&](const auto& samples) {
    double result = 0.0, total = 0.0;  // keeps constant values exact
    for (Index n = 0; n < samples.size(); ++n)
      if (!std::isnan(samples(n)) && weights(n) > 0) {
        total += weights(n);
        result += (samples(n) - result) * (weights(n) / total);
      }
    return result;
  };
  for (Index k = 0; k < data.steps(); ++k) {
    for (Index i = 0; i < data.inputs(); ++i) nominal.u(k, i) = mean(data.input(k).col(i));
    for (Index j = 0; j < data.outputs(); ++j) nominal.y(k, j) = mean(data.output(k).col(j));
  }
  return nominal;
}

Ensemble weighted(Ensemble data, const Vector& weights) {
  if (weights.size() != data.experiments() || !(weights.array() >= 0).all())
    throw std::invalid_argument(
        fmt::format("weights: {} found, {} needed, all 0 or more", weights.size(), data.experiments()));
  const Vector roots = weights.cwiseSqrt();
  for (Index k = 0; k < data.steps(); ++k) {
    data.input(k) = roots.asDiagonal() * data.input(k);
    data.output(k) = roots.asDiagonal() * data.output(k);
  }
  if (data.free.experiments > 0 && weights.size() > 0) data.free.y *= std::sqrt(weights.mean());
  return data;
}

}  // namespace tokid
