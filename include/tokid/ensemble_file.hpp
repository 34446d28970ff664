// Ensembles in files that are larger than memory.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "tokid/ensemble.hpp"
#include "tokid/io.hpp"

namespace tokid {

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

}  // namespace tokid
