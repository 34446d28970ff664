// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>

#include "base/nan.hpp"
#include "base/random.hpp"
#include "base/statistics.hpp"
#include "base/words.hpp"
#include "data/check.hpp"
#include "tokid/gtv_arx.hpp"
#include "tokid/uncertainty.hpp"
#include "uncertainty/interval.hpp"

namespace tokid {

namespace {

constexpr Index batch = 64;  // number of replicates that are in memory at a time

void check_options(const BootstrapOptions& o) {
  uncertainty::check_level(o.level);
  if (o.replicates < 2)
    throw std::invalid_argument(fmt::format("replicates: {} found, at least 2 needed", o.replicates));
  if (!(o.spread > 0 && o.spread < 1))
    throw std::invalid_argument(fmt::format("spread: {} found, 0 < spread < 1 needed", o.spread));
  if (o.unknowns < 0) throw std::invalid_argument(fmt::format("unknowns: {} found, 0 or more needed", o.unknowns));
}

// Draws the weights 1 ± spread. Both signs are equally frequent, so that the mean weight is one.
Vector draw_weights(Index experiments, double spread, std::uint64_t seed) {
  RandomNumbers random(seed);
  const std::vector<Index> order = random.permutation(experiments);
  Vector weights(experiments);
  for (Index n = 0; n < experiments; ++n) weights(order[size_t(n)]) = n % 2 == 0 ? 1 + spread : 1 - spread;
  if (experiments % 2 == 1) weights(order.back()) = 1.0;
  return weights;
}

Model identified(const Ensemble& data, const Vector& weights, const Identifier& f, const BootstrapOptions& o) {
  if (!o.nominal) return f(weighted(data, weights));
  Nominal nominal = weighted_nominal(data, weights);
  if (o.period > 0) share_phases(nominal, o.period);
  Ensemble free_too = departures(data, nominal);
  if (free_too.free.experiments > 1) {
    free_too.free = complete(free_too.free);
    free_too.free.y.rowwise() -= Eigen::RowVectorXd(free_too.free.y.colwise().mean());
  }
  Model model = f(weighted(std::move(free_too), weights));
  model.u_nominal = nominal.u;
  model.y_nominal = nominal.y;
  return model;
}

Index median_unknowns(const Model& model) {
  if (!model.has(&Step::has_rank) || model.method != "tvera")
    return minimum_experiments(model.inputs, model.outputs, model.max_lags(), has_feedthrough(model.provenance));
  std::vector<Index> rank;
  for (const Step& step : model.step) rank.push_back(step.rank());
  const auto middle = rank.begin() + static_cast<std::ptrdiff_t>(rank.size() / 2);
  std::nth_element(rank.begin(), middle, rank.end());
  return *middle;
}

// Sums of the deviations of replicates from the original, in the order of the replicates.
struct Moments {
  explicit Moments(Index size) : count(Vector::Zero(size)), first(count), second(count), mixed(count) {}
  void add(const Vector& deviation) {
    for (Index i = 0; i < deviation.size(); ++i) {
      const double d = deviation(i);
      if (!std::isfinite(d)) continue;
      count(i) += 1;
      first(i) += d;
      second(i) += d * d;
      if (i + 1 < deviation.size() && std::isfinite(deviation(i + 1))) mixed(i) += d * deviation(i + 1);
    }
  }
  Vector count, first, second, mixed;
};

}  // namespace

Eigen::VectorXcd matched(const Eigen::VectorXcd& found, const Eigen::VectorXcd& reference) {
  struct Pair {
    double distance;
    Index place, from;
  };
  std::vector<Pair> pairs;
  for (Index i = 0; i < reference.size(); ++i)
    for (Index j = 0; j < found.size(); ++j) pairs.push_back({std::abs(found(j) - reference(i)), i, j});
  std::stable_sort(pairs.begin(), pairs.end(), [](const Pair& a, const Pair& b) { return a.distance < b.distance; });
  Eigen::VectorXcd result = Eigen::VectorXcd::Constant(reference.size(), std::complex<double>(nan, nan));
  std::vector<bool> placed(size_t(reference.size())), taken(size_t(found.size()));
  for (const Pair& pair : pairs) {
    if (placed[size_t(pair.place)] || taken[size_t(pair.from)]) continue;
    placed[size_t(pair.place)] = taken[size_t(pair.from)] = true;
    result(pair.place) = found(pair.from);
  }
  return result;
}

Bootstrap bootstrap(const Ensemble& data, const Identifier& f, const Functional& functional,
                    const BootstrapOptions& options) {
  check_options(options);
  check_samples(data);
  return bootstrap(identified(data, Vector::Ones(data.experiments()), f, options), data, f, functional, options);
}

Bootstrap bootstrap(const Model& original, const Ensemble& data, const Identifier& f, const Functional& functional,
                    const BootstrapOptions& options) {
  check_options(options);
  check_samples(data);
  const Index experiments = data.experiments();
  const Index mean = options.nominal ? 1 : 0;
  Index unknowns = (options.unknowns > 0 ? options.unknowns : median_unknowns(original)) + mean;
  // With so few experiments, plain regressions would fit any data exactly, and the other methods are regularised. These
  // methods still need enough experiments for a regression of the outputs on states and inputs.
  if (options.unknowns == 0 && experiments <= unknowns && original.method != "tvera")
    unknowns = original.states() + original.inputs + mean;
  // If steps share a model, each experiment gives as many rows as it has periods.
  if (options.unknowns == 0 && original.period > 0 && data.steps() > 0)
    unknowns = (unknowns * std::min(original.period, data.steps()) + data.steps() - 1) / data.steps();
  if (experiments <= unknowns)
    throw std::invalid_argument(fmt::format("experiments: {} found, at least {} needed for a bootstrap with {}",
                                            experiments, unknowns + 1, words::plural(unknowns, "unknown")));
  const Vector estimate = functional(original);

  Moments moments(estimate.size());
  Bootstrap result;
  result.unknowns = unknowns;
  for (Index first = 0; first < options.replicates; first += batch) {
    const Index end = std::min(options.replicates, first + batch);
    std::vector<std::optional<Vector>> found(size_t(end - first));
    const double all = double(options.replicates);
    parallel_for(first, end, share(options.execution, double(first) / all, double(end) / all),
                 [&](Index begin, Index last) {
                   for (Index b = begin; b < last; ++b) {
                     const Vector weights =
                         draw_weights(experiments, options.spread, options.seed * 1'000'003 + std::uint64_t(b));
                     try {
                       found[size_t(b - first)] = functional(identified(data, weights, f, options)) - estimate;
                     } catch (const std::exception&) {
                       // The failed replicates are counted below. A few failures do not affect the others.
                     }
                   }
                 });
    for (const std::optional<Vector>& deviation : found)
      if (deviation) {
        moments.add(*deviation);
        ++result.replicates;
      }
  }
  if (2 * result.replicates < options.replicates)
    throw std::runtime_error(
        fmt::format("bootstrap: only {} of {} replicates could be identified", result.replicates, options.replicates));

  const double n = double(experiments), left = double(experiments - unknowns);
  const double scale = (n + 2) / left / (options.spread * options.spread);
  // Each experiment beyond the number of unknowns gives a degree of freedom. B replicates determine the variance with B
  // - 1 degrees of freedom.
  result.freedom = 1 / (1 / left + 1 / double(std::max<Index>(1, result.replicates - 1)));
  Vector deviation(estimate.size());
  result.covariance.setZero(estimate.size(), 1);
  for (Index i = 0; i < estimate.size(); ++i) {
    const double count = moments.count(i);
    if (2 * count < double(result.replicates)) {
      deviation(i) = nan;
      continue;
    }
    deviation(i) =
        std::sqrt(scale * std::max(0.0, moments.second(i) - moments.first(i) * moments.first(i) / count) / (count - 1));
    if (i + 1 < estimate.size())
      result.covariance(i) = scale * (moments.mixed(i) - moments.first(i) * moments.first(i + 1) / count) / (count - 1);
  }
  const Vector width = statistics::student_quantile((1 + options.level) / 2, result.freedom) * deviation;
  result.interval = {estimate, deviation, estimate - width, estimate + width};
  return result;
}

}  // namespace tokid
