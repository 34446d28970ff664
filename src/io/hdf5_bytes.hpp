// An HDF5 file as the bytes that it consists of: what the library trusts is looked at before the library decodes it.
// Terms and layouts are those of the HDF5 File Format Specification, version 3.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>

#include "io/hdf5_handles.hpp"

namespace tokid::io {

class Hdf5Bytes {
 public:
  struct Piece {
    std::uint64_t offset = 0, bytes = 0;
  };

  // Of an object and of the file that it lies in. \throws IoError for a file with addresses or sizes other than the
  // usual ones of 8 bytes
  Hdf5Bytes(hid_t object, std::string name, std::uint64_t file_bytes);

  // The library takes as many bytes for an attribute as its type and size claim, wherever the header of the object
  // ends. \throws IoError for one that claims more than it has
  void check_attributes() const;

  // Where the values of an attribute of the object lie; empty for one that is not in its header.
  std::optional<Piece> attribute(std::string_view name) const;

  // Of a data set in one piece; empty for one in chunks, and for one that was never written.
  std::optional<Piece> values() const;

  // Of a data set whose chunks no filter packs: each is read as if it had all of its bytes, and of one with fewer the
  // library reads what lies beside them. \throws IoError for one that has fewer than are needed
  void check_chunks(std::uint64_t needed) const;

  // Entries refer to texts of variable length in heaps. The library takes memory for the length that an entry claims,
  // walks from one object of a heap to the next wherever their sizes lead, and copies as much as the object says.
  // \throws IoError for a text that its heap does not hold
  void check_texts(const Piece& entries) const;

 private:
  void each_attribute(const std::function<void(std::string_view name, const Piece& values)>& see) const;
  // Of the header at this place of the file.
  using Use = std::function<void(unsigned type, unsigned flags, const Piece&)>;
  void each_message(std::uint64_t address, const Use& see) const;
  std::uint64_t address() const;
  Piece layout_piece() const;
  std::optional<std::uint64_t> committed_bytes(std::string_view reference) const;
  std::map<std::uint64_t, std::uint64_t> heap(std::uint64_t address, std::uint64_t& total) const;
  std::string read(std::uint64_t offset, std::uint64_t bytes) const;
  [[noreturn]] void damaged(std::string_view what) const;

  hid_t object_;
  std::string name_;
  std::uint64_t file_bytes_;
  hsize_t base_ = 0;  // behind the block of a user, MATLAB's: from there addresses count
  int descriptor_ = -1;
};

}  // namespace tokid::io
