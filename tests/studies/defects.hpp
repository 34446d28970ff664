// Ensembles of 60 experiments with one defect, and what an identification finds in them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "testing.hpp"
#include "tokid/example.hpp"
#include "tokid/identify.hpp"

namespace tokid::testing {

// A system with noise, and its experiments.
struct NoisySystem {
  std::string name;
  Model model;  // with its noise and its Kalman filter
  ExperimentOptions noise;
  Index period = 0;

  Ensemble experiments(Index count, std::uint64_t seed) const {
    ExperimentOptions o = noise;
    o.experiments = count;
    o.seed = seed;
    return tokid::experiments(model, o);
  }
};

inline NoisySystem noisy_system(const std::string& name, Index steps, std::uint64_t seed) {
  ExperimentOptions noise;
  noise.process_noise = 0.02;
  noise.measurement_noise = 0.05;
  if (name == "oscillator") return {name, with_noise(oscillator(steps), noise), noise};
  const SystemSize size = name == "varying 1x1" ? SystemSize{2, 1, 1} : SystemSize{3, 2, 2};
  Model model = constant_system(size, steps, 0.9, seed);
  if (name != "invariant 2x2")
    for (Index k = 0; k < steps; ++k) model.step[size_t(k)].A() *= 1 + 0.1 * std::sin(0.1 * double(k));
  return {name, with_noise(std::move(model), noise), noise, name == "invariant 2x2" ? 1 : 0};
}

inline std::vector<std::string> noisy_systems() {
  return {"oscillator", "varying 1x1", "varying 2x2", "invariant 2x2"};
}

// A wrong output of one experiment.
enum class Defect { sign, late, scaled, sample };
inline constexpr Defect defects[]{Defect::sign, Defect::late, Defect::scaled, Defect::sample};
inline const char* name(Defect defect) {
  constexpr const char* names[]{"sign", "one step late", "times 1.5", "one sample, 10 sigma"};
  return names[int(defect)];
}

struct Place {
  Index experiment = 0, output = 0, step = 0;
};

// The one-step error of this output by the model of the noise: the deviation of an innovation.
inline double innovation_deviation(const NoisySystem& system, const Place& at) {
  return std::sqrt(system.model.step[size_t(at.step)].innovation_cov()(at.output, at.output));
}

inline Ensemble with_defect(Ensemble e, const NoisySystem& system, Defect defect, const Place& at) {
  const Ensemble before = e;
  const auto [n, j, step] = at;
  for (Index k = 0; k < e.steps() && defect != Defect::sample; ++k)
    e.y(n, k, j) = defect == Defect::sign   ? -before.y(n, k, j)
                   : defect == Defect::late ? before.y(n, std::max<Index>(0, k - 1), j)
                                            : 1.5 * before.y(n, k, j);
  if (defect == Defect::sample) e.y(n, step, j) += (step % 2 == 0 ? 10 : -10) * innovation_deviation(system, at);
  return e;
}

// The same ensemble with the defect removed by hand.
inline Ensemble without_defect(Ensemble e, Defect defect, const Place& at) {
  if (defect == Defect::sample) {
    e.y(at.experiment, at.step, at.output) = std::numeric_limits<double>::quiet_NaN();
    return e;
  }
  std::vector<Index> rows = range(0, e.experiments());
  rows.erase(rows.begin() + at.experiment);
  return e.subset(rows);
}

struct Accused {
  bool right = false;  // the defect is named, with its place
  Index wrong_experiments = 0, wrong_samples = 0;
};

inline Accused accused(const Identification& found, Defect defect, const Place& at) {
  Accused result;
  for (const Outlier& o : found.outliers)
    if (defect != Defect::sample && o.experiment == at.experiment)
      result.right = true;
    else
      ++result.wrong_experiments;
  for (const OutlyingSamples& o : found.validation.outlying) {
    const bool own = o.experiment == at.experiment && o.output == at.output;
    for (const Index k : o.steps)
      if (defect == Defect::sample && own && k == at.step)
        result.right = true;
      else if (o.experiment != at.experiment || defect == Defect::sample)
        ++result.wrong_samples;
  }
  return result;
}

// RMS of the one-step errors of a model on fresh data, over all outputs, each divided by its RMS with the true model.
inline double one_step_error(const NoisySystem& system, const Model& model, std::uint64_t seed) {
  const Ensemble fresh = system.experiments(100, seed + 5000);
  const Vector own = fit(fresh, predict(model, fresh).y).rmse, best = fit(fresh, predict(system.model, fresh).y).rmse;
  return std::sqrt((own.array() / best.array()).square().mean());
}

}  // namespace tokid::testing
