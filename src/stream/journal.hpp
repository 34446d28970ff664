// What a stream has finished, in a file beside the model, from which a later call goes on.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "io/atomic_file.hpp"

namespace tokid::stream {

// Records with their checksums, read one after the other as long as they are whole, and added behind. A process that
// dies, or a power cut, costs no more than those at the end. docs/formats.md has the bytes.
class Journal {
 public:
  // Opens the journal of this model, or makes one. It stays when this ends, unless it holds no record. `about`: the
  // text of a JSON object of all that decides about the records. \throws IoError for a file that is no journal, is one
  // of something else, or is in use by another process; WriteError
  Journal(const std::filesystem::path& model, const std::string& about);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  static std::filesystem::path path_of(const std::filesystem::path& model);

  // The next one that was kept; empty behind the last one that is whole.
  std::optional<std::string> next();
  // Behind all that were kept. \throws WriteError, and has all of them still
  void add(std::string_view record);
  void remove();

 private:
  void open();
  void begin(const std::string& about);
  void cut(std::int64_t at);
  bool has_more();
  void append(std::string_view record);

  std::filesystem::path path_;
  io::Descriptor file_;
  std::int64_t end_ = 0;       // of what was read or added so far
  std::uint64_t records_ = 0;  // among them, the first of which is `about`
  std::chrono::steady_clock::time_point synced_ = std::chrono::steady_clock::now();
};

}  // namespace tokid::stream
