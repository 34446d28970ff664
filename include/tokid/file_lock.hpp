// A lock for a file: one process at a time reads, changes and writes it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>

namespace tokid {

struct LockOptions {
  double limit = 60.0;  // seconds to wait for another process; 0: do not wait
  // Called once when the wait begins, with a message that says who has the lock.
  std::function<void(const std::string&)> waits = {};
};

// While this object lives, no other FileLock on the same file can exist, in any process that can access the folder. The
// file need not exist yet. A lock is needed only to read a file and then replace it. Reading or saving alone needs no
// lock, because tokid replaces files as a whole. The lock is a hidden file in the folder, .tokid-….lock, and the
// destructor removes it. If a process dies, its lock ends at once. While the constructor waits, it calls checkpoint(),
// which can interrupt it.
class FileLock {
 public:
  // \throws IoError where another process has the lock for longer than the limit, std::invalid_argument for a limit
  // that is negative or NaN, WriteError where the file system does not support locks
  explicit FileLock(const std::filesystem::path& file, const LockOptions& options = {});
  ~FileLock();
  FileLock(FileLock&&) noexcept;
  FileLock& operator=(FileLock&&) = delete;

  const std::filesystem::path& path() const;

  // check(): \throws IoError if the file has changed since the constructor or the last see(). Such a change comes from
  // a program that does not use the lock. see() accepts the present content.
  void check() const;
  void see();

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace tokid
