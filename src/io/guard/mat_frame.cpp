// SPDX-License-Identifier: BSD-3-Clause
#include "io/guard/mat_frame.hpp"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>
#include <vector>

#include "io/arrays.hpp"
#include "io/guard/claims.hpp"

namespace tokid::io {

namespace {

bool is_hdf5(std::istream& file) {
  constexpr std::string_view signature = "\x89HDF\r\n\x1a\n";
  for (const int offset : {0, 512}) {
    std::array<char, 8> start{};
    file.clear();
    file.seekg(offset);
    file.read(start.data(), start.size());
    if (std::string_view(start.data(), start.size()) == signature) return true;
  }
  return false;
}

bool swapped_bytes(std::istream& file) {
  std::array<char, mat_header_bytes> header{};
  file.clear();
  file.seekg(0);
  file.read(header.data(), header.size());
  const std::string_view order(&header[126], 2);
  const bool swap = order == "MI";
  if (!file || (order != "IM" && order != "MI") || load_bytes<std::uint16_t>(&header[124], swap) != 0x0100)
    fail("no header of a .mat file found, MATLAB version 5, 7 or 7.3 needed (save -v7)");
  return swap;
}

// Inflates a compressed variable to its end, where zlib compares its checksum (Adler-32).
void check_compressed(std::istream& file, std::uint64_t packed_bytes) {
  constexpr size_t piece = size_t{1} << 16;
  std::vector<char> packed(piece), unused(piece);
  z_stream stream{};
  if (inflateInit(&stream) != Z_OK) fail("zlib can't be used");
  int status = Z_OK;
  const std::uint64_t most = memory_limit();
  while (status == Z_OK && stream.total_out <= most) {
    if (stream.avail_in == 0 && packed_bytes > 0) {
      const auto bytes = std::streamsize(std::min<std::uint64_t>(packed_bytes, piece));
      if (!file.read(packed.data(), bytes)) break;
      packed_bytes -= std::uint64_t(bytes);
      stream.next_in = reinterpret_cast<Bytef*>(packed.data());
      stream.avail_in = uInt(bytes);
    }
    stream.next_out = reinterpret_cast<Bytef*>(unused.data());
    stream.avail_out = piece;
    status = inflate(&stream, Z_NO_FLUSH);
  }
  const bool whole = stream.avail_in == 0 && packed_bytes == 0;
  inflateEnd(&stream);
  if (stream.total_out > most) fail("more than the {} bytes of memory of this machine", most);
  if (status == Z_DATA_ERROR) fail("compressed data that do not match their checksum");
  if (status != Z_STREAM_END) fail("compressed data that end too early");
  if (!whole) fail("compressed data that end before their variable");
}

}  // namespace

MatContainer check_mat(const std::filesystem::path& path) {
  enum Type : std::uint32_t { matrix = 14, compressed = 15 };
  std::ifstream file(path, std::ios::binary);
  if (is_hdf5(file)) return MatContainer::hdf5;
  const bool swap = swapped_bytes(file);
  const std::uint64_t size = std::filesystem::file_size(path);
  std::uint64_t at = mat_header_bytes;
  for (int number = 1; at < size; ++number) {
    std::array<char, 8> tag{};
    file.clear();
    file.seekg(static_cast<std::streamoff>(at));
    if (!file.read(tag.data(), tag.size())) fail("truncated in variable {}", number);
    const auto type = load_bytes<std::uint32_t>(tag.data(), swap), bytes = load_bytes<std::uint32_t>(&tag[4], swap);
    if (type != matrix && type != compressed) fail("variable {} is damaged: element of type {} found", number, type);
    at += tag.size() + bytes;
    if (at > size) fail("truncated in variable {}: {} bytes found, {} needed", number, size, at);
    try {
      if (type == compressed) check_compressed(file, bytes);
    } catch (const IoError& error) {
      fail("variable {} is damaged: {} found", number, error.what());
    }
  }
  return MatContainer::version5;
}

}  // namespace tokid::io
