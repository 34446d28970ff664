// SPDX-License-Identifier: BSD-3-Clause
#include "io/guard/claims.hpp"

#include <sys/resource.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <fstream>
#include <limits>
#include <string>

namespace tokid::io {

namespace {

constexpr std::uint64_t unlimited = std::numeric_limits<std::uint64_t>::max();

// The largest number of dimensions in HDF5, and in NumPy before version 2.
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

// The text "max" is no number; it means that there is no limit.
std::uint64_t limit_in(const std::filesystem::path& file) {
  std::uint64_t bytes = 0;
  return std::ifstream(file) >> bytes ? bytes : unlimited;
}

}  // namespace

// A container may see its own group as the root of the file system, so that the path of the group does not exist.
// Missing paths are skipped.
std::uint64_t group_memory(const std::filesystem::path& root) {
  const std::filesystem::path groups = root / "sys/fs/cgroup";
  std::uint64_t least = std::min(limit_in(groups / "memory.max"), limit_in(groups / "memory/memory.limit_in_bytes"));
  std::ifstream list(root / "proc/self/cgroup");
  for (std::string line; std::getline(list, line);) {
    // A line is number:controllers:path. In version 2 the number is 0, and there are no controllers.
    const size_t first = line.find(':'), second = line.find(':', first + 1);
    if (second == std::string::npos) continue;
    const std::string controllers = fmt::format(",{},", line.substr(first + 1, second - first - 1));
    const bool second_version = controllers == ",,";
    if (!second_version && controllers.find(",memory,") == std::string::npos) continue;
    const std::filesystem::path top = second_version ? groups : groups / "memory";
    const char* file = second_version ? "memory.max" : "memory.limit_in_bytes";
    std::filesystem::path below;
    for (const auto& part : std::filesystem::path(line.substr(second + 1)).relative_path()) {
      below /= part;
      least = std::min(least, limit_in(top / below / file));
    }
  }
  return least;
}

std::uint64_t memory_limit() {
  if (const std::uint64_t own = own_limit) return own;
  return std::min({machine_memory(), process_memory(), group_memory()});
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
    fail(
        "data set '{}': shape {} found, which takes {} bytes of memory, but only {} bytes of the {} of this machine are left",
        name, text(shape), taken, left_, memory_limit());
  left_ -= taken;
}

}  // namespace tokid::io
