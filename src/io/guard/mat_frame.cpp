// SPDX-License-Identifier: BSD-3-Clause
#include "io/guard/mat_frame.hpp"

#include <zlib.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <string_view>
#include <utility>
#include <vector>

#include "io/arrays.hpp"

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

// ---- the bytes of a variable, one after the other ----

class Source {
 public:
  virtual ~Source() = default;
  virtual void read(char* to, size_t bytes) = 0;  // \throws IoError if fewer bytes are left
  virtual void skip(std::uint64_t bytes) = 0;
};

class Plain : public Source {
 public:
  explicit Plain(std::istream& file) : file_(file) {}
  void read(char* to, size_t bytes) override {
    if (!file_.read(to, std::streamsize(bytes))) fail("truncated");
  }
  void skip(std::uint64_t bytes) override { file_.seekg(std::streamoff(bytes), std::ios::cur); }

 private:
  std::istream& file_;
};

class Inflated : public Source {
 public:
  Inflated(std::istream& file, std::uint64_t packed_bytes) : file_(file), left_(packed_bytes) {
    if (inflateInit(&stream_) != Z_OK) fail("zlib can't be used");
  }
  ~Inflated() override { inflateEnd(&stream_); }
  Inflated(const Inflated&) = delete;
  Inflated& operator=(const Inflated&) = delete;

  void read(char* to, size_t bytes) override {
    stream_.next_out = reinterpret_cast<Bytef*>(to);
    stream_.avail_out = uInt(bytes);
    while (stream_.avail_out > 0) {
      if (stream_.avail_in == 0) refill();
      const int status = inflate(&stream_, Z_NO_FLUSH);
      if (status != Z_OK && !(status == Z_STREAM_END && stream_.avail_out == 0))
        fail("compressed data that end too early or are damaged");
    }
  }
  void skip(std::uint64_t bytes) override {
    for (; bytes > 0; bytes -= std::min<std::uint64_t>(bytes, unused_.size()))
      read(unused_.data(), size_t(std::min<std::uint64_t>(bytes, unused_.size())));
  }
  // Reads to the end, where zlib compares its checksum (Adler-32). \throws IoError if the checksum is wrong, or if the
  // packed bytes do not end there
  void finish() {
    for (int status = Z_OK; status != Z_STREAM_END;) {
      stream_.next_out = reinterpret_cast<Bytef*>(unused_.data());
      stream_.avail_out = uInt(unused_.size());
      if (stream_.avail_in == 0 && left_ > 0) refill();
      status = inflate(&stream_, Z_NO_FLUSH);
      if (status != Z_OK && status != Z_STREAM_END)
        fail("compressed data that {}", status == Z_BUF_ERROR ? "end too early" : "do not match their checksum");
    }
    if (stream_.avail_in > 0 || left_ > 0) fail("compressed data that end too early");
  }

 private:
  void refill() {
    const auto bytes = std::streamsize(std::min<std::uint64_t>(left_, packed_.size()));
    if (bytes == 0 || !file_.read(packed_.data(), bytes)) fail("compressed data that end too early");
    left_ -= std::uint64_t(bytes);
    stream_.next_in = reinterpret_cast<Bytef*>(packed_.data());
    stream_.avail_in = uInt(bytes);
  }

  static constexpr size_t piece = size_t{1} << 16;
  std::istream& file_;
  std::uint64_t left_;
  std::vector<char> packed_ = std::vector<char>(piece), unused_ = std::vector<char>(piece);
  z_stream stream_{};
};

// ---- elements ----

enum Type : std::uint32_t { int8 = 1, int32 = 5, uint32 = 6, matrix = 14, compressed = 15 };
enum Class : std::uint32_t {
  cell = 1,
  structure = 2,
  object = 3,
  characters = 4,
  sparse = 5,
  function = 16,
  opaque = 17
};

// Checks the elements of one variable, which may contain further elements. `left`: bytes that are left in the element
// around the current one.
class Walker {
 public:
  Walker(Source& source, bool swap) : source_(source), swap_(swap) {}

  // Checks a variable or a cell, from behind its tag on.
  void check_matrix(std::uint64_t bytes, int depth) {
    constexpr int deepest = 32;
    constexpr std::uint32_t most_dimensions = 32, longest_name = 4096, is_complex = 1 << 11;
    if (depth > deepest) fail("more than {} cells or structs within each other", deepest);
    if (bytes == 0) return;  // an empty cell
    std::uint64_t left = bytes;
    const auto flags = words(left, uint32, 2, 2);
    const std::uint32_t kind = flags[0] & 0xFF;
    if (kind > opaque) fail("class {}", kind);
    std::uint64_t count = 1;
    if (kind != opaque)
      for (const std::uint32_t n : words(left, int32, 1, most_dimensions)) {
        if (n > 0x7FFFFFFF) fail("a negative dimension");
        if (n > 0 && count > (std::uint64_t{1} << 62) / n) fail("sizes beyond any memory");
        count *= n;
      }
    const Tag name = tag(left);
    if (name.type != int8 || name.bytes > longest_name) fail("a name of type {} with {} bytes", name.type, name.bytes);
    skip(left);
    if (kind >= function) return source_.skip(left);  // tokid does not use functions and objects of MATLAB
    if (kind == cell) return check_matrices(count, left, depth);
    if (kind == structure || kind == object) return check_structure(kind, count, left, depth);
    // Now numbers follow, of which only the size is checked. A sparse matrix has two lists of indices before its
    // numbers.
    const int parts = (kind == sparse ? 3 : 1) + ((flags[0] & is_complex) != 0 ? 1 : 0);
    if (count > 0 && left == 0 && kind != characters) fail("no values, {} needed", count);
    for (int part = 0; part < parts && left > 0; ++part) {
      const Tag found = tag(left);
      // Numbers take at least one byte each. An array of characters may be stored with fewer bytes than it has
      // characters.
      if (part == 0 && kind != sparse && kind != characters && found.bytes < count)
        fail("{} values of {} needed", found.bytes, count);
      if (depth == 0 && part + 1 == parts) return;  // the numbers of a variable may be many; they are not read
      skip(left);
    }
    source_.skip(left);
  }

 private:
  struct Tag {
    std::uint32_t type, bytes;
  };

  // Reads a tag. Up to four bytes of values are in the tag itself, more bytes follow the tag. skip() continues after
  // the values.
  Tag tag(std::uint64_t& left) {
    std::array<char, 8> raw{};
    take(left, raw.size());
    source_.read(raw.data(), raw.size());
    const auto first = load_bytes<std::uint32_t>(raw.data(), swap_);
    if (const std::uint32_t few = first >> 16; few > 0) {
      if (few > 4) fail("an element of {} bytes in four", few);
      std::copy(raw.begin() + 4, raw.end(), within_.begin());
      pending_ = 0;
      return {first & 0xFFFF, few};
    }
    const auto bytes = load_bytes<std::uint32_t>(raw.data() + 4, swap_);
    const bool padded = (first != matrix && first != compressed);
    pending_ = padded ? (std::uint64_t{bytes} + 7) / 8 * 8 : bytes;
    if (bytes > left) fail("an element of {} bytes in {}", bytes, left);
    pending_ = std::min(pending_, left);
    take(left, pending_);
    return {first, bytes};
  }

  void skip(std::uint64_t&) { source_.skip(std::exchange(pending_, 0)); }

  std::vector<std::uint32_t> words(std::uint64_t& left, Type type, size_t least, size_t most) {
    const Tag found = tag(left);
    const size_t count = found.bytes / 4;
    if (found.type != type || found.bytes % 4 != 0 || count < least || count > most)
      fail("an element of type {} with {} bytes", found.type, found.bytes);
    std::vector<char> raw(std::max<size_t>(pending_, 4));
    if (pending_ > 0)
      source_.read(raw.data(), size_t(std::exchange(pending_, 0)));
    else
      std::copy(within_.begin(), within_.end(), raw.begin());
    std::vector<std::uint32_t> values;
    for (size_t i = 0; i < count; ++i) values.push_back(load_bytes<std::uint32_t>(raw.data() + 4 * i, swap_));
    return values;
  }

  void check_matrices(std::uint64_t count, std::uint64_t left, int depth) {
    constexpr std::uint64_t tag_bytes = 8;
    if (count > left / tag_bytes) fail("{} cells in {} bytes", count, left);
    for (; count > 0; --count) {
      const Tag found = tag(left);
      if (found.type != matrix) fail("an element of type {} for a cell", found.type);
      pending_ = 0;
      check_matrix(found.bytes, depth + 1);
    }
    source_.skip(left);
  }

  void check_structure(std::uint32_t kind, std::uint64_t count, std::uint64_t left, int depth) {
    constexpr std::uint32_t longest_field = 4096;
    if (kind == object) tag(left), skip(left);  // the name of the object's class
    const std::uint32_t length = words(left, int32, 1, 1)[0];
    const std::uint32_t names = tag(left).bytes;
    skip(left);
    if (length == 0 || length > longest_field || names % length != 0) fail("fields of {} in {} bytes", length, names);
    const std::uint64_t fields = names / length;
    if (fields > 0 && count > left / fields) fail("{} structs of {} fields in {} bytes", count, fields, left);
    check_matrices(count * fields, left, depth);
  }

  static void take(std::uint64_t& left, std::uint64_t bytes) {
    if (bytes > left) fail("an element of {} bytes in {}", bytes, left);
    left -= bytes;
  }

  Source& source_;
  bool swap_;
  std::array<char, 4> within_{};
  std::uint64_t pending_ = 0;  // bytes of the current element that are not read yet
};

// An element of the file, after its tag.
struct Element {
  int number;  // counted from 1
  std::uint32_t type, bytes;
};

void check_variable(std::istream& file, const Element& element, bool swap) {
  if (element.type == matrix) {
    Plain source(file);
    return Walker(source, swap).check_matrix(element.bytes, 0);
  }
  Inflated source(file, element.bytes);
  std::array<char, 8> inner{};
  source.read(inner.data(), inner.size());
  if (const auto found = load_bytes<std::uint32_t>(inner.data(), swap); found != matrix)
    fail("element of type {} found in a compressed one", found);
  Walker(source, swap).check_matrix(load_bytes<std::uint32_t>(inner.data() + 4, swap), 0);
}

// A file of version 5 is a header and a chain of elements with their sizes. The last element must end at the end of the
// file. This check is needed because matio reports no error for a broken chain: it assumes that the file ends there.
template <typename Check>
void each_element(std::istream& file, std::uint64_t size, bool swap, Check&& check) {
  std::uint64_t at = mat_header_bytes;
  for (int number = 1; at < size; ++number) {
    std::array<char, 8> tag{};
    file.clear();
    file.seekg(static_cast<std::streamoff>(at));
    if (!file.read(tag.data(), tag.size())) fail("truncated in variable {}", number);
    const Element element{number, load_bytes<std::uint32_t>(tag.data(), swap),
                          load_bytes<std::uint32_t>(tag.data() + 4, swap)};
    if (element.type != matrix && element.type != compressed)
      fail("variable {} is damaged: element of type {} found", number, element.type);
    at += tag.size() + element.bytes;
    if (at > size) fail("truncated in variable {}: {} bytes found, {} needed", number, size, at);
    try {
      check(element);
    } catch (const IoError& error) {
      fail("variable {} is damaged: {} found", number, error.what());
    }
  }
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

}  // namespace

MatContainer check_mat(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (is_hdf5(file)) return MatContainer::hdf5;
  const bool swap = swapped_bytes(file);
  each_element(file, std::filesystem::file_size(path), swap,
               [&](const Element& element) { check_variable(file, element, swap); });
  return MatContainer::version5;
}

void check_mat_checksums(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  each_element(file, std::filesystem::file_size(path), swapped_bytes(file), [&](const Element& element) {
    if (element.type == compressed) Inflated(file, element.bytes).finish();
  });
}

}  // namespace tokid::io
