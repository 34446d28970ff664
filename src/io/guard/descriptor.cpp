// SPDX-License-Identifier: BSD-3-Clause
#include "io/guard/descriptor.hpp"

#include <array>
#include <ctime>

namespace tokid::io {

FileState Unchanged::state() const {
  const auto text = [](const timespec& time) {
    std::tm utc{};
    gmtime_r(&time.tv_sec, &utc);
    std::array<char, 32> second{};
    std::strftime(second.data(), second.size(), "%Y-%m-%d %H:%M:%S", &utc);
    return fmt::format("{}.{:09}", second.data(), time.tv_nsec);
  };
  return {before_.st_ino, std::uint64_t(before_.st_size), text(before_.st_mtim), text(before_.st_ctim)};
}

}  // namespace tokid::io
