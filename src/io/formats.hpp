// One reader and one writer for each format. Readers deliver the wanted data sets that are there and the names of all;
// writers write to a file that exists already and is theirs alone.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>

#include "io/arrays.hpp"

namespace tokid::io {

Contents read_npz(const std::filesystem::path& path, const Names& wanted);
void write_npz(const Arrays& arrays, const std::filesystem::path& path);

// Also MATLAB 7.3, whatever its name. Of the `outlined` data sets the shape alone is read, as the file has it.
Contents read_hdf5(const std::filesystem::path& path, const Names& wanted, const Names& outlined = {});
void write_hdf5(const Arrays& arrays, const std::filesystem::path& path);

Contents read_mat(const std::filesystem::path& path, const Names& wanted);  // of any version
void write_mat(const Arrays& arrays, const std::filesystem::path& path);    // version 7
void write_mat73(const Arrays& arrays, const std::filesystem::path& path);

Ensemble read_csv(const std::filesystem::path& path, const ReadOptions& options);
void write_csv(const Ensemble& ensemble, const std::filesystem::path& path);

}  // namespace tokid::io
