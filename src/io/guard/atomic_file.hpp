// Writes files that appear completely or not at all.
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

// \throws WriteError with the reason of the system, or with that of a library
[[noreturn]] void fail_to_write(int error);
[[noreturn]] void fail_to_write(std::string_view reason);

void write_all(int file, std::string_view bytes);  // \throws WriteError
// Fills `to` with bytes from `offset` on. False: the file has too few bytes, or cannot be read.
bool read_all(int file, std::string& to, std::int64_t offset);

std::filesystem::path resolved(std::filesystem::path path);  // follows links, even if their target does not exist
// A hidden name in the folder of the target. The name is short, so that it is valid wherever the target's name is
// valid.
std::filesystem::path hidden_name(const std::filesystem::path& target, std::string_view ending);

// Locks the whole file until the descriptor is closed. The lock belongs to the descriptor, not to the process. flock()
// does not see this lock. False: errno has the reason.
bool lock(int file, bool wait);
bool is_at(const std::filesystem::path& path, int file);
// Reserves disk space for `bytes` bytes. \throws WriteError if the disk has too little space; not if the file system
// cannot reserve space
void reserve(const std::filesystem::path& path, std::uint64_t bytes);
void sync_folder(const std::filesystem::path& file);  // writes the folder, and so the name of the file, to the disk

// An empty file in the folder of the target. commit() moves the file to the target. Without commit(), the file
// vanishes, at the latest when the process ends. If the file system supports this, the file has no name before
// commit(). Otherwise it has a hidden name; if the process is killed, the next call for the same target removes the
// file. A new file gets the permissions and the group of the target that it replaces. If it cannot get this group, its
// group gets no permissions. If there is no target, the permissions follow the umask.
class AtomicFile {
 public:
  // \throws IoError if the target is a folder or a device, WriteError if nothing can be written
  explicit AtomicFile(const std::filesystem::path& target);
  ~AtomicFile();
  AtomicFile(AtomicFile&&) = default;
  AtomicFile& operator=(AtomicFile&&) = delete;

  const std::filesystem::path& path() const { return path_; }  // write to this path, and close the file before commit()
  const std::filesystem::path& target() const { return target_; }
  // The target appears at once. If the thread has a FilesTogether, the target appears when the FilesTogether is
  // committed.
  void commit();
  // Calls `then` when the targets of all earlier commits have appeared. If the thread has a FilesTogether, this is
  // after its commit; otherwise it is at once.
  static void when_published(std::function<void()> then);
  void publish();

 private:
  void create_unnamed();
  void create_named();
  void finish();
  bool take_temporary_name();
  void move_to_named();

  std::filesystem::path target_, path_;
  std::filesystem::path name_;      // the hidden name before commit(); empty if the file has no name
  std::optional<struct stat> old_;  // status of the target that existed before
  Descriptor file_;
};

// Writes plain bytes into an existing file. Unlike std::ofstream, it reports why a write failed.
class ByteWriter {
 public:
  explicit ByteWriter(const std::filesystem::path& path);

  void write(std::string_view bytes) { write_all(file_, bytes); }
  void rewind();  // the next write starts at the first byte

 private:
  Descriptor file_;
};

}  // namespace tokid::io
