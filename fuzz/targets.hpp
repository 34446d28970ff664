// What reads text and files of strangers, each as a function of bytes: an answer or the error that it documents.
// Anything else, a crash, a hang, another exception or memory that the bytes are not worth, is a finding.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

namespace tokid::fuzz {

struct Target {
  const char* name = nullptr;  // of its folder in corpus/ too
  void (*run)(std::string_view bytes) = nullptr;
  bool fragile = false;  // a library that reads such files may crash on damaged ones (README.md)
};

std::span<const Target> targets();

// What readers may take for the data sets of one file; far less than what a machine has, so that claims show.
constexpr std::uint64_t memory = std::uint64_t{1} << 26;

}  // namespace tokid::fuzz
