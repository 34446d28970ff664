// The name of a file in front of whatever is wrong with it.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <filesystem>
#include <new>
#include <stdexcept>

#include "arrays.hpp"

namespace tokid::io {

// Runs f and puts the name of the file in front of whatever it complains about, on one line.
template <typename F>
auto naming(const std::filesystem::path& path, F&& f) {
  const auto named = [&](std::string_view message) {
    constexpr size_t longest = 2000;  // what a file is made to say may be long
    return printable(
        fmt::format("{}: {}{}", path.string(), message.substr(0, longest), message.size() > longest ? " …" : ""));
  };
  const auto rethrow = [&](std::string_view message) { throw IoError(named(message)); };
  try {
    return f();
  } catch (const WriteError& error) {
    throw WriteError(named(error.what()), error.error());
  } catch (const std::bad_alloc&) {
    rethrow("more data found than fits into memory");
  } catch (const std::length_error&) {
    rethrow("more data found than fits into memory");
  } catch (const std::exception& error) {
    rethrow(error.what());
  }
  throw std::logic_error("unreachable");
}

// The libraries' own words for these differ, and some are misleading. \throws IoError
void check_readable(const std::filesystem::path& path);

bool is_hdf5(const std::filesystem::path& path);  // by its extension

}  // namespace tokid::io
