// Checks the structure of a .mat and its sizes, before a library trusts them.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

namespace tokid::io {

// The whole number in these bytes, which have the other byte order if `swap`.
template <typename T>
T load_bytes(const char* bytes, bool swap) {
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    const std::size_t at = swap ? sizeof(T) - 1 - i : i;
    value = static_cast<T>(value | (T{static_cast<unsigned char>(bytes[at])} << (8 * i)));
  }
  return value;
}

inline constexpr std::uint64_t mat_header_bytes = 128;  // of the file; a variable has fewer

enum class MatContainer { version5, hdf5 };

// \throws IoError for a file of neither kind, and for elements of version 5 or 7 whose sizes do not match
MatContainer check_mat(const std::filesystem::path& path);

// Checks all compressed variables of such a file, because matio stops at the last number, before the checksum. Even a
// variable that is not wanted is checked: damage may have changed a wanted name. \throws IoError
void check_mat_checksums(const std::filesystem::path& path);

}  // namespace tokid::io
