// Puts the name of a file in front of its error messages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cerrno>
#include <exception>
#include <filesystem>
#include <new>
#include <stdexcept>
#include <string>
#include <string_view>
#include <system_error>

#include "io/arrays.hpp"
#include "tokid/printable.hpp"

namespace tokid::io {

// Makes one line of limited length, because a message may quote long texts from a file.
inline std::string named(const std::filesystem::path& path, std::string_view message) {
  constexpr size_t longest = 2000;
  return printable(
      fmt::format("{}: {}{}", path.string(), message.substr(0, longest), message.size() > longest ? " …" : ""));
}

// A text in quotation marks, as a shell needs them.
inline std::string in_quotes(std::string_view text) {
  std::string quoted = "'";
  for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return quoted + "'";
}

// Runs f, which reads a file, and puts the name of the file in front of its error messages.
template <typename F>
auto naming(const std::filesystem::path& path, F&& f) {
  const auto rethrow = [&](std::string_view message) { throw IoError(named(path, message)); };
  try {
    return f();
  } catch (const WriteError& error) {
    throw WriteError(named(path, error.what()), error.error());
  } catch (const std::bad_alloc&) {
    rethrow("more data found than fits into memory");
  } catch (const std::length_error&) {
    rethrow("more data found than fits into memory");
  } catch (const std::exception& error) {
    rethrow(error.what());
  }
  throw std::logic_error("unreachable");
}

// Runs f, which writes a file, and puts the name of the file in front of its error messages. An IoError stays an
// IoError, because it reports a mistake of the caller. Every other error becomes a WriteError.
template <typename F>
auto naming_write(const std::filesystem::path& path, F&& f) {
  const auto rethrow = [&](std::string_view reason, int error) {
    throw WriteError(named(path, fmt::format("can't be written: {}", reason)), error);
  };
  try {
    return f();
  } catch (const WriteError& error) {
    throw WriteError(named(path, error.what()), error.error());
  } catch (const IoError& error) {
    throw IoError(named(path, error.what()));
  } catch (const std::bad_alloc&) {
    rethrow(std::generic_category().message(ENOMEM), ENOMEM);
  } catch (const std::length_error&) {
    rethrow(std::generic_category().message(ENOMEM), ENOMEM);
  } catch (const std::exception& error) {
    rethrow(error.what(), 0);
  }
  throw std::logic_error("unreachable");
}

// Runs f, in which a library writes a file. An IoError becomes a WriteError, because a failure of the library is not a
// mistake of the caller.
template <typename F>
auto written_by_library(F&& f) {
  try {
    return f();
  } catch (const WriteError&) {
    throw;
  } catch (const IoError& error) {
    throw WriteError(fmt::format("can't be written: {}", error.what()), 0);
  }
}

}  // namespace tokid::io
