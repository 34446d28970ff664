// Unpacks the chunks of an HDF5 data set that have filters. If a chunk unpacks to a wrong number of bytes, the HDF5
// library reports no error. The class PackedChunks refuses such a chunk.
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
  unsigned parameter;  // the first parameter of the filter: for shuffle, the bytes of an item
};
// The filters in the creation properties of a data set, in the order in which they pack.
std::vector<Filter> filters_of(hid_t properties, const std::string& name);

// The shape of a chunk of this data set. \throws IoError if the rank is not `rank`, or if a chunk has no values
std::vector<hsize_t> chunk_shape(hid_t properties, size_t rank, const std::string& name);

// Checks the index of chunks. The library reads a missing chunk as zeros, whether it was never written or the index is
// damaged. \throws IoError unless the index has all chunks of a data set of this shape, and no other chunks
void check_index(hid_t data, const std::string& name, const Shape& shape, const std::vector<hsize_t>& chunk);

class PackedChunks {
 public:
  static bool knows(const std::vector<Filter>& filters);

  // Prepares reading a data set as values of `memory_type`. The type and the data set must outlive the result. As many
  // unpacked chunks as fit into `kept_bytes` stay in memory for later calls of read(). Empty for a data set in one
  // piece, for chunks without filters, and for filters other than deflate, shuffle and fletcher32.
  static std::optional<PackedChunks> of(hid_t data, const std::string& name, hid_t memory_type, size_t kept_bytes);

  // The values are in row-major order. \throws IoError for a damaged or missing chunk
  void read(const Hyperslab& part, void* to);
  void read_all(void* to);

 private:
  using Place = std::vector<hsize_t>;  // indices of the first entry of a chunk
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
  size_t items_ = 1, stored_item_, item_;  // values in a chunk; bytes of a value in the file, in memory
  bool edges_unpacked_ = false;            // the chunks that extend beyond the data set have no filters
  Bytes bytes_, other_;                    // bytes of the current chunk; working memory
  // The chunks that were unpacked last. The next block of steps often begins within the same chunks.
  std::map<Place, Bytes> kept_;
  std::deque<Place> order_;
};

}  // namespace tokid::io
