// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/data_files.hpp"

#include <glob.h>

#include <algorithm>
#include <string_view>

#include "io/arrays.hpp"
#include "io/naming.hpp"
#include "io/text.hpp"
#include "tokid/io.hpp"

namespace tokid {

namespace {

namespace fs = std::filesystem;
using io::fail;

bool is_digit(char c) { return c >= '0' && c <= '9'; }

// Splits off the number at the beginning of a text, without leading zeros; empty if there is none.
std::string_view number_at(std::string_view& text) {
  size_t count = 0;
  while (count < text.size() && is_digit(text[count])) ++count;
  std::string_view number = text.substr(0, count);
  text.remove_prefix(count);
  while (number.size() > 1 && number.front() == '0') number.remove_prefix(1);
  return number;
}

bool is_csv(const fs::path& path) { return io::in_lower_case(path.extension().string()) == ".csv"; }
bool is_hidden(const fs::path& path) { return path.filename().string().starts_with('.'); }

std::vector<fs::path> in_folder(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::directory_iterator(folder))
    if (is_csv(entry.path()) && !is_hidden(entry.path()) && entry.is_regular_file()) files.push_back(entry.path());
  if (files.empty())
    fail(
        "a directory without any .csv found, a file or a directory with .csv files needed. tokid import reads other "
        "tables, logs and a folder for each run");
  return files;
}

std::vector<fs::path> matching(const fs::path& pattern) {
  glob_t found{};
  std::vector<fs::path> files;
  if (glob(pattern.c_str(), GLOB_NOSORT, nullptr, &found) == 0)
    for (size_t i = 0; i < found.gl_pathc; ++i) files.emplace_back(found.gl_pathv[i]);
  globfree(&found);
  std::erase_if(files, [](const fs::path& path) { return fs::is_directory(path); });
  if (files.empty()) fail("no file matches this pattern");
  return files;
}

}  // namespace

bool io::stands_for_files(const fs::path& path) {
  std::error_code error;
  const auto status = fs::status(path, error);
  return fs::is_directory(status) || (!fs::exists(status) && path.string().find_first_of("*?[") != std::string::npos);
}

io::Names io::subfolders_with_csv(const fs::path& folder) {
  Names found;
  std::error_code error;
  if (!fs::is_directory(folder, error)) return found;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    if (!entry.is_directory(error) || is_hidden(entry.path())) continue;
    const fs::directory_iterator files(entry.path(), error);
    if (std::any_of(begin(files), end(files), [](const auto& file) { return is_csv(file.path()); }))
      found.push_back(entry.path().filename().string());
  }
  std::sort(found.begin(), found.end(), is_before);
  return found;
}

bool io::is_before(const std::string& a, const std::string& b) {
  std::string_view left = a, right = b;
  while (!left.empty() && !right.empty()) {
    if (is_digit(left.front()) && is_digit(right.front())) {
      const std::string_view m = number_at(left), n = number_at(right);
      if (m.size() != n.size()) return m.size() < n.size();
      if (m != n) return m < n;
      continue;
    }
    if (left.front() != right.front()) return left.front() < right.front();
    left.remove_prefix(1), right.remove_prefix(1);
  }
  return left.empty() != right.empty() ? left.empty() : a < b;
}

std::vector<fs::path> data_files(const fs::path& path) {
  if (!io::stands_for_files(path)) return {path};
  return io::naming(path, [&] {
    std::vector<fs::path> files = fs::is_directory(path) ? in_folder(path) : matching(path);
    std::sort(files.begin(), files.end(),
              [](const fs::path& a, const fs::path& b) { return io::is_before(a.string(), b.string()); });
    return files;
  });
}

}  // namespace tokid
