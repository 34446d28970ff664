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
// the refinement by EM, because EM needs the samples.
struct UpdateState {
  WindowFactors factors;
  Plan plan;              // without output_size and input_size, which depend on all experiments
  Provenance provenance;  // of the model, with the fingerprints of all data
  // Digests of all experiments so far, including copies and repetitions, ascending. An experiment with one of these
  // digests is not added again.
  std::vector<Digest> digests;
  Index without_digest = 0;  // experiments without a digest, from a state of an older version
};

// Makes the state of an identification and its training data. \throws std::invalid_argument for options that need
// samples (held-out experiments, free responses of TVERA, projections), and if no state was found in noisy data
UpdateState update_state(const Ensemble& data, const Identification& result, const IdentifyOptions& options);

// The model of all experiments so far: the same as from identify() with the same choices and without EM.
struct Updated {
  Model model;
  Index experiments = 0;
  double condition_max = 0.0;
  Index rank_deficient_steps = 0;
  Findings findings;
};
Updated identify(const UpdateState& state, const Execution& execution = {});

// Checks that `more` fits the state. \throws std::invalid_argument if `more` does not match the earlier experiments;
// the message names the difference
void check_update(const UpdateState& state, const Ensemble& more);
// Adds experiments to the state. It leaves out each experiment whose samples are equal to those of an earlier
// experiment. Of copies among the new experiments it uses one. The findings report repeated experiments and copies.
// \throws as check_update()
Findings update(UpdateState& state, const Ensemble& more, const Execution& execution = {});

// The experiments that were added from each ensemble, and the fit of the previous model to the new experiments.
struct Additions {
  std::vector<Index> experiments;  // number of experiments added from each ensemble
  // for each ensemble: rows of the experiments that the state already had, ascending
  std::vector<std::vector<Index>> known;
  Fit simulation, one_step;  // fits of validate() on all new experiments in one ensemble
  // They include a finding for each output with poor results of the previous model: predictions no better than the mean
  // of the output, or a simulation far worse than the mean.
  Findings findings;
};

// Adds experiments like the update() above, and computes the fit of the previous model `before`, which must be
// identify(state). \throws as check_update()
Additions update(UpdateState& state, const Model& before, const Ensemble& more, const Execution& execution = {});

struct UpdateOptions {
  ReadOptions read = {};
  Execution execution = {};
  Team team = {};  // processes that share the files
};

// Updates the state with each file in this order, with one file in memory at a time. The state has the same bits for
// any number of members and threads. Every member of the team must call this function. Only the first member needs
// `state` and `before`, and gets the result. After an exception the state contains some of the files; do not use it.
// \throws IoError, and as check_update() with the name of the file in front
Additions update(UpdateState& state, const Model& before, const std::vector<std::filesystem::path>& files,
                 const UpdateOptions& options = {});

// Writes .npz, .h5 or .mat; the file appears as a whole or not at all. A program that reads a state, adds experiments
// and saves it must hold a FileLock during this time. Otherwise the experiments of another program may be lost.
// \throws IoError
void save_update_state(const UpdateState& state, const std::filesystem::path& path);
// Saves to the file of this lock the state that was read from it. If a FilesTogether of this thread exists, the lock
// must live longer than it. \throws IoError, and as FileLock::check()
void save_update_state(const UpdateState& state, FileLock& held);
UpdateState load_update_state(const std::filesystem::path& path);

}  // namespace tokid
