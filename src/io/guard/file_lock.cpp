// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/file_lock.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <chrono>
#include <optional>
#include <thread>

#include "io/guard/atomic_file.hpp"
#include "io/naming.hpp"
#include "tokid/parallel.hpp"

namespace tokid {

namespace {

namespace fs = std::filesystem;
using io::Descriptor;
using io::fail;
using Clock = std::chrono::steady_clock;

constexpr int open_flags = O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC;

bool same_file(const struct stat& a, const struct stat& b) { return a.st_dev == b.st_dev && a.st_ino == b.st_ino; }

std::string this_process() {
  std::array<char, 256> host{};
  gethostname(host.data(), host.size() - 1);
  return fmt::format("process {} on {}", getpid(), host.data());
}

std::optional<struct stat> status_of(const fs::path& path) {
  struct stat found = {};
  return stat(path.c_str(), &found) == 0 ? std::optional(found) : std::nullopt;
}

// Opens an existing lock file, even one that a dead process left, or creates a new one. O_CREAT alone does not work: in
// a folder that all users may write to, Linux then refuses to open a file of another user.
Descriptor open_or_create(const fs::path& path) {
  for (;;) {
    Descriptor file(open(path.c_str(), open_flags));
    if (file >= 0 || errno != ENOENT) return file;
    file = Descriptor(open(path.c_str(), open_flags | O_CREAT | O_EXCL, 0666));
    if (file >= 0 || errno != EEXIST) return file;
  }
}

// Does this name still lead to the open file? The name is opened because this asks the server of a network file system;
// stat() could show an old state.
bool has_name(const fs::path& path, int file) {
  const Descriptor there(open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  struct stat a = {}, b = {};
  return there >= 0 && fstat(there, &a) == 0 && fstat(file, &b) == 0 && same_file(a, b);
}

// The text about itself that the holder of the lock has written into the file.
std::string holder_of(int file) {
  std::array<char, 300> bytes{};
  const ssize_t n = pread(file, bytes.data(), bytes.size(), 0);
  if (n <= 0) return "another process";
  const std::string text(bytes.data(), size_t(n));
  return text == this_process() ? "this process" : text;
}

}  // namespace

struct FileLock::Content {
  fs::path path, target, name;  // as given; after all links; name of the lock file
  Descriptor file;
  pid_t owner = getpid();
  bool held = false;
  std::optional<struct stat> seen;

  // Tries to take the lock. Returns the holder if another process has the lock, and nothing if the lock is taken.
  std::optional<std::string> take() {
    for (;;) {
      file = open_or_create(name);
      if (file < 0) fail("can't be locked: {}", std::generic_category().message(errno));
      struct stat found = {};
      if (fstat(file, &found) != 0 || !S_ISREG(found.st_mode))
        fail("can't be locked: a device found at {}", name.string());
      if (!io::lock(file, false)) {
        if (errno == EAGAIN || errno == EACCES) return holder_of(file);
        const int error = errno;
        unlink(name.c_str());
        throw WriteError(fmt::format("can't be locked: {}; a file system that supports locks needed",
                                     std::generic_category().message(error)),
                         error);
      }
      if (has_name(name, file)) break;  // otherwise the previous holder has removed the lock file
    }
    held = true;
    // Every user who may write to the target may lock it.
    if (const auto of = status_of(target); of && fchown(file, uid_t(-1), of->st_gid) == 0)
      fchmod(file, (of->st_mode & 0666) | 0600);
    if (ftruncate(file, 0) == 0) io::write_all(file, this_process());
    return std::nullopt;
  }

  void wait(const LockOptions& options) {
    using Seconds = std::chrono::duration<double>;
    const auto end = Clock::now() + std::chrono::duration_cast<Clock::duration>(Seconds(std::min(options.limit, 1e9)));
    Seconds pause(0.002);
    for (bool told = false;; told = true) {
      const std::optional<std::string> holder = io::naming_write(path, [&] { return take(); });
      if (!holder) return;
      const Seconds left = end - Clock::now();
      if (left.count() <= 0)
        throw IoError(io::named(
            path, fmt::format("{} has locked the file{}; try again when the lock is free, or wait longer", *holder,
                              options.limit > 0 ? fmt::format(", for more than {:g} s", options.limit) : "")));
      if (!told && options.waits)
        options.waits(
            io::named(path, fmt::format("{} has locked the file; waiting for up to {:g} s", *holder, options.limit)));
      checkpoint();
      std::this_thread::sleep_for(std::min(pause, left));
      pause = std::min(1.5 * pause, Seconds(0.1));
    }
  }

  ~Content() {
    if (!held || owner != getpid()) return;  // after fork(), only the parent removes the lock file
    // The name is removed before the lock is released. A waiting process then sees that the lock file has no name, and
    // starts again.
    unlink(name.c_str());
  }
};

FileLock::FileLock(const fs::path& file, const LockOptions& options) : content_(std::make_unique<Content>()) {
  if (!(options.limit >= 0))
    throw std::invalid_argument(fmt::format("limit of a lock: {} s found, 0 or more needed", options.limit));
  Content& c = *content_;
  c.path = file;
  c.target = fs::absolute(io::naming_write(file, [&] { return io::resolved(file); }));
  c.name = io::hidden_name(c.target, ".lock");
  c.wait(options);
  see();
}

FileLock::~FileLock() = default;
FileLock::FileLock(FileLock&&) noexcept = default;

const fs::path& FileLock::path() const { return content_->path; }

void FileLock::see() { content_->seen = status_of(content_->target); }

void FileLock::check() const {
  const auto &before = content_->seen, now = status_of(content_->target);
  const bool same = before ? now && same_file(*before, *now) && before->st_size == now->st_size &&
                                 before->st_mtim.tv_sec == now->st_mtim.tv_sec &&
                                 before->st_mtim.tv_nsec == now->st_mtim.tv_nsec
                           : !now;
  if (!same)
    throw IoError(io::named(
        content_->path, "another program has changed the file without the lock, so nothing was written; call again"));
}

}  // namespace tokid
