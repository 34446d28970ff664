// The samples of an ensemble as the Kalman filter needs them: experiments with the same missing samples are together.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "tokid/model.hpp"

namespace tokid::kalman {

// A group of experiments with the same missing samples. They share all covariances.
struct Alike {
  Index first = 0, count = 0;                // rows of the samples
  Index end = 0;                             // number of steps, up to the last available output
  std::vector<std::vector<Index>> outputs;   // (end) available outputs
  std::vector<std::vector<Index>> unknowns;  // (end) missing inputs
};

// The samples at the steps of a model, as departures from its nominal trajectory. Step t is step k_begin + t.
// Each experiment has a row, unless fewer rows have the same second moments, see with_fewer_rows().
struct Samples {
  Index experiments = 0, rows = 0, steps = 0;
  std::vector<Matrix> u, y;  // (steps) rows × r and rows × m, zero where missing; the rows of a group are adjacent
  Vector one;                // (rows) what a row has instead of the number 1
  std::vector<Alike> groups;
  std::vector<Index> experiment;  // (rows) experiment of each row, if each experiment has a row
  Vector u_square, y_square;      // (r), (m): mean squares of the available samples
  double outputs = 0;             // number of available output samples
};
// Steps after the last output of an experiment contain no information. They are dropped, unless they must be predicted.
enum class Tail { drop, keep };
// Arranges the samples, for the first `steps` steps of the model if `steps` is not negative.
// \throws std::invalid_argument for wrong numbers of channels
Samples samples_of(const Model& model, const Ensemble& data, Tail tail = Tail::drop, Index steps = -1);

// The triangular factor of the samples [1 u_0 y_0 u_1 …], whose rows stand for all experiments: means, moments and the
// likelihood of all experiments are linear in the second moments of their samples. Empty unless the experiments miss no
// sample and are at least twice as many as the rows.
std::optional<Samples> with_fewer_rows(const Samples& samples);

}  // namespace tokid::kalman
