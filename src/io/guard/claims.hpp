// Checks the sizes that a file states for its data sets, before memory is allocated for them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>

#include "io/arrays.hpp"

namespace tokid::io {

// Bytes that all data sets of one file may take in memory: the memory of the machine, or the share that this process
// may use.
std::uint64_t memory_limit();
// Replaces the result of memory_limit() from now on. 0: the result is that of the machine again.
void limit_memory(std::uint64_t bytes);

// Memory that the control groups of this process and the groups around them allow, for both versions of control groups.
// `root` is the folder in which the files of the system are searched.
std::uint64_t group_memory(const std::filesystem::path& root = "/");

// The largest factor by which DEFLATE can compress.
constexpr std::uint64_t best_compression = 1032;

class Claims {
 public:
  explicit Claims(std::uint64_t file_bytes) : file_bytes_(file_bytes), left_(memory_limit()) {}

  // Checks the stated size of a data set. It refuses more than 32 dimensions. It refuses a size that the bytes of the
  // file cannot contain, even compressed. It refuses a size that does not fit into memory in addition to the earlier
  // data sets. \throws IoError
  void add(std::string_view name, const Shape& shape, size_t stored_item_bytes, size_t memory_item_bytes);

 private:
  std::uint64_t file_bytes_, left_;
};

}  // namespace tokid::io
