// Reads the bytes of an HDF5 file directly. It checks the sizes that the HDF5 library uses without a check, before the
// library decodes them. Terms and layouts are those of the HDF5 File Format Specification, version 3.
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

  // `object`: an open object of the file. `file_bytes`: the size of the file. \throws IoError if the addresses or sizes
  // in the file do not have 8 bytes
  Hdf5Bytes(hid_t object, std::string name, std::uint64_t file_bytes);

  // Checks the attributes of the object. The library reads as many bytes of an attribute as its type and size state,
  // even beyond the end of the object's header. \throws IoError for an attribute that states more bytes than it has
  void check_attributes() const;

  // Position of the values of an attribute of the object; empty if it is not in the object's header.
  std::optional<Piece> attribute(std::string_view name) const;

  // Position of the values of a data set that is stored in one piece. Empty for a data set in chunks, and for a data
  // set whose values were never written.
  std::optional<Piece> values() const;

  // Checks a data set whose chunks have no filters. The library always reads a whole chunk. If fewer bytes are stored,
  // the library reads other bytes behind them. \throws IoError for a chunk with fewer bytes than `needed`
  void check_chunks(std::uint64_t needed) const;

  // Checks texts of variable length, which are stored in heaps. The library allocates as much memory as an entry
  // states, and it copies as many bytes as the object in the heap states. It uses the sizes of these objects to find
  // the next object, even beyond the end of the heap. \throws IoError for a text that its heap does not contain
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
  hsize_t base_ = 0;  // addresses count from the end of the user block, which MATLAB's files have
  int descriptor_ = -1;
};

}  // namespace tokid::io
