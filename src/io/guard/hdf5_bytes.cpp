// SPDX-License-Identifier: BSD-3-Clause
#include "io/guard/hdf5_bytes.hpp"

#include <algorithm>
#include <functional>
#include <map>
#include <set>
#include <vector>

#include "io/guard/atomic_file.hpp"

namespace tokid::io {

namespace {

enum Message : unsigned {
  datatype_message = 0x03,
  layout_message = 0x08,
  attribute_message = 0x0C,
  continuation_message = 0x10
};
constexpr unsigned is_shared = 0x02;  // flag of a message whose content is stored in another place

// Some bytes of the file. A number that is read beyond their end is 0.
class View {
 public:
  explicit View(std::string_view bytes) : bytes_(bytes) {}

  std::uint64_t number(size_t at, size_t bytes) const {  // the lowest byte first
    std::uint64_t value = 0;
    for (size_t k = 0; k < bytes && at + k < bytes_.size(); ++k)
      value |= std::uint64_t{static_cast<unsigned char>(bytes_[at + k])} << (8 * k);
    return value;
  }
  std::string_view part(size_t at, size_t bytes) const {
    return at > bytes_.size() ? std::string_view{} : bytes_.substr(at, bytes);
  }
  size_t size() const { return bytes_.size(); }

 private:
  std::string_view bytes_;
};

size_t to_eight(size_t bytes) { return (bytes + 7) / 8 * 8; }

// Bytes of one value of this type; empty if the description of the type is longer than its message.
std::optional<std::uint64_t> value_bytes(std::string_view datatype) {
  constexpr size_t head = 8;  // class and version, bits, size of a value
  const View type(datatype);
  const auto kind = type.number(0, 1) & 0x0F;
  const size_t properties = kind == H5T_INTEGER || kind == H5T_BITFIELD ? 4 : kind == H5T_FLOAT ? 12 : 0;
  if (type.size() < head + properties) return std::nullopt;
  if (kind == H5T_VLEN && !value_bytes(type.part(head, type.size()))) return std::nullopt;
  return type.number(4, 4);
}

// Number of values; empty if the list of sizes is longer than its message.
std::optional<std::uint64_t> value_count(std::string_view dataspace) {
  const View space(dataspace);
  const auto version = space.number(0, 1), rank = space.number(1, 1), flags = space.number(2, 1);
  if (version == 2 && space.number(3, 1) == H5S_NULL) return 0;
  const size_t head = version == 1 ? 8 : 4;
  if (space.size() < head + 8 * rank * (1 + (flags & 1))) return std::nullopt;
  Shape sizes;
  for (size_t i = 0; i < rank; ++i) sizes.push_back(space.number(head + 8 * i, 8));
  return checked_product(sizes);
}

}  // namespace

Hdf5Bytes::Hdf5Bytes(hid_t object, std::string name, std::uint64_t file_bytes)
    : object_(object), name_(std::move(name)), file_bytes_(file_bytes) {
  const Handle file(H5Iget_file_id(object), H5Fclose, name_);
  const Handle creation(H5Fget_create_plist(file), H5Pclose, name_);
  size_t address_bytes = 0, size_bytes = 0;
  void* descriptor = nullptr;
  checked(H5Pget_sizes(creation, &address_bytes, &size_bytes), name_);
  checked(H5Pget_userblock(creation, &base_), name_);
  checked(H5Fget_vfd_handle(file, H5P_DEFAULT, &descriptor), name_);
  if (address_bytes != 8 || size_bytes != 8)
    fail("HDF5: addresses of {} and sizes of {} bytes found, 8 needed", address_bytes, size_bytes);
  descriptor_ = *static_cast<const int*>(descriptor);
}

void Hdf5Bytes::damaged(std::string_view what) const { fail("data set '{}': damaged {} found", name_, what); }

std::string Hdf5Bytes::read(std::uint64_t offset, std::uint64_t bytes) const {
  if (offset > file_bytes_ || bytes > file_bytes_ - offset) fail("data set '{}': truncated", name_);
  std::string result(bytes, '\0');
  if (!read_all(descriptor_, result, std::int64_t(offset))) fail("data set '{}': truncated", name_);
  return result;
}

// ---- the header of the object ----

std::uint64_t Hdf5Bytes::address() const {
#if H5_VERSION_GE(1, 12, 0)
  H5O_info1_t info;
#else
  H5O_info_t info;
#endif
  checked(H5Oget_info2(object_, &info, H5O_INFO_BASIC), name_);
  return base_ + info.addr;
}

void Hdf5Bytes::each_message(std::uint64_t address, const Use& see) const {
  // A header of version 1 begins with its sizes. A header of version 2 begins with a signature, and each of its blocks
  // ends with a checksum.
  constexpr size_t most_start = 34;
  const std::string start =
      read(address, std::min<std::uint64_t>(most_start, file_bytes_ - std::min(file_bytes_, address)));
  const View prefix(start);
  const bool second = start.starts_with("OHDR");
  const auto flags = second ? prefix.number(5, 1) : 0;
  const size_t head = second ? 4 + ((flags & 4) ? 2 : 0) : 8;  // bytes before the content of a message
  std::vector<Piece> blocks;
  if (second) {
    const size_t width = size_t{1} << (flags & 3), size_at = 6 + ((flags & 0x20) ? 16 : 0) + ((flags & 0x10) ? 4 : 0);
    blocks.push_back({address + size_at + width, prefix.number(size_at, width)});
  } else {
    blocks.push_back({address + 16, prefix.number(8, 4)});
  }

  std::uint64_t total = 0;       // overlapping blocks could have more bytes in total than the file
  std::set<std::uint64_t> seen;  // blocks that refer to each other would never end
  for (size_t i = 0; i < blocks.size(); ++i) {
    total += blocks[i].bytes;
    if ((i > 0 && blocks[i].bytes < head) || total > file_bytes_ || !seen.insert(blocks[i].offset).second)
      damaged("header");
    const std::string bytes = read(blocks[i].offset, blocks[i].bytes);
    const View block(bytes);
    for (size_t at = 0; at + head <= block.size();) {
      const auto type = unsigned(block.number(at, second ? 1 : 2));
      const auto size = block.number(at + (second ? 1 : 2), 2);
      const auto message_flags = unsigned(block.number(at + (second ? 3 : 4), 1));
      at += head;
      if (size > block.size() - at) damaged("header");
      if (type == continuation_message) {
        const std::uint64_t offset = base_ + block.number(at, 8), length = block.number(at + 8, 8);
        constexpr std::uint64_t signature = 4, checksum = 4;
        if (second && length < signature + checksum) damaged("header");
        blocks.push_back(second ? Piece{offset + signature, length - signature - checksum} : Piece{offset, length});
      }
      see(type, message_flags, {blocks[i].offset + at, size});
      at += size;
    }
  }
}

// Bytes of one value of a type that is stored under a name of its own in the file.
std::optional<std::uint64_t> Hdf5Bytes::committed_bytes(std::string_view reference) const {
  const View at(reference);
  const std::uint64_t header = at.number(at.number(0, 1) == 1 ? 8 : 2, 8);
  if (header > file_bytes_) return std::nullopt;
  std::optional<std::uint64_t> found;
  each_message(base_ + header, [&](unsigned type, unsigned flags, const Piece& piece) {
    if (type != datatype_message || (flags & is_shared)) return;
    if (found) damaged("datatype");
    found = value_bytes(read(piece.offset, piece.bytes));
  });
  return found;
}

void Hdf5Bytes::each_attribute(const std::function<void(std::string_view, const Piece&)>& see) const {
  std::map<std::string, std::optional<std::uint64_t>, std::less<>> committed;  // many attributes may share a type
  each_message(address(), [&](unsigned type, unsigned flags, const Piece& piece) {
    if (type != attribute_message || (flags & is_shared)) return;
    const std::string bytes = read(piece.offset, piece.bytes);
    const View message(bytes);
    const auto version = message.number(0, 1), shared = version > 1 ? message.number(1, 1) & 3 : 0;
    const auto room = [&](size_t size) { return version == 1 ? to_eight(size) : size; };
    const size_t name_bytes = message.number(2, 2), type_bytes = message.number(4, 2),
                 space_bytes = message.number(6, 2);
    const size_t name_at = version == 3 ? 9 : 8, type_at = name_at + room(name_bytes),
                 space_at = type_at + room(type_bytes), values_at = space_at + room(space_bytes);
    std::string_view name = message.part(name_at, name_bytes);
    if (values_at > message.size() || !name.ends_with('\0')) damaged("attribute");
    name = name.substr(0, name.find('\0'));
    constexpr unsigned shared_type = 1, shared_space = 2;
    if (shared & shared_space) fail("attribute '{}': its size is stored in another object, its own size needed", name);
    const std::string_view type_part = message.part(type_at, type_bytes);
    const auto shared_bytes = [&] {
      auto known = committed.find(type_part);
      if (known == committed.end()) known = committed.emplace(type_part, committed_bytes(type_part)).first;
      return known->second;
    };
    const auto item = (shared & shared_type) ? shared_bytes() : value_bytes(type_part);
    const auto count = value_count(message.part(space_at, space_bytes));
    if (!item || !count) damaged("attribute");
    const std::uint64_t needed = checked_product({*item, *count});
    if (needed > message.size() - values_at) damaged("attribute");
    see(name, {piece.offset + values_at, needed});
  });
}

void Hdf5Bytes::check_attributes() const {
  each_attribute([](std::string_view, const Piece&) {});
}

std::optional<Hdf5Bytes::Piece> Hdf5Bytes::attribute(std::string_view name) const {
  std::optional<Piece> found;
  each_attribute([&](std::string_view other, const Piece& values) {
    if (other != name) return;
    if (found) damaged("attribute");  // two of one name: the library could read the unchecked one
    found = values;
  });
  return found;
}

Hdf5Bytes::Piece Hdf5Bytes::layout_piece() const {
  std::optional<Piece> found;
  each_message(address(), [&](unsigned type, unsigned, const Piece& piece) {
    if (type != layout_message) return;
    if (found) damaged("layout");
    found = piece;
  });
  if (!found) damaged("layout");
  return *found;
}

std::optional<Hdf5Bytes::Piece> Hdf5Bytes::values() const {
  const Handle properties(H5Dget_create_plist(object_), H5Pclose, name_);
  const H5D_layout_t layout = checked(H5Pget_layout(properties), name_);
  std::optional<Piece> found;
  if (layout == H5D_CONTIGUOUS) {
    if (const haddr_t offset = H5Dget_offset(object_); offset != HADDR_UNDEF)
      found = Piece{offset, H5Dget_storage_size(object_)};
  } else if (layout == H5D_COMPACT) {
    constexpr size_t values_at = 4;  // from version 3 on: after version, class and size
    const Piece piece = layout_piece();
    const std::string bytes = read(piece.offset, piece.bytes);
    const View message(bytes);
    if (message.number(0, 1) < 3 || message.number(2, 2) + values_at > message.size()) damaged("layout");
    found = Piece{piece.offset + values_at, message.number(2, 2)};
  }
  return found;
}

void Hdf5Bytes::check_chunks(std::uint64_t needed) const {
  const Piece piece = layout_piece();
  const std::string bytes = read(piece.offset, piece.bytes);
  const View message(bytes);
  const auto version = message.number(0, 1);
  if (version > 3) return;  // without filters, these indexes contain addresses only and no sizes
  const auto rank = message.number(version == 3 ? 2 : 1, 1);  // one more than the rank of the data set
  constexpr std::uint64_t nowhere = ~std::uint64_t{0};
  const std::uint64_t root = message.number(version == 3 ? 3 : 8, 8);
  if (root == nowhere) return;

  constexpr size_t head = 24, child = 8;  // bytes of the head of a node, and of an address in the node
  const size_t key = 8 + 8 * rank;        // stored bytes, mask of omitted filters, place of the chunk
  std::uint64_t total = 0;                // nodes that refer to each other would never end
  std::vector<std::uint64_t> nodes(1, root);
  while (!nodes.empty()) {
    const std::uint64_t address = nodes.back();
    nodes.pop_back();
    if (address > file_bytes_) damaged("index of chunks");
    const std::string start = read(base_ + address, head);
    const View node(start);
    const auto level = node.number(5, 1), used = node.number(6, 2), size = used * (key + child);
    total += head + size;
    if (!start.starts_with("TREE\1") || total > file_bytes_) damaged("index of chunks");
    const std::string entries = read(base_ + address + head, size);
    for (size_t at = 0; at < size; at += key + child) {
      const View entry(std::string_view(entries).substr(at, key + child));
      if (level > 0)
        nodes.push_back(entry.number(key, child));
      else if (const auto stored = entry.number(0, 4); stored < needed)
        fail("data set '{}': damaged, a chunk of {} stored bytes found, {} needed", name_, stored, needed);
    }
  }
}

// ---- texts ----

void Hdf5Bytes::check_texts(const Piece& entries) const {
  constexpr size_t entry = 16;  // length of the text, address of its heap, number of its object in the heap
  const std::string bytes = read(entries.offset, entries.bytes);
  const View view(bytes);
  std::map<std::uint64_t, std::map<std::uint64_t, std::uint64_t>> heaps;
  std::uint64_t total = 0;
  for (size_t at = 0; at + entry <= view.size(); at += entry) {
    const std::uint64_t length = view.number(at, 4), address = view.number(at + 4, 8), index = view.number(at + 12, 4);
    if (address == 0) continue;  // no text
    if (!heaps.contains(address)) heaps[address] = heap(address, total);
    const auto object = heaps[address].find(index);
    if (object == heaps[address].end() || object->second != length)
      fail("data set '{}': damaged, its heap of texts contains no text of {} bytes at the stated place", name_, length);
  }
}

// The number of bytes of each object of a heap, by the number of the object. `total` counts the bytes of all heaps:
// overlapping heaps could be larger in total than the file, and each of them is read into memory as a whole.
std::map<std::uint64_t, std::uint64_t> Hdf5Bytes::heap(std::uint64_t address, std::uint64_t& total) const {
  constexpr size_t head = 16;  // bytes of the head of a heap, and of the head of an object
  if (address > file_bytes_) damaged("heap of texts");
  const std::string start = read(base_ + address, head);
  const std::uint64_t bytes = View(start).number(8, 8);
  if (!start.starts_with("GCOL") || bytes < head || bytes > file_bytes_ - std::min(file_bytes_, total))
    damaged("heap of texts");
  total += bytes;
  const std::string all = read(base_ + address, bytes);
  const View view(all);
  std::map<std::uint64_t, std::uint64_t> found;
  for (size_t at = head; at + head <= bytes;) {
    const std::uint64_t index = view.number(at, 2), size = view.number(at + 8, 8), left = bytes - at;
    if (size > left) damaged("heap of texts");
    const std::uint64_t step = index == 0 ? size : head + to_eight(size);  // 0: free space; its size includes its head
    if (step < head || step > left) damaged("heap of texts");
    if (index > 0) found[index] = size;
    at += step;
  }
  return found;
}

}  // namespace tokid::io
