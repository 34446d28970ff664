// Stores the finished blocks of a stream in a file next to the model, so that a later call can continue.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>

#include "io/guard/atomic_file.hpp"

namespace tokid::stream {

// A file of records with their checksums. It is read record by record up to the first incomplete or damaged record. New
// records are then written from there on. If a process dies or the power fails, only the last records are lost.
// docs/formats.md describes the bytes.
class Journal {
 public:
  // Opens the journal of this model, or creates it. The destructor removes the file if it contains no record of a
  // block. \throws IoError if the file is no journal or another process uses it; WriteError
  explicit Journal(const std::filesystem::path& model);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  const std::filesystem::path& path() const { return path_; }

  // Must be called first. `about`: the text of a JSON object with everything that affects the records. \throws IoError
  // if the journal has records for another `about`, WriteError
  void begin(const std::string& about);
  // The next record of an earlier call; empty after the last whole record.
  std::optional<std::string> next();
  // Appends a record. \throws WriteError; all earlier records remain
  void add(std::string_view record);
  void remove();
  // Removes the journal of this model, if there is one and no process uses it.
  static void discard(const std::filesystem::path& model);

 private:
  void open();
  void check_magic();
  void restart(const std::string& about);
  void append(std::string_view record);

  std::filesystem::path path_;
  io::Descriptor file_;
  std::int64_t end_ = 0;       // position after the last record that was read or added
  std::uint64_t records_ = 0;  // number of the records up to end_; the first record is `about`
  std::optional<std::string> about_;
  bool kept_ = false;    // the destructor keeps the file: it has records after `about`, or is no journal
  bool reading_ = true;  // the file may have more bytes after end_, unread or damaged
  std::chrono::steady_clock::time_point synced_ = std::chrono::steady_clock::now();
};

}  // namespace tokid::stream
