// Checks the sizes that data sets of a file claim, before memory is taken for them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>

#include "io/arrays.hpp"

namespace tokid::io {

// Bytes that the data sets of one file may take together: the memory of the machine, or the share of this process.
std::uint64_t memory_limit();
void limit_memory(std::uint64_t bytes);  // applies from now on if it is lower; 0: no limit of this kind

// Memory that the control groups of this process allow, including the groups around them, in both versions. The
// system's files are looked up below `root`.
std::uint64_t group_memory(const std::filesystem::path& root = "/");

// DEFLATE cannot compress by a larger factor.
constexpr std::uint64_t best_compression = 1032;

class Claims {
 public:
  explicit Claims(std::uint64_t file_bytes) : file_bytes_(file_bytes), left_(memory_limit()) {}

  // Refuses more dimensions than any format needs, and a size that the bytes of the file cannot hold. Refuses a size
  // that does not fit into memory beside the earlier data sets. \throws IoError
  void add(std::string_view name, const Shape& shape, size_t stored_item_bytes, size_t memory_item_bytes);
  // Checks a size that is taken for a while only. \throws as add()
  void check(std::string_view name, const Shape& shape, size_t stored_item_bytes, size_t memory_item_bytes) const {
    Claims(*this).add(name, shape, stored_item_bytes, memory_item_bytes);
  }

  std::uint64_t file_bytes() const { return file_bytes_; }
  std::uint64_t left() const { return left_; }

 private:
  std::uint64_t file_bytes_, left_;
};

}  // namespace tokid::io
