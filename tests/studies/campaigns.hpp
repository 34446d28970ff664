// Campaigns of healthy experiments of many kinds, and what may be wrong with one experiment of them: what the search
// for experiments that do not fit is judged by.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "testing.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing {

struct Campaign {
  Index experiments, steps;
  SystemSize size;
  double noise;  // over the outputs
  Index lags;
};

inline Model slow_system(const SystemSize& size, Index steps, std::uint64_t seed) {
  Model model = constant_system(size, steps, 0.9, seed);
  for (Index k = 0; k < steps; ++k) model.step[size_t(k)].A() *= 1 + 0.1 * std::sin(0.1 * double(k));
  return model;
}

// Root mean squares of the outputs.
inline Vector output_sizes(const Ensemble& e) {
  Vector square = Vector::Zero(e.outputs());
  for (Index k = 0; k < e.steps(); ++k) square += e.output(k).colwise().squaredNorm().transpose();
  return (square / double(e.steps() * e.experiments())).cwiseSqrt();
}

// Every sample of the outputs; those of an experiment one after the other.
template <class Change>
Ensemble with_outputs(Ensemble e, Change&& change) {
  for (Index n = 0; n < e.experiments(); ++n)
    for (Index k = 0; k < e.steps(); ++k)
      for (Index j = 0; j < e.outputs(); ++j) e.y(n, k, j) = change(n, k, j, e.y(n, k, j));
  return e;
}

// White inputs, or others, without noise.
using Inputs = std::function<void(Ensemble&, Random&)>;
inline Ensemble noiseless(const Campaign& c, std::uint64_t seed, const Inputs& inputs = {}, double initial = 0.0) {
  const Model system = slow_system(c.size, c.steps, seed);
  Ensemble e = random_experiments(system, c.experiments, seed + 100, initial);
  if (!inputs) return e;
  Random random(seed + 300);
  inputs(e, random);
  return simulate(system, e, initial * random.matrix(c.size.n, c.experiments));
}

// Noise of one size in each output; `spread` is the deviation of the log of its size from experiment to experiment.
inline Ensemble noisy(const Campaign& c, Ensemble e, std::uint64_t seed, double spread = 0.0) {
  Random random(seed + 200);
  const Vector sigma = c.noise * output_sizes(e);
  double own = 1.0;
  return with_outputs(std::move(e), [&](Index, Index k, Index j, double y) {
    if (k == 0 && j == 0) own = spread > 0 ? std::exp(spread * random.normal()) : 1.0;
    return y + own * sigma(j) * random.normal();
  });
}

inline Ensemble campaign(const Campaign& c, std::uint64_t seed, double initial = 0.0, double spread = 0.0) {
  return noisy(c, noiseless(c, seed, {}, initial), seed, spread);
}

// One frequency for each experiment, from slow to fast.
inline void sine_dwells(Ensemble& e, Random&) {
  const double decades = 1.6, slowest = 0.02 * std::numbers::pi;
  for (Index n = 0; n < e.experiments(); ++n)
    for (Index i = 0; i < e.inputs(); ++i)
      for (Index k = 0; k < e.steps(); ++k) {
        const double place =
            double((n + i * e.experiments() / e.inputs()) % e.experiments()) / double(e.experiments() - 1);
        e.u(n, k, i) = std::sin(slowest * std::pow(10.0, decades * place) * double(k) + double(i));
      }
}

// One sine in three experiments of four, white inputs in the others.
inline void mixed_inputs(Ensemble& e, Random&) {
  for (Index n = 0; n < 3 * e.experiments() / 4; ++n)
    for (Index i = 0; i < e.inputs(); ++i)
      for (Index k = 0; k < e.steps(); ++k)
        e.u(n, k, i) = std::sin(0.3 * double(k) + 2 * std::numbers::pi * double(n + 3 * i) / double(e.experiments()));
}

inline void smooth_inputs(Ensemble& e, Random&) {
  for (Index k = 1; k < e.steps(); ++k) e.input(k) = 0.9 * Matrix(e.input(k - 1)) + 0.44 * Matrix(e.input(k));
}

inline void binary_inputs(Ensemble& e, Random&) {
  for (Index k = 0; k < e.steps(); ++k) e.input(k) = Matrix(e.input(k)).array().sign();
}

// One experiment is a baseline without input, and all rest at times.
inline void resting_inputs(Ensemble& e, Random& random) {
  for (Index n = 0; n < e.experiments(); ++n) {
    const Index from = Index(random.uniform(0.1, 0.7) * double(e.steps()));
    for (Index k = 0; k < e.steps(); ++k)
      if (n == e.experiments() / 2 || (k >= from && k < from + e.steps() / 4))
        for (Index i = 0; i < e.inputs(); ++i) e.u(n, k, i) = 0.0;
  }
}

struct CampaignKind {
  const char* name;
  std::function<Ensemble(const Campaign&, std::uint64_t)> make;
};

inline Ensemble with_gaps(Ensemble e, std::uint64_t seed) {
  Random random(seed);
  return with_outputs(std::move(e), [&](Index, Index, Index j, double y) {
    return j == 0 && random.uniform(0, 1) < 0.06 ? std::numeric_limits<double>::quiet_NaN() : y;
  });
}

inline Ensemble of_lengths(Ensemble e, std::uint64_t seed) {
  Random random(seed);
  std::vector<Index> length;
  for (Index n = 0; n < e.experiments(); ++n)
    length.push_back(n == 0 ? e.steps() : Index(random.uniform(0.1, 1) * double(e.steps())));
  set_length(e, length);
  return e;
}

// The size of each experiment by another factor, up to this one.
inline Inputs amplitudes(double most) {
  return [most](Ensemble& e, Random& random) {
    for (Index n = 0; n < e.experiments(); ++n) {
      const double own = std::pow(most, random.uniform(-0.5, 0.5));
      for (Index k = 0; k < e.steps(); ++k) e.input(k).row(n) *= own;
    }
  };
}

// Student's t of three degrees of freedom, of the same variance.
inline Ensemble heavy_tailed(const Campaign& c, std::uint64_t seed) {
  Ensemble e = noiseless(c, seed);
  Random random(seed + 200);
  const Vector sigma = c.noise * output_sizes(e);
  return with_outputs(std::move(e), [&](Index, Index, Index j, double y) {
    double square = 0.0;
    for (int i = 0; i < 3; ++i) square += std::pow(random.normal(), 2);
    return y + sigma(j) * random.normal() / std::sqrt(square);
  });
}

// One output sample in a hundred is off by so many times the noise.
inline Ensemble with_spikes(const Campaign& c, Ensemble e, std::uint64_t seed, double size = 50.0) {
  Random random(seed + 400);
  const Vector sigma = c.noise * output_sizes(e);
  return with_outputs(std::move(e), [&](Index, Index, Index j, double y) {
    return random.uniform(0, 1) < 0.01 ? y + size * sigma(j) : y;
  });
}

// Rounded to a share of their size.
inline Ensemble quantised(Ensemble e, double share) {
  const Vector step = share * output_sizes(e);
  return with_outputs(std::move(e), [&](Index, Index, Index j, double y) { return std::round(y / step(j)) * step(j); });
}

inline Ensemble in_single_precision(Ensemble e) {
  e.samples() = Matrix(e.samples()).cast<float>().cast<double>();
  return e;
}

// What nothing is wrong with.
inline std::vector<CampaignKind> healthy_campaigns() {
  const auto of = [](const Inputs& inputs) {
    return [inputs](const Campaign& c, std::uint64_t seed) { return noisy(c, noiseless(c, seed, inputs), seed); };
  };
  return {
      {"white inputs", [](const Campaign& c, std::uint64_t s) { return campaign(c, s); }},
      {"smooth inputs", of(smooth_inputs)},
      {"binary inputs", of(binary_inputs)},
      {"sine dwells", of(sine_dwells)},
      {"sines and white inputs", of(mixed_inputs)},
      {"inputs at rest", of(resting_inputs)},
      {"amplitudes up to tenfold", of(amplitudes(10))},
      {"unknown initial states", [](const Campaign& c, std::uint64_t s) { return campaign(c, s, 3.0); }},
      {"initial states a hundredfold", [](const Campaign& c, std::uint64_t s) { return campaign(c, s, 100.0); }},
      {"no noise", [](const Campaign& c, std::uint64_t s) { return noiseless(c, s); }},
      {"noise by a third", [](const Campaign& c, std::uint64_t s) { return campaign(c, s, 0.0, 0.3); }},
      {"noise up to fourfold", [](const Campaign& c, std::uint64_t s) { return campaign(c, s, 0.0, 0.7); }},
      {"noise of Student's t, 3", heavy_tailed},
      {"spikes", [](const Campaign& c, std::uint64_t s) { return with_spikes(c, campaign(c, s), s); }},
      {"missing samples", [](const Campaign& c, std::uint64_t s) { return with_gaps(campaign(c, s), s); }},
      {"lengths of 10 to 100 %", [](const Campaign& c, std::uint64_t s) { return of_lengths(campaign(c, s), s); }},
      {"outputs rounded to a tenth", [](const Campaign& c, std::uint64_t s) { return quantised(campaign(c, s), 0.1); }},
      {"single precision", [](const Campaign& c, std::uint64_t s) { return in_single_precision(noiseless(c, s)); }},
  };
}

// Campaigns that differ in everything but what is wrong with them.
inline std::vector<Campaign> various_campaigns() {
  return {{5, 40, {2, 1, 1}, 0.05, 2},  {8, 40, {2, 2, 2}, 0.05, 2},  {12, 40, {4, 2, 2}, 0.1, 2},
          {20, 60, {4, 2, 2}, 0.05, 4}, {40, 80, {4, 2, 2}, 0.2, 8},  {60, 30, {1, 1, 1}, 0.1, 4},
          {30, 12, {2, 1, 1}, 0.1, 2},  {10, 200, {2, 1, 1}, 0.3, 4}, {100, 40, {3, 3, 1}, 0.01, 6}};
}

// The outliers that identify() finds with stated orders.
inline std::vector<Outlier> identified_outliers(const Ensemble& e, const Campaign& c) {
  IdentifyOptions options{.states = c.size.n, .lags = c.lags, .smoothing = 100.0, .refine = false};
  options.nominal = NominalChoice::none;
  return identify(e, options).outliers;
}

// What may be wrong with one experiment.
struct CampaignFault {
  const char* name;
  std::function<void(Ensemble&, const Ensemble&, Index)> change;  // the ensemble, as it was, which experiment
};

inline std::vector<CampaignFault> campaign_faults() {
  return {
      {"other units",
       [](Ensemble& e, const Ensemble&, Index n) {
         for (Index k = 0; k < e.steps(); ++k) e.y(n, k, 0) *= 1000;
       }},
      {"swapped channels",
       [](Ensemble& e, const Ensemble& b, Index n) {
         for (Index k = 0; k < e.steps(); ++k)
           for (Index j = 0; j < e.outputs(); ++j) e.y(n, k, j) = b.y(n, k, e.outputs() - 1 - j);
       }},
      {"a wrong sign",
       [](Ensemble& e, const Ensemble&, Index n) {
         for (Index k = 0; k < e.steps(); ++k) e.u(n, k, 0) *= -1;
       }},
      {"two steps late",
       [](Ensemble& e, const Ensemble& b, Index n) {
         for (Index k = 0; k < e.steps(); ++k)
           for (Index j = 0; j < e.outputs(); ++j)
             e.y(n, k, j) = k < 2 ? std::numeric_limits<double>::quiet_NaN() : b.y(n, k - 2, j);
       }},
  };
}

}  // namespace tokid::testing
