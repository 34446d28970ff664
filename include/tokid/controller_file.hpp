// Controllers in files: .npz, .h5 / .hdf5, .mat; docs/formats.md has the names and shapes.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "tokid/control.hpp"
#include "tokid/io.hpp"

namespace tokid {

// Writes a controller. The file appears as a whole or not at all. An expected cost that is not finite is left out.
// \throws std::invalid_argument for a controller that load_controller() would refuse, because its parts do not fit each
// other or a number is not valid, IoError if the name is not valid, WriteError
void save_controller(const Controller& controller, const std::filesystem::path& path, const WriteOptions& options = {});
// \throws IoError
Controller load_controller(const std::filesystem::path& path);

}  // namespace tokid
