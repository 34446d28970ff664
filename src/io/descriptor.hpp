// A file that is open to be looked at, beside the library that reads it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cstdint>
#include <filesystem>

#include "arrays.hpp"

namespace tokid::io {

class Descriptor {
 public:
  explicit Descriptor(const std::filesystem::path& path)
      : number_(open(path.c_str(), O_RDONLY | O_CLOEXEC)), before_(bytes()) {}
  ~Descriptor() {
    if (number_ >= 0) ::close(number_);
  }
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  int number() const { return number_; }  // negative where it could not be opened

  // Some libraries take what lies behind the end of a file for zeros, others for all that there is.
  // \throws IoError where another program has cut the file since it was opened
  void check_length() const {
    if (const std::int64_t now = bytes(); now >= 0 && now < before_)
      fail("the file became shorter while it was read, from {} to {} bytes", before_, now);
  }

 private:
  std::int64_t bytes() const {
    struct stat found;
    return number_ >= 0 && fstat(number_, &found) == 0 ? std::int64_t(found.st_size) : -1;
  }

  int number_;
  std::int64_t before_;
};

// What `read` returns, if the file was whole to the end.
template <typename Read>
auto read_whole(const std::filesystem::path& path, Read&& read) {
  const Descriptor descriptor(path);
  auto found = read();
  descriptor.check_length();
  return found;
}

}  // namespace tokid::io
