// What an identification did about experiments and single samples that do not fit.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

struct Corrections {
  struct Experiment {
    std::string label;    // Ensemble::experiment_label()
    double weight = 0.0;  // 0: dropped
    bool operator==(const Experiment&) const = default;
  };
  struct Sample {
    std::string label;  // of the experiment
    Index output = 0, step = 0;
    double value = 0.0;  // NaN: missing
  };
  std::vector<Experiment> experiments = {};
  std::vector<Sample> samples = {};

  bool empty() const { return experiments.empty() && samples.empty(); }
};

// Data after corrections.
struct Corrected {
  Ensemble data;
  std::vector<Index> rows;  // of the experiments of `data` in the given ensemble
  Vector weights;           // of the experiments of `data`, between 0 and 1
};

// Leaves dropped experiments out and replaces samples. Corrections of experiments that the ensemble does not contain
// have no effect.
Corrected corrected(const Ensemble& ensemble, const Corrections& corrections);
// The same of some experiments; the rows of the result are those in the given ensemble.
Corrected corrected(const Ensemble& ensemble, const std::vector<Index>& rows, const Corrections& corrections);

// The mean motion, with each experiment counted by its weight.
Nominal weighted_nominal(const Ensemble& ensemble, const Vector& weights);

// Multiplies the experiments by the square roots of their weights (N), and the free responses by the square root of the
// mean weight. \throws std::invalid_argument for negative weights or a wrong number of weights
Ensemble weighted(Ensemble data, const Vector& weights);

}  // namespace tokid
