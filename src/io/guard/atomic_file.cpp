// SPDX-License-Identifier: BSD-3-Clause
#include "io/guard/atomic_file.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <deque>
#include <functional>
#include <system_error>
#include <utility>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "io/arrays.hpp"
#include "io/naming.hpp"

namespace tokid::io {

namespace fs = std::filesystem;

void fail_to_write(int error) {
  throw WriteError(fmt::format("can't be written: {}", std::generic_category().message(error)), error);
}

void fail_to_write(std::string_view reason) { throw WriteError(fmt::format("can't be written: {}", reason), 0); }

void write_all(int file, std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t n = ::write(file, bytes.data(), bytes.size());
    if (n < 0 && errno != EINTR) fail_to_write(errno);
    if (n > 0) bytes.remove_prefix(static_cast<size_t>(n));
  }
}

bool read_all(int file, std::string& to, std::int64_t offset) {
  for (size_t done = 0; done < to.size();) {
    const ssize_t n = pread(file, to.data() + done, to.size() - done, off_t(offset) + off_t(done));
    if (n == 0 || (n < 0 && errno != EINTR)) return false;
    if (n > 0) done += size_t(n);
  }
  return true;
}

bool lock(int file, bool wait) {
  struct flock whole = {};
  whole.l_type = F_WRLCK;
  whole.l_whence = SEEK_SET;
  return fcntl(file, wait ? F_OFD_SETLKW : F_OFD_SETLK, &whole) == 0;
}

bool is_at(const fs::path& path, int file) {
  struct stat there = {}, here = {};
  return lstat(path.c_str(), &there) == 0 && fstat(file, &here) == 0 && there.st_dev == here.st_dev &&
         there.st_ino == here.st_ino;
}

void reserve(const fs::path& path, std::uint64_t bytes) {
  const Descriptor file(open(path.c_str(), O_WRONLY | O_CLOEXEC));
  if (file < 0) fail_to_write(errno);
  const int error = posix_fallocate(file, 0, off_t(bytes));
  // Some file systems cannot reserve space. On such a file system, a full disk is reported by the write that fails.
  if (error != 0 && error != EINVAL && error != EOPNOTSUPP) fail_to_write(error);
}

// Follows links, also to a target that does not exist yet.
fs::path resolved(fs::path path) {
  constexpr int most_links = 40;  // as in Linux
  std::error_code error;
  for (int i = 0; fs::is_symlink(path, error); ++i) {
    if (i == most_links) fail_to_write(ELOOP);
    path = path.parent_path() / fs::read_symlink(path, error);
    if (error) fail_to_write(error.value());
  }
  return path;
}

namespace {

fs::path folder_of(const fs::path& target) { return target.has_parent_path() ? target.parent_path() : fs::path("."); }

}  // namespace

// The name depends on the target alone. If a process is killed, the next process therefore finds its file.
fs::path hidden_name(const fs::path& target, std::string_view ending) {
  const std::string name = target.filename().string();
  return folder_of(target) / fmt::format(".tokid-{:016x}{}", XXH3_64bits(name.data(), name.size()), ending);
}

namespace {

// Checks the target before anything is written. Without this check, the renaming at the end would silently replace a
// file that the user may not write to, or a device.
fs::path writable_target(const fs::path& path) {
  std::error_code error;
  const auto status = fs::status(path, error);  // follows links, even to a file without a name
  if (fs::is_directory(status)) fail("a directory found, the name of a file to write needed");
  if (fs::exists(status) && !fs::is_regular_file(status)) fail("a device found, the name of a file to write needed");
  fs::path target = resolved(path);
  if (fs::exists(status) && access(target.c_str(), W_OK) != 0) fail_to_write(errno);
  return target;
}

fs::path temporary_name(const fs::path& target, unsigned i) { return hidden_name(target, fmt::format("-{}.tmp", i)); }

// Removes the file that a killed process left under this name. True: the name is free, unless another call takes the
// name first.
bool remove_abandoned(const fs::path& path) {
  const Descriptor file(open(path.c_str(), O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  if (file < 0) return errno == ENOENT;
  struct stat found = {};
  if (fstat(file, &found) != 0 || !S_ISREG(found.st_mode) || !lock(file, false)) return false;
  return !is_at(path, file) || unlink(path.c_str()) == 0;
}

struct Waiting {
  std::deque<AtomicFile> files;
  std::deque<std::function<void()>> then;
};

// The new file has the permissions of the target from the start. A user who may not read the target therefore cannot
// read the new file while it is written.
mode_t creation_mode(const std::optional<struct stat>& target) {
  return target ? (target->st_mode & 0666) | 0600 : 0666;
}

thread_local Waiting* together = nullptr;

}  // namespace

void sync_folder(const fs::path& file) {
  // Failures are ignored, because the file already has its name. Only after a power cut can the name be lost, on file
  // systems without this call.
  const Descriptor folder(open(folder_of(file).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (folder >= 0) fsync(folder);
}

AtomicFile::AtomicFile(const fs::path& target) : target_(writable_target(target)) {
  struct stat old = {};
  if (stat(target_.c_str(), &old) == 0) old_ = old;
  create_unnamed();
  if (file_ < 0) create_named();
}

AtomicFile::~AtomicFile() {
  if (file_ >= 0 && !name_.empty()) unlink(name_.c_str());
}

void AtomicFile::create_unnamed() {
  remove_abandoned(temporary_name(target_, 0));
  Descriptor file(open(folder_of(target_).c_str(), O_TMPFILE | O_RDWR | O_CLOEXEC, creation_mode(old_)));
  if (file < 0) return;
  path_ = fmt::format("/proc/self/fd/{}", int(file));
  if (access(path_.c_str(), W_OK) == 0) file_ = std::move(file);
}

void AtomicFile::create_named() {
  for (unsigned i = 0;;) {
    path_ = temporary_name(target_, i);
    Descriptor file(open(path_.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, creation_mode(old_)));
    if (file < 0 && errno != EEXIST) fail_to_write(errno);
    if (file >= 0) {
      lock(file, true);
      if (!is_at(path_, file)) continue;  // another call removed the file as abandoned before the lock was taken
      name_ = path_;
      file_ = std::move(file);
      return;
    }
    if (!remove_abandoned(path_)) ++i;
  }
}

void AtomicFile::finish() {
  struct stat own = {};
  if (old_ && fstat(file_, &own) == 0) {
    const uid_t owner = geteuid() == 0 ? old_->st_uid : own.st_uid;
    mode_t mode = old_->st_mode & 0777;
    // If the file cannot get the group of the target, its group gets no permissions.
    const bool kept = own.st_uid == owner && own.st_gid == old_->st_gid;
    if (!kept && fchown(file_, owner, old_->st_gid) != 0) mode &= ~mode_t{S_IRWXG};
    if ((own.st_mode & 0777) != mode && fchmod(file_, mode) != 0) fail_to_write(errno);
  }
  // Some file systems have no fsync. The write has succeeded nevertheless.
  if (fsync(file_) != 0 && errno != EINVAL && errno != ENOTSUP) fail_to_write(errno);
}

void AtomicFile::commit() {
  finish();
  if (together)
    together->files.push_back(std::move(*this));
  else
    publish();
}

void AtomicFile::when_published(std::function<void()> then) {
  if (together)
    together->then.push_back(std::move(then));
  else
    then();
}

// False: the system cannot give a name to a file that was created without a name.
bool AtomicFile::take_temporary_name() {
  lock(file_, true);
  for (unsigned i = 0;;) {
    const fs::path name = temporary_name(target_, i);
    if (linkat(AT_FDCWD, path_.c_str(), AT_FDCWD, name.c_str(), AT_SYMLINK_FOLLOW) == 0) {
      name_ = name;
      return true;
    }
    if (errno != EEXIST) return false;
    if (!remove_abandoned(name)) ++i;
  }
}

void AtomicFile::move_to_named() {
  const Descriptor unnamed = std::move(file_);
  const fs::path from = path_;
  create_named();
  std::error_code error;
  fs::copy_file(from, name_, fs::copy_options::overwrite_existing, error);
  if (error) fail_to_write(error.value());
  finish();
}

void AtomicFile::publish() {
  // linkat() fails if the target exists. rename() replaces the target, but needs a file that has a name.
  if (!name_.empty() || linkat(AT_FDCWD, path_.c_str(), AT_FDCWD, target_.c_str(), AT_SYMLINK_FOLLOW) != 0) {
    if (name_.empty() && !take_temporary_name()) move_to_named();
    if (rename(name_.c_str(), target_.c_str()) != 0) fail_to_write(errno);
  }
  name_.clear();
  file_ = Descriptor();
  sync_folder(target_);
}

ByteWriter::ByteWriter(const fs::path& path) : file_(open(path.c_str(), O_WRONLY | O_TRUNC | O_CLOEXEC)) {
  if (file_ < 0) fail_to_write(errno);
}

void ByteWriter::rewind() {
  if (lseek(file_, 0, SEEK_SET) != 0) fail_to_write(errno);
}

}  // namespace tokid::io

namespace tokid {

struct FilesTogether::Content {
  Content() : outer(std::exchange(io::together, &waiting)) {}
  ~Content() { io::together = outer; }

  io::Waiting waiting;
  io::Waiting* outer;
};

FilesTogether::FilesTogether() : content_(std::make_unique<Content>()) {}

FilesTogether::~FilesTogether() = default;

void FilesTogether::commit() {
  std::deque<io::AtomicFile>& files = content_->waiting.files;
  std::deque<std::function<void()>>& then = content_->waiting.then;
  for (; !files.empty(); files.pop_front()) io::naming_write(files.front().target(), [&] { files.front().publish(); });
  for (; !then.empty(); then.pop_front()) then.front()();
}

}  // namespace tokid
