// Ensembles in files that may be larger than memory.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "tokid/ensemble.hpp"
#include "tokid/io.hpp"

namespace tokid {

// An ensemble in an .h5 file. read() loads only the requested steps. The constructor reads the names and the free
// responses.
class EnsembleFile {
 public:
  // \throws IoError as load_ensemble(), and for files of MATLAB, which store the dimensions of an array in reverse
  // order
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
  bool dt_stated() const;  // false: the file states no sample time, and dt() is 1
  const Channels& names() const;
  const std::optional<InitialState>& initial_state() const;
  const std::filesystem::path& path() const;

  // The steps begin … end-1, as stretch() of the whole ensemble, but with the same steps of the free responses. Several
  // threads may call it at the same time. \throws std::invalid_argument unless 0 ≤ begin < end ≤ T, IoError
  Ensemble read(Index begin, Index end) const;
  // A hint: asks the operating system to load the steps begin … end-1, because read() will need them soon.
  void expect(Index begin, Index end) const;

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

// Size of the samples as doubles [bytes], if the file can be read in blocks. Empty for formats other than .h5 and for
// MATLAB's files. \throws IoError where the file is not an ensemble
std::optional<double> bytes_in_blocks(const std::filesystem::path& path);

}  // namespace tokid
