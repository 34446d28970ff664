// Runs every target on its corpus and on what a seeded generator makes of it: the same inputs each time.
// replay CORPUS ROUNDS: so many changed inputs for each target, but none of HDF5 files, on which the HDF5 library may
// crash.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <random>
#include <string>
#include <string_view>
#include <vector>

#include "targets.hpp"

// NOLINTBEGIN(bugprone-reserved-identifier, readability-identifier-naming): the sanitizers look for these names
extern "C" const char* __asan_default_options() { return "allocator_may_return_null=1"; }
extern "C" const char* __lsan_default_suppressions() { return "leak:libhdf5\nleak:libmatio"; }
// NOLINTEND(bugprone-reserved-identifier, readability-identifier-naming)

namespace {

namespace fs = std::filesystem;
using Random = std::mt19937_64;  // the same numbers everywhere, unlike what std makes of them

std::string bytes_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::string> corpus(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder)) files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<std::string> inputs;
  for (const fs::path& file : files) inputs.push_back(bytes_of(file));
  return inputs;
}

// Bits, bytes, sizes that are extreme, pieces that are missing, repeated or of another input.
std::string changed(std::string bytes, const std::vector<std::string>& others, Random& random) {
  static constexpr char extreme[][9] = {"\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF", "\xFF\xFF\xFF\xFF\xFF\xFF\xFF\x7F",
                                        "\x00\x00\x00\x80\x00\x00\x00\x00", "\x00\x00\x00\x00\x00\x00\x00\x00"};
  for (auto count = random() % 4 + 1; count > 0 && !bytes.empty(); --count) {
    const size_t at = random() % bytes.size(), size = std::min<size_t>(size_t{1} << random() % 4, bytes.size() - at);
    switch (random() % 6) {
      case 0:
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << random() % 8));
        break;
      case 1:
        bytes[at] = static_cast<char>(random());
        break;
      case 2:
        bytes.replace(at, size, std::string(extreme[random() % 4], 8), 0, size);
        break;
      case 3:
        bytes.erase(at, size);
        break;
      case 4:
        bytes.insert(at, bytes.substr(at, size));
        break;
      default: {
        const std::string& other = others[random() % others.size()];
        bytes.replace(at, size, other, other.empty() ? 0 : random() % other.size(), size);
      }
    }
  }
  return bytes;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return std::fputs("replay CORPUS ROUNDS\n", stderr), 2;
  const int rounds = std::stoi(argv[2]);
  for (const auto& [name, run, fragile] : tokid::fuzz::targets()) {
    const auto begin = std::chrono::steady_clock::now();
    const std::vector<std::string> inputs = corpus(fs::path(argv[1]) / name);
    if (inputs.empty()) return fmt::print(stderr, "{}: no inputs in {}\n", name, argv[1]), 1;
    // Said before, so that a crash has a name.
    const int changes = fragile ? 0 : rounds;
    fmt::print("{}: {} inputs, {} changed", name, inputs.size(), changes);
    std::fflush(stdout);
    for (const std::string& input : inputs) run(input);
    for (int i = 0; i < changes; ++i) {  // the same input, whichever were run before
      Random random(static_cast<Random::result_type>(i + 1));
      run(changed(inputs[random() % inputs.size()], inputs, random));
    }
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    fmt::print(", {:.2f} s\n", seconds.count());
  }
  return 0;
}
