// Checks the variables of a .mat file, because matio reports no error for damage of many kinds.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>

namespace tokid::io {

// The whole number in these bytes. It has its lowest byte first, or its highest byte first if `swap`.
template <typename T>
T load_bytes(const char* bytes, bool swap) {
  T value = 0;
  for (std::size_t i = 0; i < sizeof(T); ++i) {
    const std::size_t at = swap ? sizeof(T) - 1 - i : i;
    value = static_cast<T>(value | (T{static_cast<unsigned char>(bytes[at])} << (8 * i)));
  }
  return value;
}

inline constexpr std::uint64_t mat_header_bytes = 128;  // of the file; the header of a variable is smaller

enum class MatContainer { version5, hdf5 };

// A file of version 5 or 7 is a header and a chain of variables with their sizes. The last variable must end at the end
// of the file; matio assumes that the file ends where the chain breaks. The compressed variables of version 7 must have
// the right checksums; matio does not compare them, because it stops at the last number. Even variables that are not
// wanted are checked, because damage may have changed the name of a wanted one.
// \throws IoError for a file of another kind, and for a damaged one
MatContainer check_mat(const std::filesystem::path& path);

}  // namespace tokid::io
