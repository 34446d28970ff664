// Writes HDF5 files in which HDF5's own checksums protect every byte that is read again.
//
// HDF5 1.10 and later write checksums for their metadata: superblock, headers of objects, indexes of chunks. Small data
// sets are stored in the header of their object. Larger data sets are stored in chunks, and each chunk has a
// Fletcher-32 checksum (HDF5 File Format Specification, version 3).
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>

#include "io/hdf5_handles.hpp"

namespace tokid::io {

// Upper bound of the bytes that an array takes in a file. The second function is for numbers of this shape.
std::uint64_t stored_bytes(const Array& array);
std::uint64_t stored_bytes(const Shape& shape);

// Writes all values into a new data set. \throws IoError
Handle write_values(hid_t group, const std::string& name, const Shape& shape, hid_t stored_type, hid_t memory_type,
                    const void* values);

// A file that is written data set by data set. Its disk space is reserved before the first data set is written, so that
// a full disk causes an error early. A later error would be worse: the HDF5 library cannot close a file after a failed
// write.
class Hdf5Sink {
 public:
  // Writes into an existing file, and reserves `bytes` bytes for it. `user_block` (512 bytes or none) becomes the
  // beginning of the file. \throws IoError if the disk has too little space
  Hdf5Sink(const std::filesystem::path& path, std::uint64_t bytes, std::string user_block = {});

  hid_t file() const { return *file_; }
  void write(const std::string& name, const Array& array);

  // A data set of doubles whose rows (entries of the first axis) are written in several calls.
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
