// Writing files that appear whole or not at all.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <sys/stat.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "io/descriptor.hpp"

namespace tokid::io {

// \throws WriteError with the system's reason, or that of a library
[[noreturn]] void fail_to_write(int error);
[[noreturn]] void fail_to_write(std::string_view reason);

void write_all(int file, std::string_view bytes);  // \throws WriteError
// As many bytes as `to` holds, from `offset` on. False: the file has not so many, or can't be read.
bool read_all(int file, std::string& to, std::int64_t offset);

std::filesystem::path resolved(std::filesystem::path path);  // behind links, whether something is there or not
// Beside the target, and short, so that it fits wherever the target's name does.
std::filesystem::path hidden_name(const std::filesystem::path& target, std::string_view ending);

// A lock of the whole file, which ends with the descriptor. It belongs to this one, not to the process, and locks of
// other kinds don't see it. False: errno says why.
bool lock(int file, bool wait);
bool is_at(const std::filesystem::path& path, int file);
// Room for so many bytes. \throws WriteError where the disk has not got it, and not where it can't tell
void reserve(const std::filesystem::path& path, std::uint64_t bytes);
void sync_folder(const std::filesystem::path& file);  // that this one is in, with its name

// An empty file in the folder of the target that becomes the target on commit() and vanishes otherwise, with the
// process at the latest. It has no name until then, where the file system knows files without one; else a hidden one,
// which the next call for the same target takes away if a process was killed meanwhile. Its permissions and
// group are those of the target that it replaces, the group's permissions none where it can't be given that group;
// without a target they follow the umask.
class AtomicFile {
 public:
  // \throws IoError for a target that is no file, WriteError where nothing can be written
  explicit AtomicFile(const std::filesystem::path& target);
  ~AtomicFile();
  AtomicFile(AtomicFile&&) = default;
  AtomicFile& operator=(AtomicFile&&) = delete;

  const std::filesystem::path& path() const { return path_; }  // write here, and close before commit()
  const std::filesystem::path& target() const { return target_; }
  // The target is there at once, or when the FilesTogether of this thread are committed.
  void commit();
  // Calls what waits for the targets of all commits before: at once, or behind those of the FilesTogether.
  static void when_published(std::function<void()> then);
  void publish();

 private:
  void create_unnamed();
  void create_named();
  void finish();
  bool take_temporary_name();
  void move_to_named();

  std::filesystem::path target_, path_;
  std::filesystem::path name_;      // until it is the target's; empty: none
  std::optional<struct stat> old_;  // of the target that is there
  Descriptor file_;
};

// Plain bytes into a file that exists. Unlike streams, it knows why a write failed.
class ByteWriter {
 public:
  explicit ByteWriter(const std::filesystem::path& path);

  void write(std::string_view bytes) { write_all(file_, bytes); }
  void rewind();  // what is written next replaces the first bytes

 private:
  Descriptor file_;
};

}  // namespace tokid::io
