// HDF5 files as tokid writes them: every byte that is read again is under a checksum of the format itself.
//
// HDF5 1.10 and later keep checksums in what describes the data: superblock, headers of objects, indexes of chunks.
// Small data sets lie within the header of their object. Larger ones are chunked, and each chunk has a Fletcher-32
// checksum. (HDF5 File Format Specification, version 3.)
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>

#include "io/hdf5_handles.hpp"

namespace tokid::io {

// At most so many bytes of a file are taken for the array, or for one of numbers of this shape.
std::uint64_t stored_bytes(const Array& array);
std::uint64_t stored_bytes(const Shape& shape);

// A data set of its own for all of the values. \throws IoError
Handle write_values(hid_t group, const std::string& name, const Shape& shape, hid_t stored_type, hid_t memory_type,
                    const void* values);

// A file that is written data set by data set, with all of its space reserved before the first of them: a disk that is
// full shows before the HDF5 library depends on it, which can't close a file that it failed to write.
class Hdf5Sink {
 public:
  // Into a file that exists and may take so many bytes. The `user_block` (512 bytes or none) stands at its begin.
  // \throws IoError where the disk has not got them
  Hdf5Sink(const std::filesystem::path& path, std::uint64_t bytes, std::string user_block = {});

  hid_t file() const { return *file_; }
  void write(const std::string& name, const Array& array);

  // A data set of doubles whose rows, the entries of its first axis, are written from time to time.
  class Rows {
   public:
    Rows(const Hdf5Sink& sink, const std::string& name, const Shape& shape);
    void write(Index row, Index count, const double* values) const;

   private:
    std::string name_;
    Shape shape_;
    Handle data_;
  };

  void close();

 private:
  std::filesystem::path path_;
  std::string user_block_;
  std::optional<Handle> file_;
};

}  // namespace tokid::io
