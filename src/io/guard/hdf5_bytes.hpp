// Reads the bytes of an HDF5 file directly. It checks the values that the library trusts, before the library decodes
// them. Terms and layouts are those of the HDF5 File Format Specification, version 3.
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

  // Takes an object, and the size of its file. \throws IoError for a file whose addresses or sizes are not the usual
  // ones of 8 bytes
  Hdf5Bytes(hid_t object, std::string name, std::uint64_t file_bytes);

  // Checks the attributes of the object. The library takes as many bytes for an attribute as its type and size claim,
  // even beyond the header of the object. \throws IoError for an attribute that claims more than it has
  void check_attributes() const;

  // Position of the values of an attribute of the object; empty if it is not in the object's header.
  std::optional<Piece> attribute(std::string_view name) const;

  // Position of the values of a data set in one piece; empty for one in chunks, and for one that was never written.
  std::optional<Piece> values() const;

  // Checks a data set whose chunks have no filters. The library reads each chunk as if it had all of its bytes. If it
  // has fewer, the library reads the bytes beside it. \throws IoError for a chunk with fewer bytes than needed
  void check_chunks(std::uint64_t needed) const;

  // Checks texts of variable length, which are in heaps. The library takes memory for the length that an entry claims.
  // It follows the sizes of the objects in a heap wherever they lead, and copies as much as an object claims. \throws
  // IoError for a text that its heap does not hold
  void check_texts(const Piece& entries) const;

 private:
  void each_attribute(const std::function<void(std::string_view name, const Piece& values)>& see) const;
  // Calls `see` with each message of the header at this address.
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
  hsize_t base_ = 0;  // after the user block, such as MATLAB's: addresses count from here
  int descriptor_ = -1;
};

}  // namespace tokid::io
