// One reader and one writer for each format. A reader returns the wanted data sets that exist, and the names of all
// data sets. A writer writes to an existing file that no other process uses.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "io/arrays.hpp"

namespace tokid::io {

Contents read_npz(const std::filesystem::path& path, const Names& wanted);
void write_npz(const Arrays& arrays, const std::filesystem::path& path);

// Also reads MATLAB's version 7.3, whatever the extension of the file is. For the data sets `outlined` it reads only
// the shape, in the order of the file.
Contents read_hdf5(const std::filesystem::path& path, const Names& wanted, const Names& outlined = {});
void write_hdf5(const Arrays& arrays, const std::filesystem::path& path);

Contents read_mat(const std::filesystem::path& path, const Names& wanted);  // of any version
void write_mat(const Arrays& arrays, const std::filesystem::path& path);    // version 7
void write_mat73(const Arrays& arrays, const std::filesystem::path& path);

Ensemble read_csv(const std::filesystem::path& path, const ReadOptions& options);
// Several tables; errors name the file.
Ensemble read_csv(const std::vector<std::filesystem::path>& paths, const ReadOptions& options);
void write_csv(const Ensemble& ensemble, const std::filesystem::path& path);

}  // namespace tokid::io
