// Keeps the finished blocks of a stream in a file beside the model, so that a later call can continue.
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

// A file of records with their checksums. It is read record by record as long as the records are whole, and new records
// are appended. If a process dies or the power fails, only the last records are lost. Records from the first damaged
// one on are written again. docs/formats.md describes the bytes.
class Journal {
 public:
  // Opens the journal of this model, or makes one. The destructor keeps the file, unless it holds no record. \throws
  // IoError for a file that is no journal, or is in use by another process; WriteError
  explicit Journal(const std::filesystem::path& model);
  ~Journal();
  Journal(const Journal&) = delete;
  Journal& operator=(const Journal&) = delete;

  const std::filesystem::path& path() const { return path_; }

  // Must be called first. `about`: the text of a JSON object with everything that affects the records. \throws IoError
  // for a journal of something else, WriteError
  void begin(const std::string& about);
  // The next record of an earlier call; empty after the last whole record.
  std::optional<std::string> next();
  // Appends a record after all others. \throws WriteError, and keeps all earlier records
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
  std::int64_t end_ = 0;       // of the records read or added so far
  std::uint64_t records_ = 0;  // number of these records; the first one is `about`
  std::optional<std::string> about_;
  bool kept_ = false;    // more records than `about`
  bool reading_ = true;  // the file after end_ is not read yet, or is damaged
  std::chrono::steady_clock::time_point synced_ = std::chrono::steady_clock::now();
};

}  // namespace tokid::stream
