// Updates with later experiments. The regressions of an identification are stored as triangular factors, to which new
// experiments are added without the old samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "tokid/file_lock.hpp"
#include "tokid/identify.hpp"
#include "tokid/io.hpp"
#include "tokid/team.hpp"
#include "tokid/validate.hpp"
#include "tokid/windows.hpp"

namespace tokid {

// The update state: the factors of all experiments so far, and the plan from the first experiments. It does not include
// EM, which needs samples.
struct UpdateState {
  WindowFactors factors;
  Plan plan;              // without the units of TVERA, which come from all experiments
  Provenance provenance;  // of the model, with the fingerprints of all data
  // Digests of all experiments so far, including copies and repetitions, ascending. An experiment with one of these
  // digests is not added again.
  std::vector<Digest> digests;
  Index without_digest = 0;  // experiments without a digest, from a state of an older version
};

// Makes the state of an identification and its training data. \throws std::invalid_argument for methods that need
// samples (held-out experiments, free responses of TVERA, projections), and for noisy data in which no state was found
UpdateState update_state(const Ensemble& data, const Identification& result, const IdentifyOptions& options);

// The model of all experiments so far: that of identify() with the same choices, but without EM.
struct Updated {
  Model model;
  Index experiments = 0;
  double condition_max = 0.0;
  Index rank_deficient_steps = 0;
  Findings findings;
};
Updated identify(const UpdateState& state, const Execution& execution = {});

// Checks that `more` fits the state. \throws std::invalid_argument that names the difference from the experiments
// before
void check_update(const UpdateState& state, const Ensemble& more);
// Adds experiments to the state. It leaves out an experiment with the samples of an earlier one, and uses copies within
// the new ones once. The findings report both. \throws as check_update()
Findings update(UpdateState& state, const Ensemble& more, const Execution& execution = {});

// The experiments that ensembles added, and the fit of the previous model to them.
struct Additions {
  std::vector<Index> experiments;  // number of experiments added from each ensemble
  // rows of the experiments in each ensemble that the state already had, ascending
  std::vector<std::vector<Index>> known;
  Fit simulation, one_step;  // fits of validate() on all new experiments in one ensemble
  // They include one finding for each output that the previous model predicts no better than its mean does, or
  // simulates far worse.
  Findings findings;
};

// As update(), with the fit of the previous model `before`, which must be identify() of the state. \throws as
// check_update()
Additions update(UpdateState& state, const Model& before, const Ensemble& more, const Execution& execution = {});

struct UpdateOptions {
  ReadOptions read = {};
  Execution execution = {};
  Team team = {};  // processes that share the files
};

// Updates the state with each file in this order, with one file in memory at a time. The state has the same bits for
// any number of members and threads. Every member of the team must call it. `state`, `before` and the result matter at
// the first member only. After an exception the state contains some of the files and must not be used. \throws IoError,
// and as check_update() with the name of the file in front
Additions update(UpdateState& state, const Model& before, const std::vector<std::filesystem::path>& files,
                 const UpdateOptions& options = {});

// Writes .npz, .h5 or .mat; the file appears as a whole or not at all. A program that reads a state, adds experiments
// and saves it must hold a FileLock during this time. Otherwise the experiments of another program may be lost.
// \throws IoError
void save_update_state(const UpdateState& state, const std::filesystem::path& path);
// Saves a state that was read from the file of this lock. The lock must outlive the FilesTogether of this thread.
// \throws IoError, and as FileLock::check()
void save_update_state(const UpdateState& state, FileLock& held);
UpdateState load_update_state(const std::filesystem::path& path);

}  // namespace tokid
