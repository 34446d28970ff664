// Reads and writes files of named arrays, each as a whole, in the format of its extension.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>

#include "io/fields.hpp"
#include "tokid/io.hpp"

namespace tokid::io {

// Calls use(fields) with the arrays of the file that are in `wanted`. \throws IoError
void load_arrays(const std::filesystem::path& path, const Names& wanted, const std::function<void(const Fields&)>& use);

// Writes arrays(layout), in the layout of the format. \throws as save_model()
void save_arrays(const std::filesystem::path& path, const WriteOptions& options,
                 const std::function<Arrays(Layout)>& arrays);

}  // namespace tokid::io
