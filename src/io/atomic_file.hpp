// Writing files that appear whole or not at all.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <string_view>

namespace tokid::io {

// An empty temporary file beside the target, which replaces the target on commit() and is removed otherwise. Its
// permissions follow the umask.
class AtomicFile {
 public:
  explicit AtomicFile(const std::filesystem::path& target);  // \throws IoError where nothing can be written
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  const std::filesystem::path& path() const { return temporary_; }  // write here, and close before commit()
  void commit();

 private:
  std::filesystem::path target_, temporary_;
};

// Plain bytes into a file that exists. Unlike streams, it knows why a write failed.
class ByteWriter {
 public:
  explicit ByteWriter(const std::filesystem::path& path);
  ~ByteWriter();
  ByteWriter(const ByteWriter&) = delete;
  ByteWriter& operator=(const ByteWriter&) = delete;

  void write(std::string_view bytes);

 private:
  int fd_;
};

}  // namespace tokid::io
