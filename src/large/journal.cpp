// SPDX-License-Identifier: BSD-3-Clause
#include "large/journal.hpp"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <vector>

#define XXH_INLINE_ALL
#include <xxhash.h>

#include "base/json.hpp"
#include "io/naming.hpp"

namespace tokid::stream {

namespace {

using io::fail;

constexpr std::string_view magic =
    "tokid\x1a"
    "2\n";
// Longest time between two writes to the disk. A power cut destroys at most the work of this time.
constexpr auto between_syncs = std::chrono::seconds(1);

struct Head {
  std::uint64_t size = 0, digest = 0;
};

// Digest of a record and of its number in the file.
std::uint64_t digest_of(std::string_view record, std::uint64_t place) {
  return XXH3_64bits_withSeed(record.data(), record.size(), place);
}

std::filesystem::path path_of(const std::filesystem::path& model) { return model.string() + ".resume"; }

// "lags: 2 found, 3 needed" for every difference.
std::string differences(const Json& found, const Json& needed) {
  std::vector<std::string> result;
  for (const auto& [key, value] : needed.items()) {
    const auto there = found.find(key);
    if (there == found.end() || *there != value)
      result.push_back(fmt::format("{}: {} found, {} needed", key, there == found.end() ? "nothing" : text_of(*there),
                                   text_of(value)));
  }
  return fmt::format("{}", fmt::join(result, "; "));
}

}  // namespace

Journal::Journal(const std::filesystem::path& model) : path_(path_of(model)) {
  io::naming_write(path_, [&] {
    open();
    check_magic();
    about_ = next();
    const std::int64_t end = end_;
    kept_ = about_ && next();
    end_ = end;
    records_ = about_ ? 1 : 0;
  });
}

Journal::~Journal() {
  if (file_ >= 0 && !kept_) unlink(path_.c_str());
}

void Journal::open() {
  do {
    const int opened = ::open(path_.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0666);
    const int reason = opened < 0 ? errno : 0;  // read before closing a file changes errno
    file_ = io::Descriptor(opened);
    if (reason == ELOOP) fail("a symbolic link found, a file needed; remove the link");
    if (reason == EISDIR) fail("a directory found, a journal needed");
    if (reason != 0) io::fail_to_write(reason);
    struct stat found = {};
    if (fstat(file_, &found) != 0 || !S_ISREG(found.st_mode)) fail("a device found, a journal needed");
    if (!io::lock(file_, false)) {
      if (errno == EAGAIN || errno == EACCES) fail("another process writes the same model, wait until it ends");
      io::fail_to_write(errno);  // without a lock, two processes could mix their records
    }
  } while (!io::is_at(path_, file_));  // the process that had the lock before may have removed the file
}

void Journal::check_magic() {
  std::string start(magic.size(), '\0');
  struct stat found = {};
  fstat(file_, &found);
  start.resize(std::min(start.size(), size_t(found.st_size)));
  io::read_all(file_, start, 0);
  if (!magic.starts_with(start)) {
    kept_ = true;  // the destructor must not remove the file of another program
    fail("another file found, a journal of this version of tokid identify --resume needed");
  }
  end_ = std::int64_t(magic.size());
}

void Journal::begin(const std::string& about) {
  io::naming_write(path_, [&] {
    if (!kept_) return restart(about);  // the journal contains no results
    const Json found = parse_json(*about_), needed = parse_json(about);
    if (found != needed)
      fail(
          "the journal of another identification found ({}); delete the journal to start anew, or repeat the "
          "earlier call to continue it",
          differences(found, needed));
  });
}

void Journal::restart(const std::string& about) {
  if (ftruncate(file_, 0) != 0 || lseek(file_, 0, SEEK_SET) != 0) io::fail_to_write(errno);
  io::write_all(file_, magic);
  end_ = std::int64_t(magic.size());
  records_ = 0;
  append(about);
  io::sync_folder(path_);
}

std::optional<std::string> Journal::next() {
  std::string bytes(sizeof(Head), '\0');
  Head head;
  struct stat found = {};
  if (io::read_all(file_, bytes, end_) && fstat(file_, &found) == 0) {
    std::memcpy(&head, bytes.data(), sizeof(Head));
    const std::int64_t begin = end_ + std::int64_t(sizeof(Head));
    if (head.size <= std::uint64_t(found.st_size - begin)) {
      bytes.resize(head.size);
      if (io::read_all(file_, bytes, begin) && digest_of(bytes, records_) == head.digest) {
        end_ = begin + std::int64_t(head.size);
        ++records_;
        return bytes;
      }
    }
  }
  return std::nullopt;
}

void Journal::append(std::string_view record) {
  const auto cut = [this] {
    if (ftruncate(file_, end_) != 0 || lseek(file_, end_, SEEK_SET) != end_) io::fail_to_write(errno);
  };
  if (reading_) cut();  // removes a record that is not complete
  reading_ = false;
  const Head head{record.size(), digest_of(record, records_)};
  try {
    io::write_all(file_, {reinterpret_cast<const char*>(&head), sizeof head});
    io::write_all(file_, record);
  } catch (const WriteError&) {
    cut();
    throw;
  }
  end_ += std::int64_t(sizeof head + record.size());
  ++records_;
}

void Journal::add(std::string_view record) {
  io::naming_write(path_, [&] {
    append(record);
    kept_ = true;
    if (const auto now = std::chrono::steady_clock::now(); now - synced_ > between_syncs) {
      if (fdatasync(file_) != 0 && errno != EINVAL && errno != ENOTSUP) io::fail_to_write(errno);
      synced_ = now;
    }
  });
}

void Journal::remove() {
  unlink(path_.c_str());
  file_ = io::Descriptor();
}

void Journal::discard(const std::filesystem::path& model) {
  const std::filesystem::path path = path_of(model);
  const io::Descriptor file(::open(path.c_str(), O_RDWR | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  std::string start(magic.size(), '\0');
  if (file >= 0 && io::lock(file, false) && io::read_all(file, start, 0) && start == magic && io::is_at(path, file))
    unlink(path.c_str());
}

}  // namespace tokid::stream
