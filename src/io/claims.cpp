// SPDX-License-Identifier: BSD-3-Clause
#include "claims.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <limits>

namespace tokid::io {

namespace {

constexpr std::uint64_t unlimited = std::numeric_limits<std::uint64_t>::max();

// DEFLATE can't compress better.
constexpr std::uint64_t best_compression = 1032;
// What NumPy and HDF5 allow for.
constexpr size_t most_dimensions = 32;

std::atomic<std::uint64_t> own_limit{0};

std::uint64_t machine_memory() {
  const long pages = sysconf(_SC_PHYS_PAGES), page = sysconf(_SC_PAGESIZE);
  return pages > 0 && page > 0 ? std::uint64_t(pages) * std::uint64_t(page) : unlimited;
}

std::uint64_t process_memory() {
  rlimit limit{};
  return getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY ? limit.rlim_cur : unlimited;
}

// Of a container, which sees its own limits there; "max" is none.
std::uint64_t container_memory() {
  std::uint64_t bytes = unlimited;
  return std::ifstream("/sys/fs/cgroup/memory.max") >> bytes ? bytes : unlimited;
}

}  // namespace

std::uint64_t memory_limit() {
  if (const std::uint64_t own = own_limit) return own;
  return std::min({machine_memory(), process_memory(), container_memory()});
}

void limit_memory(std::uint64_t bytes) { own_limit = bytes; }

void Claims::add(std::string_view name, const Shape& shape, size_t stored_item_bytes, size_t memory_item_bytes) {
  if (shape.size() > most_dimensions)
    fail("data set '{}': {} dimensions found, at most {} needed", name, shape.size(), most_dimensions);
  const std::uint64_t stored = checked_product(shape, stored_item_bytes);
  if (stored / best_compression > file_bytes_)
    fail("data set '{}': shape {} ({} bytes) found in a file of {} bytes, a consistent size needed", name, text(shape),
         stored, file_bytes_);
  const std::uint64_t taken = checked_product(shape, memory_item_bytes);
  if (taken > left_)
    fail("data set '{}': shape {} found, which takes {} bytes of memory; at most {} of the {} of this machine are left",
         name, text(shape), taken, left_, memory_limit());
  left_ -= taken;
}

}  // namespace tokid::io
