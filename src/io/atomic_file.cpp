// SPDX-License-Identifier: BSD-3-Clause
#include "atomic_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <system_error>

#include "arrays.hpp"

namespace tokid::io {

namespace fs = std::filesystem;

namespace {

std::string reason(int error) { return std::generic_category().message(error); }

// Rename would silently replace what the user can't write to, or what is no file at all.
fs::path writable_target(const fs::path& path) {
  std::error_code error;
  fs::path target = fs::is_symlink(path, error) ? fs::weakly_canonical(path, error) : path;
  const auto status = fs::status(target, error);
  if (fs::is_directory(status)) fail("a directory found, the name of a file to write needed");
  if (fs::exists(status) && !fs::is_regular_file(status)) fail("a device found, the name of a file to write needed");
  if (fs::exists(status) && access(target.c_str(), W_OK) != 0) fail("can't be written: {}", reason(errno));
  return target;
}

// The names are short, so that they fit wherever the target's does.
fs::path create_beside(const fs::path& target) {
  static std::atomic<unsigned> counter{0};
  const fs::path directory = target.has_parent_path() ? target.parent_path() : fs::path(".");
  for (;;) {
    fs::path path = directory / fmt::format(".tokid-{}-{}.tmp", getpid(), counter++);
    const int fd = open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd >= 0) return close(fd), path;
    if (errno != EEXIST) fail("can't be written: directory '{}': {}", directory.string(), reason(errno));
  }
}

int sync(const fs::path& path, int flags) {
  const int fd = open(path.c_str(), flags | O_CLOEXEC);
  if (fd < 0) return errno;
  const int error = fsync(fd) == 0 ? 0 : errno;
  close(fd);
  // Some file systems know no fsync; that is no failure of the writing.
  return error == EINVAL || error == ENOTSUP ? 0 : error;
}

}  // namespace

AtomicFile::AtomicFile(const fs::path& target) : target_(writable_target(target)), temporary_(create_beside(target_)) {}

AtomicFile::~AtomicFile() {
  if (!temporary_.empty()) unlink(temporary_.c_str());
}

void AtomicFile::commit() {
  if (const int error = sync(temporary_, O_RDWR)) fail("can't be written: {}", reason(error));
  if (rename(temporary_.c_str(), target_.c_str()) != 0) fail("can't be written: {}", reason(errno));
  temporary_.clear();
  // The file is in place; that its name outlives a power cut is more than was promised.
  sync(target_.has_parent_path() ? target_.parent_path() : fs::path("."), O_RDONLY | O_DIRECTORY);
}

ByteWriter::ByteWriter(const fs::path& path) : fd_(open(path.c_str(), O_WRONLY | O_TRUNC | O_CLOEXEC)) {
  if (fd_ < 0) fail("can't be written: {}", reason(errno));
}

ByteWriter::~ByteWriter() { close(fd_); }

void ByteWriter::write(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(fd_, bytes.data(), bytes.size());
    if (n < 0 && errno != EINTR) fail("can't be written: {}", reason(errno));
    if (n > 0) bytes.remove_prefix(static_cast<size_t>(n));
  }
}

}  // namespace tokid::io
