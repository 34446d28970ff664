// Reads and writes complete files of named arrays. The extension of the file determines its format.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>

#include "io/formats/fields.hpp"
#include "tokid/io.hpp"

namespace tokid::io {

// Calls use(fields) with the arrays of the file that are in `wanted`. \throws IoError
void load_arrays(const std::filesystem::path& path, const Names& wanted, const std::function<void(const Fields&)>& use);

// Writes arrays(layout), in the layout of the format. \throws as save_model()
void save_arrays(const std::filesystem::path& path, const WriteOptions& options,
                 const std::function<Arrays(Layout)>& arrays);

// Checks that the file can be read. Without this check, the messages would be those of the libraries, which differ and
// can mislead. \throws IoError
void check_readable(const std::filesystem::path& path);

bool is_hdf5(const std::filesystem::path& path);  // by its extension

}  // namespace tokid::io
