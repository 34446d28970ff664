// Unpacks the chunks of an HDF5 data set that have filters. The library takes any unpacked bytes for a whole chunk.
// Here a chunk must have exactly its own bytes, or it is refused.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "io/hdf5_handles.hpp"

namespace tokid::io {

struct Filter {
  H5Z_filter_t kind;
  unsigned parameter;  // the first one: for shuffle the bytes of an item
};
// The filters of a data set in the order in which they pack, from its creation properties.
std::vector<Filter> filters_of(hid_t properties, const std::string& name);

// The shape of a chunk of this data set. \throws IoError for another rank, and for a chunk without values
std::vector<hsize_t> chunk_shape(hid_t properties, size_t rank, const std::string& name);

// Checks the index of chunks. Missing chunks would read as zeros, whether they were never written or the index is
// damaged. \throws IoError unless a data set of this shape has all of its chunks and no others
void check_index(hid_t data, const std::string& name, const Shape& shape, const std::vector<hsize_t>& chunk);

class PackedChunks {
 public:
  static bool knows(const std::vector<Filter>& filters);

  // Prepares the chunks of a data set for values of `memory_type`. The type and the data set must outlive this. As many
  // chunks as fit into `kept_bytes` are kept for the next parts. Empty for a data set in one piece, for chunks without
  // filters, and for filters other than deflate, shuffle and fletcher32.
  static std::optional<PackedChunks> of(hid_t data, const std::string& name, hid_t memory_type, size_t kept_bytes);

  // Row-major. \throws IoError for a damaged or missing chunk
  void read(const Hyperslab& part, void* to);
  void read_all(void* to);

 private:
  using Place = std::vector<hsize_t>;  // the first entry of a chunk
  using Bytes = std::vector<char>;

  PackedChunks(hid_t data, std::string name, hid_t memory_type, size_t kept_bytes, hid_t properties,
               std::vector<Filter> filters);
  const Bytes& chunk(const Place& place);
  void fetch(const Place& place);
  void unpack(std::uint32_t left_out);
  void convert();
  const Bytes& keep(const Place& place);
  void copy(const Bytes& chunk, const Place& place, const Hyperslab& part, char* to) const;
  [[noreturn]] void damaged(const std::string& found) const;

  hid_t data_, memory_type_;
  std::string name_;
  size_t kept_bytes_;
  Handle type_, space_;
  std::vector<Filter> filters_;
  Place size_, shape_;  // of the data set, of a chunk
  std::uint64_t file_bytes_ = 0;
  size_t items_ = 1, stored_item_, item_;  // values of a chunk; bytes of one in the file, in memory
  bool edges_unpacked_ = false;            // chunks that reach beyond the data set have no filters
  Bytes bytes_, other_;                    // of the current chunk
  // The last unpacked chunks are kept, because blocks of a data set end within chunks.
  std::map<Place, Bytes> kept_;
  std::deque<Place> order_;
};

}  // namespace tokid::io
