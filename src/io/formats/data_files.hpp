// Paths of data that stand for several files: folders and patterns.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string>

#include "io/arrays.hpp"

namespace tokid::io {

// Is this the path of a folder, or a pattern with * ? or [ that is not the name of a file?
bool stands_for_files(const std::filesystem::path& path);

// The names of the folders in this folder that contain .csv files; none if this is no folder.
Names subfolders_with_csv(const std::filesystem::path& folder);

// The order of names in which numbers count as numbers: "run2" is before "run10".
bool is_before(const std::string& a, const std::string& b);

}  // namespace tokid::io
