// Identification of ensembles that are larger than memory: blocks of steps are read from an .h5, identified by
// themselves, joined where they meet, and written as they finish. Memory depends on N, r + m, p and the length of the
// blocks, but not on T.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "tokid/ensemble_file.hpp"
#include "tokid/identify.hpp"
#include "tokid/model_file.hpp"
#include "tokid/team.hpp"

namespace tokid {

struct StreamOptions {
  IdentifyOptions identify = {};     // what is left to be chosen is chosen from stretches at the begin, middle and end
  Index block = 0;                   // steps of a block; 0: as many as memory_per_thread holds
  double memory_per_thread = 100e6;  // [bytes]
  Team team = {};                    // shares the blocks
  // Keeps the blocks that are finished in a journal beside the model, MODEL.resume, until that is there; and goes on
  // from one that is found, to a model of the same bits, whatever the number of threads and members.
  bool resume = false;
};

// The Identification of a stream. Its model holds what is said once per model, `state_dim` and as many empty matrices
// as there are steps. The simulation that is judged starts anew in every block, from the state that the samples before
// it tell; the test of whiteness is that of a block in the middle.
struct Streamed {
  Identification identification;
  Index block = 0, blocks = 0;  // steps of a block, and how many there are
  Index overlap = 0;            // steps that a block shares with its neighbours, beyond its own
  Index missing = 0;            // samples, within the lengths of the experiments
  Index resumed = 0;            // blocks that come from the journal of an earlier call
};

// Every member of the team calls it; the first one alone writes, and gets what is returned.
// \throws std::invalid_argument as identify(), and for what needs all steps at once: a period, one model for all steps,
// the reference frame; IoError, also for a journal of other data or options than these; WriteError
Streamed identify_stream(const EnsembleFile& data, const std::filesystem::path& model,
                         const StreamOptions& options = {});

}  // namespace tokid
