// Descriptors of open files, in addition to the descriptors of the libraries that read and write these files.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <utility>

#include "io/arrays.hpp"
#include "tokid/io.hpp"

namespace tokid::io {

// A descriptor that closes itself.
class Descriptor {
 public:
  explicit Descriptor(int number = -1) : number_(number) {}
  ~Descriptor() {
    if (number_ >= 0) close(number_);
  }
  Descriptor(Descriptor&& other) noexcept : number_(other.release()) {}
  Descriptor& operator=(Descriptor&& other) noexcept {
    std::swap(number_, other.number_);
    return *this;
  }

  int release() { return std::exchange(number_, -1); }
  operator int() const { return number_; }  // negative if no file is open

 private:
  int number_;
};

// Detects whether a file changes while tokid reads it. Otherwise the result would mix samples of the old and the new
// file. If the file becomes shorter, some libraries read zeros after its new end, and others report no error at all. If
// another file takes the name, the open file does not change.
class Unchanged {
 public:
  explicit Unchanged(const std::filesystem::path& path)
      : file_(open(path.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC)), before_(look()) {}

  int descriptor() const { return file_; }  // negative if the file could not be opened

  // \throws IoError if another program has changed the file since it was opened
  void check() const {
    const struct stat now = look();
    if (now.st_size < before_.st_size)
      fail("the file became shorter while it was read, from {} to {} bytes", before_.st_size, now.st_size);
    if (now.st_size != before_.st_size || now.st_mtim.tv_sec != before_.st_mtim.tv_sec ||
        now.st_mtim.tv_nsec != before_.st_mtim.tv_nsec)
      fail("the file changed while it was read");
  }

 private:
  struct stat look() const {
    struct stat found = {};
    if (file_ >= 0) fstat(file_, &found);
    return found;
  }

  Descriptor file_;
  struct stat before_;
};

}  // namespace tokid::io
