// Writes HDF5 files in which every byte that is read again has a checksum of the format itself.
//
// HDF5 1.10 and later keep checksums in their metadata: superblock, headers of objects, indexes of chunks. Small data
// sets lie within the header of their object. Larger ones are chunked, and each chunk has a Fletcher-32 checksum. (HDF5
// File Format Specification, version 3.)
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <optional>

#include "io/hdf5_handles.hpp"

namespace tokid::io {

// Upper bound of the bytes that the array, or an array of numbers of this shape, takes in a file.
std::uint64_t stored_bytes(const Array& array);
std::uint64_t stored_bytes(const Shape& shape);

// Writes all values into a new data set. \throws IoError
Handle write_values(hid_t group, const std::string& name, const Shape& shape, hid_t stored_type, hid_t memory_type,
                    const void* values);

// A file that is written data set by data set. All of its space is reserved before the first one, so that a full disk
// shows early. The HDF5 library cannot close a file that it failed to write.
class Hdf5Sink {
 public:
  // Writes into an existing file, which may take so many bytes. The `user_block` (512 bytes or none) stands at its
  // beginning. \throws IoError if the disk lacks the room
  Hdf5Sink(const std::filesystem::path& path, std::uint64_t bytes, std::string user_block = {});

  hid_t file() const { return *file_; }
  void write(const std::string& name, const Array& array);

  // A data set of doubles. Its rows, the entries of the first axis, are written from time to time.
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
