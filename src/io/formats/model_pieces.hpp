// Writes the step arrays of a model to an .h5 file in pieces of successive steps. The memory that this needs depends on
// the length of a piece, but not on that of the model.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>

#include "io/formats/schema.hpp"

namespace tokid::io {

struct ModelPieces {
  Arrays small;   // written at once
  Arrays shapes;  // names and shapes of the step arrays of the whole model, without values
  // Calls its argument with the step arrays of each piece, in order. All have the same names and widths as `shapes`.
  std::function<void(const std::function<void(const Arrays& rows)>&)> for_each;
};

// Pieces of a model in memory. The model must outlive them.
ModelPieces pieces_of(const Model& model);

// Writes into an existing file. \throws IoError
void write_hdf5(const ModelPieces& pieces, const std::filesystem::path& path);

}  // namespace tokid::io
