// One caller at a time reads, changes and writes a file.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

namespace tokid {

struct LockOptions {
  double limit = 60.0;  // seconds to wait for the lock of somebody else; 0: none
  // Called once where the wait begins, with a message that says who has the lock.
  std::function<void(const std::string&)> waits = {};
};

// While it lives, no other FileLock has this file, in any process that reaches the folder. The file need not exist yet.
// Reading and saving alone need no lock: files are replaced whole. The lock is a hidden file in the folder,
// .tokid-….lock, which is removed at the end; a process that dies loses its lock at once. A wait can be interrupted
// (checkpoint()).
class FileLock {
 public:
  // \throws IoError where somebody else has the lock for longer than the limit, std::invalid_argument for a limit that
  // is negative or NaN, WriteError where the file system lets nothing be locked
  explicit FileLock(const std::filesystem::path& file, const LockOptions& options = {});
  ~FileLock();
  FileLock(FileLock&&) noexcept;
  FileLock& operator=(FileLock&&) = delete;

  const std::filesystem::path& path() const;

  // \throws IoError where the file is not the one that the lock has seen last, when it was made or by see(): a program
  // that asks for no lock has replaced or changed it
  void check() const;
  void see();

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace tokid
