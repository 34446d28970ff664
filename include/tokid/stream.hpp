// Identification of ensembles that are larger than memory. It reads blocks of steps from an .h5, identifies each block,
// joins the models of neighbouring blocks, and writes finished blocks. Memory depends on N, r + m, p and the length of
// the blocks, but not on T.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "tokid/ensemble_file.hpp"
#include "tokid/identify.hpp"
#include "tokid/model_file.hpp"
#include "tokid/team.hpp"

namespace tokid {

struct StreamOptions {
  IdentifyOptions identify = {};     // options; empty ones are chosen from the first steps
  Index block = 0;                   // steps of a block; 0: as many as fit into memory_per_thread
  double memory_per_thread = 100e6;  // [bytes]
  Team team = {};                    // the processes that share the blocks; any number of them gives the same bits
};

// The result of identify_stream(). Its model has no matrices, because the file has them. It has the state dimensions
// and the parts that are stored once per model. In the fit, each block is simulated separately, from a state that is
// estimated from the samples before the block. The whiteness test uses one block in the middle.
struct Streamed {
  Identification identification;
  Index block = 0, blocks = 0;  // steps of a block, number of blocks
  Index overlap = 0;            // steps that a block reads beyond its own, shared with its neighbours
  Index missing = 0;            // missing samples within the lengths of the experiments
};

// Every member of the team must call this function. Only the first member writes the model and gets the result.
// \throws std::invalid_argument as identify(), and for options that need all steps at once: a period, one model for all
// steps, the reference frame. \throws IoError, WriteError
Streamed identify_stream(const EnsembleFile& data, const std::filesystem::path& model,
                         const StreamOptions& options = {});

}  // namespace tokid
