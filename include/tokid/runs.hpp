// Runs in memory, collected one by one and checked, and the ensemble of these runs.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "tokid/ensemble.hpp"

namespace tokid {

struct RunsOptions {
  std::optional<double> dt = {};                   // sample time [s]. Empty: not known, so that steps are counted
  Channels names = {};                             // empty lists: as Channels
  std::optional<InitialState> initial_state = {};  // empty: not stated, so that an identification tests it
};

// Collects runs whose samples are in memory. Each run becomes an experiment of an ensemble. Runs may have different
// numbers of steps. NaN marks a missing sample.
class Runs {
 public:
  // \throws std::invalid_argument for a negative number of channels, no channel, numbers of names or units that differ
  // from the numbers of channels, names that are not different, or dt ≤ 0
  Runs(Index inputs, Index outputs, RunsOptions options = {});

  // Adds a run of T steps. u: inputs (T × r); y: outputs (T × m). Row k holds the samples of step k. An empty name
  // stands for the row of the run. \throws std::invalid_argument if u or y has another number of channels, if both have
  // different numbers of steps or no step, or for an infinite sample. The message names the run. The other runs stay as
  // they were.
  void add(const ConstMatrixRef& u, const ConstMatrixRef& y, const std::string& name = {});
  // The same with the samples of all steps one after the other: u has T·r numbers, y has T·m.
  // \throws as the function above, also for a number of samples that is not a multiple of the number of channels
  void add(std::span<const double> u, std::span<const double> y, const std::string& name = {});
  // The same with one list for each step: u has T lists of r numbers, y has T lists of m numbers.
  // \throws as the function above; for a list with another number of channels, the message names its step
  void add(const std::vector<std::vector<double>>& u, const std::vector<std::vector<double>>& y,
           const std::string& name = {});

  Index size() const { return Index(runs_.size()); }  // number of runs

  // The ensemble of all runs. T is the number of steps of the longest run. If other runs are shorter, `length` holds
  // the number of steps of each run.
  // \throws std::invalid_argument if there is no run, or if two runs have the same name
  Ensemble ensemble() const;

 private:
  struct Run {
    std::string name;
    Matrix samples;  // (d × T): u_k, then y_k
  };

  Index inputs_, outputs_;
  RunsOptions options_;
  std::vector<Run> runs_;
};

}  // namespace tokid
