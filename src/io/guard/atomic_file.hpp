// Writes files that appear whole or not at all.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "io/guard/descriptor.hpp"

namespace tokid::io {

// \throws WriteError with the system's reason, or that of a library
[[noreturn]] void fail_to_write(int error);
[[noreturn]] void fail_to_write(std::string_view reason);

void write_all(int file, std::string_view bytes);  // \throws WriteError
// Reads as many bytes as `to` holds, from `offset` on. False: the file has fewer bytes, or cannot be read.
bool read_all(int file, std::string& to, std::int64_t offset);

std::filesystem::path resolved(std::filesystem::path path);  // follows links, whether their target exists or not
// A hidden name beside the target. It is short, so that it fits wherever the target's name does.
std::filesystem::path hidden_name(const std::filesystem::path& target, std::string_view ending);

// Locks the whole file until the descriptor is closed. The lock belongs to the descriptor, not to the process. Locks of
// other kinds do not see it. False: errno has the reason.
bool lock(int file, bool wait);
bool is_at(const std::filesystem::path& path, int file);
// Reserves room for so many bytes. \throws WriteError if the disk lacks it, but not if this cannot be found out
void reserve(const std::filesystem::path& path, std::uint64_t bytes);
void sync_folder(const std::filesystem::path& file);  // syncs the folder of this file, and so its name

// An empty file in the folder of the target. commit() makes it the target. Without commit() it vanishes, at the latest
// with the process. It has no name until then, if the file system supports this. Otherwise it has a hidden name: if a
// process was killed, the next call for the same target removes its file. The permissions and the group are those of
// the target that it replaces. If it cannot have that group, the group gets no permissions. Without a target the
// permissions follow the umask.
class AtomicFile {
 public:
  // \throws IoError for a target that is no file, WriteError if nothing can be written
  explicit AtomicFile(const std::filesystem::path& target);
  ~AtomicFile();
  AtomicFile(AtomicFile&&) = default;
  AtomicFile& operator=(AtomicFile&&) = delete;

  const std::filesystem::path& path() const { return path_; }  // write here, and close before commit()
  const std::filesystem::path& target() const { return target_; }
  // The target appears at once, or when the FilesTogether of this thread are committed.
  void commit();
  // Calls `then` when the targets of all earlier commits have appeared: at once, or after those of the FilesTogether.
  static void when_published(std::function<void()> then);
  void publish();

 private:
  void create_unnamed();
  void create_named();
  void finish();
  bool take_temporary_name();
  void move_to_named();

  std::filesystem::path target_, path_;
  std::filesystem::path name_;      // until it gets the target's; empty: none
  std::optional<struct stat> old_;  // of the existing target
  Descriptor file_;
};

// Writes plain bytes into an existing file. Unlike streams, it knows why a write failed.
class ByteWriter {
 public:
  explicit ByteWriter(const std::filesystem::path& path);

  void write(std::string_view bytes) { write_all(file_, bytes); }
  void rewind();  // the next write replaces the first bytes

 private:
  Descriptor file_;
};

}  // namespace tokid::io
