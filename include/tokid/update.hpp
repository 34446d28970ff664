// Experiments that come later: an identification's regressions as triangular factors, to which more are added without
// the samples of the old ones.
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

// What is kept of all experiments so far, and the plan that was made from the first ones, without EM, which needs
// samples.
struct UpdateState {
  WindowFactors factors;
  Plan plan;            // without the units of TVERA, which all experiments tell
  std::string options;  // as Model::options has them, with the fingerprints of all data
  // Of all experiments that were given, copies and repetitions among them, ascending; they are not added again.
  std::vector<Digest> digests;
  Index without_digest = 0;  // experiments of a state that was written before states had digests
};

// Of an identification and the data that it used. \throws std::invalid_argument for what takes samples: experiments
// held out, free responses of TVERA, projections; and where no state was found in noise
UpdateState update_state(const Ensemble& data, const Identification& result, const IdentifyOptions& options);

// The model of all experiments so far: that of identify() with the same choices and without EM, which needs samples.
struct Updated {
  Model model;
  Index experiments = 0;
  double condition_max = 0.0;
  Index rank_deficient_steps = 0;
  Findings findings;
};
Updated identify(const UpdateState& state, const Execution& execution = {});

// \throws std::invalid_argument that names what differs from the experiments before
void check_update(const UpdateState& state, const Ensemble& more);
// Experiments with the samples of one that was given before are left out, and copies within the new ones are used once;
// the findings tell of both. \throws as check_update()
Findings update(UpdateState& state, const Ensemble& more, const Execution& execution = {});

// What ensembles have added, and how well the model of the experiments before does on that.
struct Additions {
  std::vector<Index> experiments;         // that each of them has added
  std::vector<std::vector<Index>> known;  // row numbers, ascending, of those in each that the state had already
  Fit simulation, one_step;               // as validate() finds them on all new experiments in one ensemble
  // Among them one for each output that the model before predicts no better than by its mean, or simulates far worse.
  Findings findings;
};

// As update(), with the figures of the model before, which is identify() of the state. \throws as check_update()
Additions update(UpdateState& state, const Model& before, const Ensemble& more, const Execution& execution = {});

struct UpdateOptions {
  ReadOptions read = {};
  Execution execution = {};
  Team team = {};  // shares the files
};

// Each file as update() of its experiments, in this order and with one of them in memory at a time: the same state, to
// the last bit, for any number of members and threads. Every member of the team calls it; state, model and what is
// returned are those of the first one. Where it throws, the state has some of the files, and is of no use. \throws
// IoError, and as check_update() with the name of the file in front
Additions update(UpdateState& state, const Model& before, const std::vector<std::filesystem::path>& files,
                 const UpdateOptions& options = {});

// In .npz, .h5 or .mat; the file appears whole or not at all. Who reads a state, adds experiments and saves it again
// holds a FileLock meanwhile, else somebody else's experiments may be lost. \throws IoError
void save_update_state(const UpdateState& state, const std::filesystem::path& path);
// Of a state that was read from the file of this lock, which outlives the FilesTogether of this thread. \throws
// IoError, and as FileLock::check()
void save_update_state(const UpdateState& state, FileLock& held);
UpdateState load_update_state(const std::filesystem::path& path);

}  // namespace tokid
