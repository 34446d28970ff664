// Identification of ensembles that are larger than memory: blocks of steps are read from an .h5, identified by
// themselves, joined where they meet, and written as they finish. Memory depends on N, r + m, p and the length of the
// blocks, but not on T.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "tokid/identify.hpp"
#include "tokid/team.hpp"

namespace tokid {

// Which file it is, and when it last changed: not even programs that set the time of a file can set that of its status.
struct FileState {
  std::uint64_t number = 0, bytes = 0;
  std::string modified, changed;  // in UTC
};

// An ensemble that stays in its .h5 but for the steps asked for. Free responses are read with the names.
class EnsembleFile {
 public:
  // \throws IoError for what load_ensemble() refuses, and for MATLAB's files, whose samples lie the other way round
  explicit EnsembleFile(const std::filesystem::path& path);
  ~EnsembleFile();
  EnsembleFile(const EnsembleFile&) = delete;
  EnsembleFile& operator=(const EnsembleFile&) = delete;

  Index experiments() const;  // N
  Index steps() const;        // T
  Index inputs() const;       // r
  Index outputs() const;      // m
  Index channels() const { return inputs() + outputs(); }
  Index free_responses() const;
  double dt() const;       // [s]
  bool dt_stated() const;  // false: the file states none, and dt() is 1
  const Channels& names() const;
  const std::optional<InitialState>& initial_state() const;
  const std::filesystem::path& path() const;
  FileState state() const;  // when it was opened

  // The steps begin … end-1 as stretch() would have them of the whole ensemble, with the same steps of the free
  // responses. May be called from several threads. \throws std::invalid_argument unless 0 ≤ begin < end ≤ T, IoError
  Ensemble read(Index begin, Index end) const;
  // Has the system fetch the steps begin … end-1, which will be read soon, while something else is done: a hint.
  void expect(Index begin, Index end) const;

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

// Can the samples of this file be read in blocks, and how many bytes are they as doubles? Empty for other formats than
// .h5 and for MATLAB's files. \throws IoError where the file is no ensemble
std::optional<double> bytes_in_blocks(const std::filesystem::path& path);

// A model that grows at its end and becomes an .h5 like that of save_model(), whole or not at all. What comes first
// waits in an unnamed file beside the target.
class ModelFile {
 public:
  // \throws IoError where nothing can be written beside the target, or it is no .h5
  explicit ModelFile(const std::filesystem::path& path);
  ~ModelFile();
  ModelFile(const ModelFile&) = delete;
  ModelFile& operator=(const ModelFile&) = delete;

  // The next steps: the first ones say all that is said once per model. A nominal trajectory is that of these steps
  // alone, and of those before the first step of the model. \throws std::invalid_argument where steps or state
  // dimensions do not follow on, IoError
  void append(const Model& steps);
  // Everything appended, with empty matrices: dimensions, condition, rank and lags per step.
  const Model& outline() const;
  // \throws IoError
  void commit(const std::string& options, const std::string& program_version);

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

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
