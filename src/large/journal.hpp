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
// dies, or a power cut, costs no more than those at the end; from the first one that is damaged on they are written
// anew. docs/formats.md has the bytes.
class Journal {
 public:
  // Opens the journal of this model, or makes one. It stays when this ends, unless it holds no record. \throws IoError
  // for a file that is no journal, or is in use by another process; WriteError
  explicit Journal(const std::filesystem::path& model);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  const std::filesystem::path& path() const { return path_; }

  // Before all else. `about`: the text of a JSON object of all that decides about the records. \throws IoError for a
  // journal of something else, WriteError
  void begin(const std::string& about);
  // The next one that was kept; empty behind the last one that is whole.
  std::optional<std::string> next();
  // Behind all that were kept. \throws WriteError, and has all of them still
  void add(std::string_view record);
  void remove();
  // Of this model, if there is one that nobody is at.
  static void discard(const std::filesystem::path& model);

 private:
  void open();
  void check_magic();
  void restart(const std::string& about);
  void append(std::string_view record);

  std::filesystem::path path_;
  io::Descriptor file_;
  std::int64_t end_ = 0;       // of what was read or added so far
  std::uint64_t records_ = 0;  // among them, the first of which is `about`
  std::optional<std::string> about_;
  bool kept_ = false;    // more than `about`
  bool reading_ = true;  // what lies behind end_ is not looked at yet, or damaged
  std::chrono::steady_clock::time_point synced_ = std::chrono::steady_clock::now();
};

}  // namespace tokid::stream
