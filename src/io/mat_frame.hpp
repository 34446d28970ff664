// The frame of a .mat: what is in it, and whether its sizes agree, before a library trusts them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

namespace tokid::io {

// A whole number of these bytes, of the other order if `swap`.
template <typename T>
T load_bytes(const char* bytes, bool swap) {
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    const std::size_t at = swap ? sizeof(T) - 1 - i : i;
    value = static_cast<T>(value | (T{static_cast<unsigned char>(bytes[at])} << (8 * i)));
  }
  return value;
}

inline constexpr std::uint64_t mat_header_bytes = 128;  // of the file; those of a variable are fewer

enum class MatContainer { version5, hdf5 };

// \throws IoError for what is neither, and for elements of version 5 or 7 that don't fit into each other
MatContainer check_mat(const std::filesystem::path& path);

// Of all compressed variables of such a file: matio stops at their last number, before the checksum. A damaged one that
// is not wanted may have had the name of one that is. \throws IoError
void check_mat_checksums(const std::filesystem::path& path);

}  // namespace tokid::io
