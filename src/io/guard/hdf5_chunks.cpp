// SPDX-License-Identifier: BSD-3-Clause
#include "io/guard/hdf5_chunks.hpp"

#include <zlib.h>

#include <algorithm>
#include <cstring>

namespace tokid::io {

namespace {

constexpr size_t checksum_bytes = 4;

// Calls `use` with each place from `begin` to `end`, in steps of `step`. The last axis changes fastest.
template <typename Use>
void each_place(const std::vector<hsize_t>& begin, const std::vector<hsize_t>& end, const std::vector<hsize_t>& step,
                size_t axes, Use&& use) {
  std::vector<hsize_t> place = begin;
  for (;;) {
    use(place);
    size_t axis = axes;
    while (axis > 0 && (place[axis - 1] += step[axis - 1]) >= end[axis - 1]) --axis, place[axis] = begin[axis];
    if (axis == 0) return;
  }
}

// Fletcher's checksum: the sum of all words of two bytes, and the sum of all intermediate sums, both modulo 65535. The
// format puts the high byte of a word first; the last byte of an odd number of bytes is a high byte. Modulo 65535,
// swapping the bytes of all words swaps the bytes of the sums. So the words are added with their low byte first, and
// the bytes of the sums are swapped at the end. For speed, there are `lanes` partial sums; each of them adds every
// lanes-th word.
std::uint32_t fletcher32(const char* bytes, size_t count) {
  constexpr size_t lanes = 16, most_rounds = 360;  // so that the partial sums fit into 32 bits
  constexpr auto fold = [](std::uint64_t sum) {
    while (sum > 0xFFFF) sum = (sum & 0xFFFF) + (sum >> 16);
    return sum;
  };
  constexpr auto swapped = [](std::uint64_t word) { return std::uint32_t((word & 0xFF) << 8 | word >> 8); };
  const auto word_at = [&](size_t at) {
    return std::uint32_t(static_cast<unsigned char>(bytes[at])) |
           std::uint32_t(static_cast<unsigned char>(bytes[at + 1])) << 8;
  };
  std::uint64_t first = 0, second = 0;
  size_t at = 0;
  for (const size_t round_bytes = 2 * lanes; count - at >= round_bytes;) {
    const size_t rounds = std::min(most_rounds, (count - at) / round_bytes);
    std::uint32_t sum[lanes] = {}, sum_of_sums[lanes] = {};
    for (size_t i = 0; i < rounds; ++i, at += round_bytes)
      for (size_t l = 0; l < lanes; ++l) {
        sum[l] += word_at(at + 2 * l);
        sum_of_sums[l] += sum[l];
      }
    second += first * (rounds * lanes);
    for (size_t l = 0; l < lanes; ++l) {
      first += sum[l];
      second += lanes * std::uint64_t{sum_of_sums[l]} - l * std::uint64_t{sum[l]};
    }
    first = fold(first), second = fold(second);
  }
  for (; at + 1 < count; at += 2) second += first += word_at(at);
  if (at < count) second += first += static_cast<unsigned char>(bytes[at]);
  return swapped(fold(second)) << 16 | swapped(fold(first));
}

// The checksum as HDF5 before 1.6.3 wrote it on some machines: the bytes of each half are swapped.
std::uint32_t with_bytes_of_halves_swapped(std::uint32_t sum) {
  return ((sum & 0x00FF00FFU) << 8) | ((sum & 0xFF00FF00U) >> 8);
}

}  // namespace

std::vector<Filter> filters_of(hid_t properties, const std::string& name) {
  std::vector<Filter> result;
  const int count = checked(H5Pget_nfilters(properties), name);
  for (int i = 0; i < count; ++i) {
    size_t values = 1;
    unsigned flags = 0, config = 0, parameter = 0;
    const H5Z_filter_t kind =
        checked(H5Pget_filter2(properties, unsigned(i), &flags, &values, &parameter, 0, nullptr, &config), name);
    result.push_back({kind, values > 0 ? parameter : 0});
  }
  return result;
}

std::vector<hsize_t> chunk_shape(hid_t properties, size_t rank, const std::string& name) {
  std::vector<hsize_t> shape(std::max<size_t>(1, rank));
  const int found = checked(H5Pget_chunk(properties, int(shape.size()), shape.data()), name);
  if (size_t(found) != rank) fail("data set '{}': {} dimensions in its chunks found, {} needed", name, found, rank);
  if (std::find(shape.begin(), shape.end(), 0) != shape.end()) fail("data set '{}': chunks without values found", name);
  return shape;
}

namespace {

// The stored bytes of a chunk; empty if the chunk is not in the index.
std::optional<hsize_t> stored_bytes_of(hid_t data, const std::string& name, const std::vector<hsize_t>& place) {
  hsize_t stored = 0;
  if (H5Dget_chunk_storage_size(data, place.data(), &stored) < 0) {
    // For such a chunk, HDF5 1.10 reports an error; newer versions report 0 bytes.
    if (const std::string reason = hdf5_reason(); reason != "chunk storage is not allocated")
      fail("data set '{}': HDF5: {}", name, reason);
    return std::nullopt;
  }
  return stored > 0 ? std::optional(stored) : std::nullopt;
}

}  // namespace

void check_index(hid_t data, const std::string& name, const Shape& shape, const std::vector<hsize_t>& chunk) {
  const std::vector<hsize_t> begin(shape.size(), 0), end(shape.begin(), shape.end());
  hsize_t needed = 0, found = 0, indexed = 0;
  if (std::find(shape.begin(), shape.end(), 0) == shape.end())
    each_place(begin, end, chunk, shape.size(), [&](const std::vector<hsize_t>& place) {
      ++needed;
      if (stored_bytes_of(data, name, place)) ++found;
    });
  if (found < needed)
    fail(
        "data set '{}': {} of its {} chunks are missing, because they were never written or the index of chunks "
        "is damaged. "
        "Write all values, NaN for missing samples",
        name, needed - found, needed);
  const Handle space(H5Dget_space(data), H5Sclose, name);
  checked(H5Dget_num_chunks(data, space, &indexed), name);
  if (indexed != needed)
    fail("data set '{}': {} chunks found, {} needed for shape {}: its size or its index of chunks is damaged", name,
         indexed, needed, text(shape));
}

bool PackedChunks::knows(const std::vector<Filter>& filters) {
  return std::all_of(filters.begin(), filters.end(), [](const Filter& filter) {
    return filter.kind == H5Z_FILTER_DEFLATE || filter.kind == H5Z_FILTER_SHUFFLE ||
           filter.kind == H5Z_FILTER_FLETCHER32;
  });
}

std::optional<PackedChunks> PackedChunks::of(hid_t data, const std::string& name, hid_t memory_type,
                                             size_t kept_bytes) {
  const Handle properties(H5Dget_create_plist(data), H5Pclose, name);
  if (checked(H5Pget_layout(properties), name) != H5D_CHUNKED) return std::nullopt;
  auto filters = filters_of(properties, name);
  if (filters.empty() || !knows(filters)) return std::nullopt;
  const Handle type(H5Dget_type(data), H5Tclose, name);
  for (const Filter& filter : filters)
    if (filter.kind == H5Z_FILTER_SHUFFLE && filter.parameter != H5Tget_size(type))
      fail("data set '{}': damaged, filter shuffle of {} bytes found, {} needed", name, filter.parameter,
           H5Tget_size(type));
  return PackedChunks(data, name, memory_type, kept_bytes, properties, std::move(filters));
}

PackedChunks::PackedChunks(hid_t data, std::string name, hid_t memory_type, size_t kept_bytes, hid_t properties,
                           std::vector<Filter> filters)
    : data_(data),
      memory_type_(memory_type),
      name_(std::move(name)),
      kept_bytes_(kept_bytes),
      type_(H5Dget_type(data), H5Tclose, name_),
      space_(H5Dget_space(data), H5Sclose, name_),
      filters_(std::move(filters)),
      stored_item_(H5Tget_size(type_)),
      item_(H5Tget_size(memory_type)) {
  const Handle file(H5Iget_file_id(data), H5Fclose, name_);
  size_.resize(size_t(checked(H5Sget_simple_extent_ndims(space_), name_)));
  shape_ = chunk_shape(properties, size_.size(), name_);
  checked(H5Sget_simple_extent_dims(space_, size_.data(), nullptr), name_);
  items_ = checked_product(Shape(shape_.begin(), shape_.end()));
  hsize_t bytes = 0;
  checked(H5Fget_filesize(file, &bytes), name_);
  file_bytes_ = bytes;
  unsigned options = 0;
  checked(H5Pget_chunk_opts(properties, &options), name_);
  edges_unpacked_ = (options & H5D_CHUNK_DONT_FILTER_PARTIAL_CHUNKS) != 0;
}

void PackedChunks::damaged(const std::string& found) const {
  fail("data set '{}': damaged, a chunk {} found, {} bytes needed", name_, found, items_ * stored_item_);
}

void PackedChunks::read_all(void* to) { read({Place(size_.size(), 0), size_}, to); }

void PackedChunks::read(const Hyperslab& part, void* to) {
  if (std::find(part.count.begin(), part.count.end(), 0) != part.count.end()) return;
  Place begin = part.begin, end = part.begin;
  for (size_t i = 0; i < begin.size(); ++i) {
    begin[i] -= begin[i] % shape_[i];
    end[i] += part.count[i];
  }
  each_place(begin, end, shape_, begin.size(),
             [&](const Place& place) { copy(chunk(place), place, part, static_cast<char*>(to)); });
  if (bytes_.size() + other_.size() > kept_bytes_) bytes_ = Bytes(), other_ = Bytes();
}

const PackedChunks::Bytes& PackedChunks::chunk(const Place& place) {
  if (const auto known = kept_.find(place); known != kept_.end()) return known->second;
  fetch(place);
  return keep(place);
}

// ---- one chunk ----

// Reads and unpacks the chunk at `place` into bytes_.
void PackedChunks::fetch(const Place& place) {
  const auto found = stored_bytes_of(data_, name_, place);
  if (!found) fail("data set '{}': a chunk is missing, all needed", name_);
  const hsize_t stored = *found;
  // Compression can make random bytes longer, but only a little.
  constexpr std::uint64_t little = 65536;
  if (stored > std::min(file_bytes_, 2 * std::uint64_t{items_} * stored_item_ + little))
    damaged(fmt::format("of {} stored bytes", stored));
  bytes_.resize(size_t(stored));
  std::uint32_t left_out = 0;  // a bit for each filter that was omitted for this chunk
#if H5_VERSION_GE(2, 0, 0)
  size_t room = bytes_.size();
  checked(H5Dread_chunk2(data_, H5P_DEFAULT, place.data(), &left_out, bytes_.data(), &room), name_);
#else
  checked(H5Dread_chunk(data_, H5P_DEFAULT, place.data(), &left_out, bytes_.data()), name_);
#endif
  bool at_edge = false;
  for (size_t i = 0; i < place.size(); ++i) at_edge |= place[i] + shape_[i] > size_[i];
  unpack(edges_unpacked_ && at_edge ? ~std::uint32_t{0} : left_out);
  convert();
}

void PackedChunks::unpack(std::uint32_t left_out) {
  const auto is_left_out = [&](size_t i) { return i < 32 && (left_out >> i & 1) != 0; };
  const auto any_of = [&](H5Z_filter_t kind, auto&& holds) {
    for (size_t i = 0; i < filters_.size(); ++i)
      if (filters_[i].kind == kind && holds(i)) return true;
    return false;
  };
  // The number of bytes before each filter when it packed the chunk. The number after deflate is unknown.
  std::vector<std::optional<size_t>> packs(filters_.size());
  std::optional<size_t> size = items_ * stored_item_;
  for (size_t i = 0; i < filters_.size(); ++i) {
    packs[i] = size;
    if (is_left_out(i)) continue;
    if (filters_[i].kind == H5Z_FILTER_DEFLATE) size.reset();
    if (filters_[i].kind == H5Z_FILTER_FLETCHER32 && size) *size += checksum_bytes;
  }

  // The library omits deflate for a chunk that deflate does not make smaller. It never omits a filter that comes before
  // deflate.
  const bool deflated = any_of(H5Z_FILTER_DEFLATE, [&](size_t i) { return !is_left_out(i); });
  if (deflated && any_of(H5Z_FILTER_SHUFFLE, is_left_out)) damaged("packed without its filter shuffle");

  for (size_t i = filters_.size(); i-- > 0;) {
    if (is_left_out(i)) continue;
    if (filters_[i].kind == H5Z_FILTER_FLETCHER32) {
      if (bytes_.size() < checksum_bytes) damaged(fmt::format("of {} bytes", bytes_.size()));
      const size_t count = bytes_.size() - checksum_bytes;
      std::uint32_t stored = 0;
      for (size_t k = checksum_bytes; k-- > 0;)
        stored = stored << 8 | std::uint32_t{static_cast<unsigned char>(bytes_[count + k])};
      const std::uint32_t sum = fletcher32(bytes_.data(), count);
      if (stored != sum && stored != with_bytes_of_halves_swapped(sum)) damaged("with another checksum");
      bytes_.resize(count);
    } else if (filters_[i].kind == H5Z_FILTER_DEFLATE) {
      if (!packs[i]) fail("data set '{}': packed twice by gzip found, once needed: h5repack -f GZIP=4", name_);
      other_.resize(*packs[i]);
      uLong count = uLong(other_.size()), from = uLong(bytes_.size());
      const int status = uncompress2(reinterpret_cast<Bytef*>(other_.data()), &count,
                                     reinterpret_cast<const Bytef*>(bytes_.data()), &from);
      if (status == Z_MEM_ERROR) throw std::bad_alloc();
      if (status == Z_BUF_ERROR) damaged("that unpacks to more bytes");
      if (status == Z_OK && from != bytes_.size()) damaged("with unused bytes after its compressed data");
      if (status != Z_OK || count != other_.size()) damaged(fmt::format("that unpacks to {} bytes", count));
      bytes_.swap(other_);
    } else if (const size_t width = filters_[i].parameter, count = bytes_.size() / std::max<size_t>(1, width);
               width > 1 && count > 1) {  // shuffle: first bytes of all items, then second bytes
      other_.resize(bytes_.size());
      for (size_t k = 0; k < count; ++k)
        for (size_t b = 0; b < width; ++b) other_[k * width + b] = bytes_[b * count + k];
      std::copy(bytes_.begin() + std::ptrdiff_t(count * width), bytes_.end(),
                other_.begin() + std::ptrdiff_t(count * width));
      bytes_.swap(other_);
    }
  }
  if (bytes_.size() != items_ * stored_item_) damaged(fmt::format("of {} bytes", bytes_.size()));
}

// Converts bytes_ from the type in the file to the type in memory.
void PackedChunks::convert() {
  if (checked(H5Tequal(type_, memory_type_), name_) > 0) return;
  bytes_.resize(items_ * std::max(stored_item_, item_));
  checked(H5Tconvert(type_, memory_type_, items_, bytes_.data(), nullptr, H5P_DEFAULT), name_);
  bytes_.resize(items_ * item_);
}

// Moves bytes_ to the kept chunks, if there is room for them. Returns the bytes in their final place.
const PackedChunks::Bytes& PackedChunks::keep(const Place& place) {
  constexpr size_t beside = 256;  // bytes for the place of a chunk and for the containers
  const size_t size = bytes_.size() + beside;
  if (size > kept_bytes_) return bytes_;
  while ((order_.size() + 1) * size > kept_bytes_) {
    other_ = std::move(kept_.extract(order_.front()).mapped());
    order_.pop_front();
  }
  order_.push_back(place);
  Bytes& kept = kept_[place];
  kept.swap(bytes_);
  bytes_.swap(other_);
  return kept;
}

// ---- from chunks to a part of the data set ----

// Copies the values that the chunk and the part have in common. Trailing axes that are complete in both are copied in
// one run.
void PackedChunks::copy(const Bytes& chunk, const Place& place, const Hyperslab& part, char* to) const {
  const size_t rank = place.size();
  Place begin(rank), end(rank);
  for (size_t i = 0; i < rank; ++i) {
    begin[i] = std::max(place[i], part.begin[i]);
    end[i] = std::min(place[i] + shape_[i], part.begin[i] + part.count[i]);
  }
  size_t axis = rank, run = 1;
  do {
    --axis;
    run *= size_t(end[axis] - begin[axis]);
  } while (axis > 0 && end[axis] - begin[axis] == shape_[axis] && shape_[axis] == part.count[axis]);
  each_place(begin, end, Place(rank, 1), axis, [&](const Place& at) {
    size_t from = 0, into = 0;
    for (size_t i = 0; i < rank; ++i) {
      from = from * size_t(shape_[i]) + size_t(at[i] - place[i]);
      into = into * size_t(part.count[i]) + size_t(at[i] - part.begin[i]);
    }
    std::memcpy(to + into * item_, chunk.data() + from * item_, run * item_);
  });
}

}  // namespace tokid::io
