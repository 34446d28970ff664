// Models that are written as they grow.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <memory>
#include <string>

#include "tokid/model.hpp"

namespace tokid {

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

}  // namespace tokid
