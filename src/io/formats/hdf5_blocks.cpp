// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/hdf5_blocks.hpp"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>

#include "io/guard/atomic_file.hpp"

namespace tokid::io {

namespace {

Handle open_for_blocks(const std::filesystem::path& path) {
  const QuietHdf5 quiet;
  const Handle access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
  // Blocks are read in long runs. The library's buffer for short runs would only cause another copy.
  checked(H5Pset_sieve_buf_size(access, 1));
  // The next block often begins within the chunks of the last one, which stay in memory.
  constexpr size_t slots = 12421, kept_bytes = size_t{1} << 24;
  checked(H5Pset_cache(access, 0, slots, kept_bytes, 0.75));
  return open_hdf5(path.string(), access);
}

}  // namespace

Hdf5Source::Hdf5Source(const std::filesystem::path& path, const Unchanged& bytes)
    : file_(open_for_blocks(path)), bytes_(bytes) {
  if (!is_at(path, bytes.descriptor())) fail("another file took its name while it was opened");
}

Hdf5Source::Samples::Samples(const Hdf5Source& source, const std::string& name)
    : source_(source), name_(name), data_(H5Dopen2(source.file_, name.c_str(), H5P_DEFAULT), H5Dclose, name) {
  const Handle space(H5Dget_space(data_), H5Sclose, name);
  rank_ = checked(H5Sget_simple_extent_ndims(space), name);
  size_.resize(size_t(rank_));
  checked(H5Sget_simple_extent_dims(space, size_.data(), nullptr), name);
  const Handle properties(H5Dget_create_plist(data_), H5Pclose, name), type(H5Dget_type(data_), H5Tclose, name);
  item_ = std::int64_t(H5Tget_size(type));
  const haddr_t address = H5Pget_layout(properties) == H5D_CONTIGUOUS ? H5Dget_offset(data_) : HADDR_UNDEF;
  offset_ = address == HADDR_UNDEF ? -1 : std::int64_t(address);
  // A block of steps consists of short runs that are far apart. By default, the system reads more bytes after each run,
  // which are not needed soon. If the file is larger than memory, the system would then read the whole file for every
  // block. So this is switched off, and expect() announces the bytes that are needed.
  void* own = nullptr;
  if (offset_ >= 0 && H5Fget_vfd_handle(source.file_, H5P_DEFAULT, &own) >= 0 && own != nullptr)
    posix_fadvise(*static_cast<const int*>(own), 0, 0, POSIX_FADV_RANDOM);
  if (H5Pget_layout(properties) != H5D_CHUNKED) return;
  together_ = Index(chunk_shape(properties, size_t(rank_), name).front());
}

void Hdf5Source::Samples::read(const Hyperslab& part, double* to) {
  const QuietHdf5 quiet;
  const Handle from = selected(data_, name_, part), memory = memory_of(part);
  // If no values were written, the library may leave the numbers of the block before in the buffer.
  if (offset_ < 0) std::fill_n(to, checked_product(Shape(part.count.begin(), part.count.end())), 0.0);
  checked(H5Dread(data_, H5T_NATIVE_DOUBLE, memory, from, H5P_DEFAULT, to), name_);
  source_.bytes_.check();
}

void Hdf5Source::Samples::expect(const Hyperslab& part) const {
  const int descriptor = source_.bytes_.descriptor();  // negative: the file is not open, so no hint is possible
  if (descriptor < 0 || offset_ < 0 || rank_ < 2) return;
  // In each experiment, the steps of the block are one run of bytes.
  const size_t last = size_t(rank_) - 1;
  const std::int64_t channels = std::int64_t(size_[last]), steps = std::int64_t(size_[last - 1]);
  const std::int64_t first = rank_ > 2 ? std::int64_t(part.begin[0]) : 0,
                     count = rank_ > 2 ? std::int64_t(part.count[0]) : 1;
  for (std::int64_t n = first; n < first + count; ++n)
    posix_fadvise(descriptor, offset_ + (n * steps + std::int64_t(part.begin[last - 1])) * channels * item_,
                  std::int64_t(part.count[last - 1]) * channels * item_, POSIX_FADV_WILLNEED);
}

}  // namespace tokid::io
