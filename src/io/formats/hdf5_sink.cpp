// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/hdf5_sink.hpp"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>

#include "io/guard/atomic_file.hpp"

namespace tokid::io {

namespace {

// ---- the place of the values of a data set: header or chunks ----

// The header of an object has at most 64 kB. Chunks are small, because each chunk is read and checked as a whole.
constexpr size_t most_in_header = size_t{1} << 14, chunk_bytes = size_t{1} << 14;

// The number of entries of a chunk along each axis. First the last axis gets as many entries as fit. Then each axis
// between the first and the last gets a few entries; these axes are the steps of an ensemble, and blocks of steps can
// begin and end anywhere. Then the first axis gets as many entries as fit. If there is still room, the other axes get
// more entries.
Shape chunk_of(const Shape& shape, size_t item_bytes) {
  constexpr size_t few = 64;
  Shape chunk(shape.size(), 1);
  size_t room = std::max<size_t>(1, chunk_bytes / item_bytes);
  const auto widen = [&](size_t axis, size_t most) {
    const size_t before = chunk[axis], after = std::min(most, before * room);
    room = room * before / after;
    chunk[axis] = after;
  };
  for (size_t axis = shape.size(); axis-- > 0;)
    widen(axis, axis > 0 && axis + 1 < shape.size() ? std::min(few, shape[axis]) : shape[axis]);
  for (size_t axis = shape.size(); axis-- > 0;) widen(axis, shape[axis]);
  for (size_t axis = 0; axis < shape.size(); ++axis) {  // equal chunks, so that none is nearly empty
    const size_t count = (shape[axis] + chunk[axis] - 1) / chunk[axis];
    chunk[axis] = (shape[axis] + count - 1) / count;
  }
  return chunk;
}

bool fits_into_header(const Shape& shape, size_t item_bytes) {
  return checked_product(shape, item_bytes) <= most_in_header;
}

// A scalar cannot be stored in chunks. So a scalar that is too long for a header becomes a list with one entry.
Shape stored_shape(const Shape& shape, size_t item_bytes) {
  return shape.empty() && !fits_into_header(shape, item_bytes) ? Shape{1} : shape;
}

Handle creation_of(const Shape& shape, size_t item_bytes, const std::string& name) {
  Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose, name);
  checked(H5Pset_obj_track_times(properties, false), name);
  if (fits_into_header(shape, item_bytes)) {
    checked(H5Pset_layout(properties, H5D_COMPACT), name);
    return properties;
  }
  const Shape chunk = chunk_of(shape, item_bytes);
  const std::vector<hsize_t> dims(chunk.begin(), chunk.end());
  checked(H5Pset_chunk(properties, int(dims.size()), dims.data()), name);
  checked(H5Pset_fletcher32(properties), name);
  return properties;
}

Handle create(hid_t group, const std::string& name, const Shape& shape, hid_t type) {
  const Handle space = space_of(shape), properties = creation_of(shape, H5Tget_size(type), name);
  return {H5Dcreate2(group, name.c_str(), type, space, H5P_DEFAULT, properties, H5P_DEFAULT), H5Dclose, name};
}

std::uint64_t stored_bytes(const Shape& shape, size_t item_bytes) {
  constexpr std::uint64_t around = 2048, checksum = 4, indexed = 24;  // bytes beside the values
  const Shape stored = stored_shape(shape, item_bytes);
  if (fits_into_header(stored, item_bytes)) return around + checked_product(stored, item_bytes);
  const Shape chunk = chunk_of(stored, item_bytes);
  std::uint64_t count = 1;
  for (size_t axis = 0; axis < stored.size(); ++axis) count *= (stored[axis] + chunk[axis] - 1) / chunk[axis];
  return around + count * (checked_product(chunk, item_bytes) + checksum + indexed);
}

// ---- texts ----

size_t longest_of(const std::vector<std::string>& texts) {
  size_t longest = 1;
  for (const auto& text : texts) longest = std::max(longest, text.size());
  return longest;
}

// Writes texts with a fixed length, so that their bytes are stored in the data set and not in a heap.
void write_texts(hid_t file, const std::string& name, const Shape& shape, const std::vector<std::string>& texts) {
  const size_t longest = longest_of(texts);
  const Handle type = text_type(longest, H5T_STR_NULLPAD, H5T_CSET_UTF8);
  std::string bytes;
  for (const auto& text : texts) bytes += text + std::string(longest - text.size(), '\0');
  write_values(file, name, shape, type, type, bytes.data());
}

}  // namespace

std::uint64_t stored_bytes(const Shape& shape) { return stored_bytes(shape, sizeof(double)); }

std::uint64_t stored_bytes(const Array& array) {
  const auto* texts = std::get_if<std::vector<std::string>>(&array.values);
  return stored_bytes(array.shape, texts ? longest_of(*texts) : sizeof(double));
}

Handle write_values(hid_t group, const std::string& name, const Shape& shape, hid_t stored_type, hid_t memory_type,
                    const void* values) {
  Handle data = create(group, name, stored_shape(shape, H5Tget_size(stored_type)), stored_type);
  checked(H5Dwrite(data, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), name);
  return data;
}

// ---- the file ----

Hdf5Sink::Hdf5Sink(const std::filesystem::path& path, std::uint64_t bytes, std::string user_block)
    : path_(path), user_block_(std::move(user_block)) {
  const QuietHdf5 quiet;
  constexpr std::uint64_t around = 1 << 16;  // bytes of the file in addition to its data sets
  constexpr unsigned most_links = 4096;      // in the header of the root group; more links would be in a heap
  bytes += user_block_.size() + around;
  reserve(path, bytes);
  const Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose), access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  checked(H5Pset_obj_track_times(creation, false));
  checked(H5Pset_userblock(creation, user_block_.size()));
  checked(H5Pset_link_phase_change(creation, most_links, most_links));
  // Older formats have no checksums of headers (since 1.8) and of indexes of chunks (since 1.10).
  checked(H5Pset_libver_bounds(access, H5F_LIBVER_V110, H5F_LIBVER_V110));
  checked(H5Pset_fapl_stdio(access));  // other drivers need the name of the file, which may have no name yet
  checked(H5Pset_file_locking(access, false, true));  // AtomicFile locks the file itself, if it has a name
  file_.emplace(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation, access), H5Fclose);
  reserve(path, bytes);
}

void Hdf5Sink::write(const std::string& name, const Array& array) {
  const QuietHdf5 quiet;
  if (const auto* numbers = std::get_if<std::vector<double>>(&array.values))
    write_values(*file_, name, array.shape, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, numbers->data());
  else if (const auto* integers = std::get_if<std::vector<std::int64_t>>(&array.values))
    write_values(*file_, name, array.shape, H5T_STD_I64LE, H5T_NATIVE_INT64, integers->data());
  else
    write_texts(*file_, name, array.shape, std::get<std::vector<std::string>>(array.values));
}

Hdf5Sink::Rows::Rows(const Hdf5Sink& sink, const std::string& name, const Shape& shape)
    : name_(name), shape_(shape), data_([&] {
        const QuietHdf5 quiet;
        return create(sink.file(), name, shape, H5T_IEEE_F64LE);
      }()) {}

void Hdf5Sink::Rows::write(Index row, Index count, const double* values) const {
  const QuietHdf5 quiet;
  Hyperslab part;
  for (const size_t n : shape_) part.begin.push_back(0), part.count.push_back(n);
  part.begin.front() = hsize_t(row);
  part.count.front() = hsize_t(count);
  if (checked_product(Shape(part.count.begin(), part.count.end())) == 0) return;
  const Handle to = selected(data_, name_, part), memory = memory_of(part);
  checked(H5Dwrite(data_, H5T_NATIVE_DOUBLE, memory, to, H5P_DEFAULT, values), name_);
}

void Hdf5Sink::close() {
  const QuietHdf5 quiet;
  hsize_t bytes = 0;
  checked(H5Fflush(*file_, H5F_SCOPE_GLOBAL));
  checked(H5Fget_filesize(*file_, &bytes));
  file_.reset();
  // Removes the reserved space that was not needed.
  if (truncate(path_.c_str(), off_t(bytes)) != 0) fail_to_write(errno);
  const Descriptor begin(open(path_.c_str(), O_WRONLY | O_CLOEXEC));
  if (begin < 0) fail_to_write(errno);
  write_all(begin, user_block_);
}

}  // namespace tokid::io
