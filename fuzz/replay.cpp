// Runs every target on its corpus and on what a seeded generator makes of it: the same inputs each time.
// replay CORPUS ROUNDS: so many changed inputs for each target. What the HDF5 library decodes runs in a process of its
// own, where a crash within the library is counted, and any other one a finding.
// SPDX-License-Identifier: BSD-3-Clause
#include <dlfcn.h>
#include <execinfo.h>
#include <fmt/format.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
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

// ---- a process of its own ----

constexpr int in_library = 77;

// Whose function has crashed: that of the first frame that is not the C library's. What takes too long is a finding,
// whoever it is.
void tell_whose(int signal) {
  void* frames[64];
  const int count = signal == SIGALRM ? 0 : backtrace(frames, 64);
  for (int i = 1; i < count; ++i) {
    Dl_info found;
    if (dladdr(frames[i], &found) == 0 || found.dli_fname == nullptr) continue;
    const std::string_view file = found.dli_fname;
    if (file.find("libc.so") != std::string_view::npos) continue;
    if (file.find("libhdf5") != std::string_view::npos) _exit(in_library);
    break;
  }
  std::signal(signal, SIG_DFL);
  raise(signal);
}

// Calls each(i) from `begin` to `end`. \returns how many of them crashed within the library; negative: -1 - i, where i
// crashed elsewhere
int in_processes(int begin, int end, const std::function<void(int)>& each) {
  constexpr unsigned longest = 20;  // [s], of one call
  void* const shared = mmap(nullptr, sizeof(int), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  if (shared == MAP_FAILED) return -1 - begin;
  int& at = *static_cast<int*>(shared);
  int crashes = 0;
  for (at = begin; at < end; ++at) {
    const pid_t child = fork();
    if (child == 0) {
      void* frame = nullptr;
      backtrace(&frame, 1);  // loads what it needs, for which there is no room in a handler
      for (const int signal : {SIGSEGV, SIGBUS, SIGABRT, SIGFPE, SIGILL, SIGALRM}) std::signal(signal, tell_whose);
      for (; at < end; ++at) {
        alarm(longest);
        each(at);
      }
      _exit(0);
    }
    int status = 0;
    if (child < 0 || waitpid(child, &status, 0) != child) return -1 - at;
    if (WIFEXITED(status) && WEXITSTATUS(status) == 0) break;
    if (!WIFEXITED(status) || WEXITSTATUS(status) != in_library) return -1 - at;
    ++crashes;
  }
  munmap(shared, sizeof(int));
  return crashes;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) return std::fputs("replay CORPUS ROUNDS\n", stderr), 2;
  const int rounds = std::stoi(argv[2]);
  for (const auto& [name, run, hdf5] : tokid::fuzz::targets()) {
    const auto begin = std::chrono::steady_clock::now();
    const std::vector<std::string> inputs = corpus(fs::path(argv[1]) / name);
    if (inputs.empty()) return fmt::print(stderr, "{}: no inputs in {}\n", name, argv[1]), 1;
    // Said before, so that a crash has a name.
    fmt::print("{}: {} inputs, {} changed", name, inputs.size(), rounds);
    std::fflush(stdout);
    for (const std::string& input : inputs) run(input);
    const auto round = [&, run = run](int i) {  // the same input, whichever were run before
      Random random(static_cast<Random::result_type>(i + 1));
      run(changed(inputs[random() % inputs.size()], inputs, random));
    };
    int crashes = 0;
    if (hdf5)
      crashes = in_processes(0, rounds, round);
    else
      for (int i = 0; i < rounds; ++i) round(i);
    const std::chrono::duration<double> seconds = std::chrono::steady_clock::now() - begin;
    if (crashes < 0) return fmt::print(", a crash at number {}\n", -1 - crashes), 1;
    if (crashes > 2 + rounds / 200) return fmt::print(", {} crashes within the HDF5 library\n", crashes), 1;
    fmt::print(", {} crashes within the HDF5 library, {:.2f} s\n", crashes, seconds.count());
  }
  return 0;
}
