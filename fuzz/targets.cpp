// SPDX-License-Identifier: BSD-3-Clause
#include "targets.hpp"

#include <fcntl.h>
#include <hdf5.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <stdexcept>
#include <string>
#include <system_error>
#include <vector>

#include "command.hpp"
#include "io/formats/provenance_text.hpp"
#include "io/guard/claims.hpp"
#include "tokid/tokid.hpp"
#include "tool.hpp"

namespace tokid::fuzz {

namespace {

namespace fs = std::filesystem;

// ---- a file of the given bytes ----

// In memory where the system has such files; removed as soon as it is open, and reached by a link with the extension.
class File {
 public:
  explicit File(const char* extension) {
    const fs::path shared = "/dev/shm";
    const fs::path folder = fs::is_directory(shared) ? shared : fs::temp_directory_path();
    path_ = folder / fmt::format("tokid-fuzz-{}{}", getpid(), extension);
    fd_ = open(path_.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0600);
    if (fd_ < 0) throw std::system_error(errno, std::generic_category(), path_.string());
  }
  ~File() {
    close(fd_);
    unlink(path_.c_str());
  }
  File(const File&) = delete;
  File& operator=(const File&) = delete;

  const fs::path& filled(std::string_view bytes) const {
    if (ftruncate(fd_, 0) != 0 || pwrite(fd_, bytes.data(), bytes.size(), 0) != ssize_t(bytes.size()))
      throw std::system_error(errno, std::generic_category(), path_.string());
    return path_;
  }

 private:
  fs::path path_;
  int fd_ = -1;
};

template <class Read>
void refuses_or_reads(Read&& read) {
  // The HDF5 library keeps memory for the next file, in which the sanitizers would not see what it does wrong.
  static const herr_t kept = H5set_free_list_limits(0, 0, 0, 0, 0, 0);
  if (kept < 0) throw std::logic_error("HDF5: no limits of its free lists");
  io::limit_memory(memory);
  try {
    read();
  } catch (const IoError&) {
  }
}

// ---- readers ----

struct Extension {
  char text[6];
};
constexpr Extension npz{".npz"}, h5{".h5"}, mat{".mat"}, csv{".csv"};

template <const Extension& extension>
const fs::path& file_of(std::string_view bytes) {
  static const File file(extension.text);
  return file.filled(bytes);
}

template <const Extension& extension>
void ensemble(std::string_view bytes) {
  const fs::path& path = file_of<extension>(bytes);
  refuses_or_reads([&] { load_ensemble(path, {{}, {}, false}).check(false); });
}

template <const Extension& extension>
void model(std::string_view bytes) {
  const fs::path& path = file_of<extension>(bytes);
  refuses_or_reads([&] { file_kind(path); });
  refuses_or_reads([&] { load_model(path).check(); });
}

template <const Extension& extension>
void state(std::string_view bytes) {
  const fs::path& path = file_of<extension>(bytes);
  refuses_or_reads([&] { load_update_state(path); });
}

void blocks(std::string_view bytes) {
  const fs::path& path = file_of<h5>(bytes);
  refuses_or_reads([&] {
    const EnsembleFile file(path);
    const Index half = (file.steps() + 1) / 2;
    file.expect(0, half);
    file.read(0, half);
    if (half < file.steps()) file.read(half, file.steps());
  });
}

// The names of inputs, the names of outputs, the table.
void columns(std::string_view bytes) {
  ReadOptions options;
  for (auto* names : {&options.inputs, &options.outputs}) {
    const size_t end = std::min(bytes.find('\n'), bytes.size());
    *names = app::split_at_commas(std::string(bytes.substr(0, end)));
    bytes.remove_prefix(std::min(end + 1, bytes.size()));
  }
  const fs::path& path = file_of<csv>(bytes);
  refuses_or_reads([&] { load_ensemble(path, options); });
}

std::string_view taken_line(std::string_view& bytes) {
  const size_t end = std::min(bytes.find('\n'), bytes.size());
  const std::string_view line = bytes.substr(0, end);
  bytes.remove_prefix(std::min(end + 1, bytes.size()));
  return line;
}

// The names of inputs, the names of outputs, then two tables, which a form feed separates.
void recordings(std::string_view bytes) {
  ReadOptions options;
  options.outputs_required = false;
  for (auto* names : {&options.inputs, &options.outputs})
    if (const std::string_view line = taken_line(bytes); !line.empty())
      *names = app::split_at_commas(std::string(line));
  static const File first("-1.csv"), second("-2.csv");
  const size_t end = std::min(bytes.find('\f'), bytes.size());
  std::vector<fs::path> paths{first.filled(bytes.substr(0, end))};
  if (end < bytes.size()) paths.push_back(second.filled(bytes.substr(end + 1)));
  refuses_or_reads([&] {
    try {
      load_ensemble(paths, options).check(false);
    } catch (const std::invalid_argument&) {
    }
  });
}

// ---- options ----

// What is understood is written so that it is understood in the same way.
void options(std::string_view bytes) {
  const std::string given(bytes);
  Provenance provenance = io::provenance_of(given);
  if (io::provenance_text(provenance) != given)
    throw std::logic_error("another text written: " + io::provenance_text(provenance));
  if (provenance.options) {
    const std::string text = io::provenance_text({.options = provenance.options});
    if (io::provenance_text({.options = identify_options(io::provenance_of(text))}) != text)
      throw std::logic_error("other options read back: " + text);
  }
  provenance.experiments = 3;
  provenance.refinement = {1.0, 2};
  const std::string changed = io::provenance_text(provenance);
  const Provenance again = io::provenance_of(changed);
  if (again.experiments != 3 || !again.refinement || again.refinement->smoothing != 1.0)
    throw std::logic_error("a change that can't be read: " + changed);
}

// One argument a line. Everything is done but what the command is for.
void command_line(std::string_view bytes) {
  std::vector<std::string> words{"tokid"};
  while (!bytes.empty()) {
    const size_t end = std::min(bytes.find('\n'), bytes.size());
    words.emplace_back(bytes.substr(0, end));
    std::replace(words.back().begin(), words.back().end(), '\0', ' ');
    bytes.remove_prefix(std::min(end + 1, bytes.size()));
  }
  std::vector<const char*> arguments;
  for (const std::string& word : words) arguments.push_back(word.c_str());
  app::complaint(int(arguments.size()), arguments.data());
}

constexpr Target table[] = {{"ensemble_npz", ensemble<npz>},
                            {"ensemble_h5", ensemble<h5>, true},
                            {"ensemble_mat", ensemble<mat>, true},
                            {"ensemble_mat73", ensemble<mat>, true},
                            {"ensemble_csv", ensemble<csv>},
                            {"columns", columns},
                            {"recordings", recordings},
                            {"blocks", blocks, true},
                            {"model_npz", model<npz>},
                            {"model_h5", model<h5>, true},
                            {"model_mat", model<mat>, true},
                            {"state_npz", state<npz>},
                            {"state_h5", state<h5>, true},
                            {"options", options},
                            {"command_line", command_line}};

}  // namespace

std::span<const Target> targets() { return table; }

}  // namespace tokid::fuzz
