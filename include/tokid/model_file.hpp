// Model files that are written step by step.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>

#include "tokid/model.hpp"

namespace tokid {

// Writes a model to an .h5 in the format of save_model(), piece by piece. The file appears as a whole or not at all.
// Until commit(), the steps are in an unnamed file beside the target.
class ModelFile {
 public:
  // \throws IoError where no file can be written beside the target, or the target is not an .h5
  explicit ModelFile(const std::filesystem::path& path);
  ~ModelFile();
  ModelFile(const ModelFile&) = delete;
  ModelFile& operator=(const ModelFile&) = delete;

  // Appends the next steps. The first call also sets the parts that a model has once. `steps` has the nominal
  // trajectory of its own steps only; in the first call also of the steps before the model begins.
  // \throws std::invalid_argument where steps or state dimensions do not continue the previous ones, IoError
  void append(const Model& steps);
  // The model so far without its matrices: only dimensions, condition, rank and lags of each step.
  const Model& outline() const;
  // \throws IoError
  void commit(Provenance provenance);

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace tokid
