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

// While this object lives, no other FileLock has this file, in any process that can access the folder. The file need
// not exist yet. Reading alone or saving alone needs no lock, because files are replaced as a whole. The lock is a
// hidden file in the folder, .tokid-….lock, and the destructor removes it. A process that dies loses its lock at once.
// A wait can be interrupted (checkpoint()).
class FileLock {
 public:
  // \throws IoError where another process has the lock for longer than the limit, std::invalid_argument for a limit
  // that is negative or NaN, WriteError where the file system does not support locks
  explicit FileLock(const std::filesystem::path& file, const LockOptions& options = {});
  ~FileLock();
  FileLock(FileLock&&) noexcept;
  FileLock& operator=(FileLock&&) = delete;

  const std::filesystem::path& path() const;

  // check() throws if the file has changed since the lock was made, or since the last see(). Then a program without a
  // lock has replaced or changed it. \throws IoError
  void check() const;
  void see();

 private:
  struct Content;
  std::unique_ptr<Content> content_;
};

}  // namespace tokid
