// Files of named arrays: whole on both sides of the name, in the format of its extension.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>

#include "io/fields.hpp"
#include "tokid/io.hpp"

namespace tokid::io {

// use(fields) with the arrays of the file; what of `wanted` is there has been read. \throws IoError
void load_arrays(const std::filesystem::path& path, const Names& wanted, const std::function<void(const Fields&)>& use);

// arrays(layout) of the format. \throws as save_model()
void save_arrays(const std::filesystem::path& path, const WriteOptions& options,
                 const std::function<Arrays(Layout)>& arrays);

}  // namespace tokid::io
