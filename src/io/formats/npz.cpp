// NumPy's .npz: a zip archive with one .npy file for each array.
// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <unistd.h>
#include <zip.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <deque>
#include <memory>
#include <optional>
#include <unordered_set>

#include "io/formats/formats.hpp"
#include "io/guard/atomic_file.hpp"
#include "io/guard/claims.hpp"
#include "io/text.hpp"

namespace tokid::io {

namespace {

constexpr std::string_view magic = "\x93NUMPY";
constexpr char native_order = std::endian::native == std::endian::little ? '<' : '>';

// ---- the header of a .npy file: a Python dictionary ----

struct NpyHeader {
  std::string descr;  // the type, such as '<f8'; for a structured array the raw text of its list of fields
  bool fortran_order = false;
  Shape shape;
};

class HeaderParser {
 public:
  explicit HeaderParser(std::string_view text) : rest_(text) {}

  std::optional<NpyHeader> parse() {
    NpyHeader header;
    int found = 0;
    if (!take('{')) return std::nullopt;
    while (!take('}')) {
      const auto key = string();
      if (!key || !take(':')) return std::nullopt;
      bool valid = false;
      if (*key == "descr") valid = descr(header.descr);
      if (*key == "fortran_order") valid = boolean(header.fortran_order);
      if (*key == "shape") valid = shape(header.shape);
      if (!valid) return std::nullopt;
      ++found;
      take(',');
    }
    return found == 3 ? std::optional(header) : std::nullopt;
  }

 private:
  void skip_blanks() { rest_.remove_prefix(std::min(rest_.find_first_not_of(" \t\n"), rest_.size())); }

  bool take(char c) {
    skip_blanks();
    if (!rest_.starts_with(c)) return false;
    rest_.remove_prefix(1);
    return true;
  }

  bool take(std::string_view word) {
    skip_blanks();
    if (!rest_.starts_with(word)) return false;
    rest_.remove_prefix(word.size());
    return true;
  }

  std::optional<std::string> string() {
    skip_blanks();
    if (rest_.empty() || (rest_[0] != '\'' && rest_[0] != '"')) return std::nullopt;
    const size_t end = rest_.find(rest_[0], 1);
    if (end == std::string_view::npos) return std::nullopt;
    std::string result(rest_.substr(1, end - 1));
    rest_.remove_prefix(end + 1);
    return result;
  }

  bool descr(std::string& result) {
    skip_blanks();
    if (rest_.starts_with('[')) {
      // The list of fields of a structured array may have nested brackets. It ends where the key 'fortran_order'
      // begins.
      const size_t end = rest_.find("'fortran_order'");
      if (end == std::string_view::npos) return false;
      result = rest_.substr(0, end);
      rest_.remove_prefix(end);
      return true;
    }
    auto name = string();
    if (name) result = std::move(*name);
    return name.has_value();
  }

  bool boolean(bool& result) {
    result = take(std::string_view("True"));
    return result || take(std::string_view("False"));
  }

  bool shape(Shape& result) {
    if (!take('(')) return false;
    while (!take(')')) {
      skip_blanks();
      size_t n = 0;
      const auto [end, error] = std::from_chars(rest_.data(), rest_.data() + rest_.size(), n);
      if (error != std::errc()) return false;
      rest_.remove_prefix(static_cast<size_t>(end - rest_.data()));
      take('L');  // long integers of Python 2
      result.push_back(n);
      if (!take(',') && !rest_.starts_with(')')) return false;
    }
    return true;
  }

  std::string_view rest_;
};

// ---- values ----

struct Type {
  char order, kind;  // '<', 'f'
  size_t size;       // number of characters for 'U', number of bytes for other kinds

  size_t item_bytes() const { return kind == 'U' ? 4 * size : size; }
};

std::optional<Type> type_from(std::string_view descr) {
  if (descr.size() < 2) return std::nullopt;
  Type type{descr[0], descr[1], 0};
  if (type.order == '=' || type.order == '|') type.order = native_order;
  const auto [end, error] = std::from_chars(descr.data() + 2, descr.data() + descr.size(), type.size);
  if (error != std::errc() || end != descr.data() + descr.size()) return std::nullopt;
  if (type.order != '<' && type.order != '>') return std::nullopt;
  return type;
}

template <typename T>
T load(const char* bytes, bool swap) {
  char item[sizeof(T)];
  std::memcpy(item, bytes, sizeof(T));
  if (swap) std::reverse(item, item + sizeof(T));
  T value;
  std::memcpy(&value, item, sizeof(T));
  return value;
}

template <typename T>
std::vector<double> decoded(const std::vector<char>& bytes, bool swap) {
  std::vector<double> values(bytes.size() / sizeof(T));
  for (size_t i = 0; i < values.size(); ++i) values[i] = static_cast<double>(load<T>(&bytes[i * sizeof(T)], swap));
  return values;
}

using Decoder = std::vector<double> (*)(const std::vector<char>&, bool);

Decoder decoder(const Type& type) {
  switch (type.kind) {
    case 'f':
      return type.size == 8 ? decoded<double> : type.size == 4 ? decoded<float> : nullptr;
    case 'b':
      return type.size == 1 ? decoded<std::uint8_t> : nullptr;
    case 'i':
      return type.size == 8   ? decoded<std::int64_t>
             : type.size == 4 ? decoded<std::int32_t>
             : type.size == 2 ? decoded<std::int16_t>
             : type.size == 1 ? decoded<std::int8_t>
                              : nullptr;
    case 'u':
      return type.size == 8   ? decoded<std::uint64_t>
             : type.size == 4 ? decoded<std::uint32_t>
             : type.size == 2 ? decoded<std::uint16_t>
             : type.size == 1 ? decoded<std::uint8_t>
                              : nullptr;
    default:
      return nullptr;
  }
}

std::string kind_in_words(const std::string& descr) {
  if (descr.starts_with('[')) return "records (a structured array)";
  switch (descr.size() > 1 ? descr[1] : ' ') {
    case 'c':
      return fmt::format("complex numbers ({})", descr);
    case 'O':
      return "Python objects";
    case 'M':
    case 'm':
      return fmt::format("dates or times ({})", descr);
    default:
      return fmt::format("values of type '{}'", descr);
  }
}

std::string text_item(const char* bytes, const Type& type, std::string_view name) {
  if (type.kind == 'S') {
    std::string_view item(bytes, type.size);
    return std::string(item.substr(0, item.find_last_not_of('\0') + 1));
  }
  std::u32string item;
  for (size_t i = 0; i < type.size; ++i) item += load<char32_t>(bytes + 4 * i, type.order != native_order);
  while (!item.empty() && item.back() == 0) item.pop_back();
  const auto utf8 = utf8_from(item);
  if (!utf8) fail("data set '{}': invalid characters found, Unicode text needed", name);
  return *utf8;
}

std::vector<std::string> texts_of(const std::vector<char>& bytes, const Type& type, size_t count,
                                  std::string_view name) {
  std::vector<std::string> texts;
  for (size_t i = 0; i < count; ++i) texts.push_back(text_item(bytes.data() + i * type.item_bytes(), type, name));
  return texts;
}

// ---- reading the archive ----

struct Discard {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
using Archive = std::unique_ptr<zip_t, Discard>;

std::string reason(int code) {
  zip_error_t error;
  zip_error_init_with_code(&error, code);
  std::string text = zip_error_strerror(&error);
  zip_error_fini(&error);
  return text;
}

class Entry {
 public:
  Entry(zip_t* archive, zip_uint64_t index, std::string name) : name_(std::move(name)) {
    zip_stat_t stat;
    constexpr zip_uint64_t needed = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
    if (zip_stat_index(archive, index, 0, &stat) != 0 || (stat.valid & needed) != needed)
      fail("data set '{}' can't be read: {}", name_, zip_strerror(archive));
    if (stat.comp_method != ZIP_CM_STORE && stat.comp_method != ZIP_CM_DEFLATE)
      fail("data set '{}': zip method {} found, stored or deflated needed", name_, stat.comp_method);
    left_ = stat.size;
    file_.reset(zip_fopen_index(archive, index, 0));
    if (!file_) fail("data set '{}' can't be read: {}", name_, zip_strerror(archive));
  }

  std::uint64_t left() const { return left_; }

  void read(void* to, size_t bytes) {
    if (bytes > left_) fail("data set '{}': truncated, {} more bytes needed", name_, bytes - left_);
    for (auto* at = static_cast<char*>(to); bytes > 0;) {
      const zip_int64_t n = zip_fread(file_.get(), at, bytes);
      if (n <= 0) fail("data set '{}' can't be read: {}", name_, n < 0 ? zip_file_strerror(file_.get()) : "truncated");
      at += n;
      bytes -= static_cast<size_t>(n);
      left_ -= static_cast<std::uint64_t>(n);
    }
  }

  // Reads to the end, because libzip compares the checksum only there.
  void finish() {
    char byte;
    if (zip_fread(file_.get(), &byte, 1) != 0)
      fail("data set '{}' can't be read: {}", name_, zip_file_strerror(file_.get()));
  }

 private:
  struct Close {
    void operator()(zip_file_t* file) const { zip_fclose(file); }
  };
  std::string name_;
  std::uint64_t left_ = 0;
  std::unique_ptr<zip_file_t, Close> file_;
};

NpyHeader read_header(Entry& entry, const std::string& name) {
  char prefix[8] = {};
  if (entry.left() >= sizeof prefix) entry.read(prefix, sizeof prefix);
  const auto version = static_cast<unsigned char>(prefix[6]);
  if (!std::string_view(prefix, sizeof prefix).starts_with(magic) || version < 1 || version > 3)
    fail("data set '{}': no header of a NumPy array found, .npy version 1 to 3 needed", name);
  unsigned char length[4] = {};
  entry.read(length, version == 1 ? 2 : 4);
  const size_t size = size_t{length[0]} | size_t{length[1]} << 8 | size_t{length[2]} << 16 | size_t{length[3]} << 24;
  constexpr size_t most = 1 << 16;
  if (size > most) fail("data set '{}': header of {} bytes found, at most {} needed", name, size, most);
  if (size > entry.left())
    fail("data set '{}': truncated, {} bytes of its header found, {} needed", name, entry.left(), size);
  std::string text(size, '\0');
  entry.read(text.data(), size);
  const auto header = HeaderParser(text).parse();
  if (!header) fail("data set '{}': header {} found, the header of a NumPy array needed", name, text);
  return *header;
}

std::vector<char> read_bytes(Entry& entry) {
  std::vector<char> bytes(entry.left());
  entry.read(bytes.data(), bytes.size());
  return bytes;
}

std::vector<double> read_numbers(Entry& entry, const Type& type) {
  const bool swap = type.order != native_order;
  if (type.kind != 'f' || type.size != sizeof(double) || swap) return decoder(type)(read_bytes(entry), swap);
  std::vector<double> values(entry.left() / sizeof(double));
  entry.read(values.data(), values.size() * sizeof(double));
  return values;
}

Array read_array(zip_t* archive, zip_uint64_t index, const std::string& name, Claims& claims) {
  Entry entry(archive, index, name);
  NpyHeader header = read_header(entry, name);
  const auto type = type_from(header.descr);
  const bool is_text = type && (type->kind == 'U' || type->kind == 'S');
  if (!is_text && !(type && decoder(*type))) return {header.shape, Foreign{kind_in_words(header.descr)}};

  // Empty texts take no bytes, so the file size does not limit their number; 65536 are allowed.
  if (is_text && type->size > (std::uint64_t{1} << 32)) fail("data set '{}': type '{}' found", name, header.descr);
  const size_t bytes = checked_product(header.shape, type->item_bytes());
  if (bytes != entry.left() || (type->size == 0 && checked_product(header.shape) > 65536))
    fail("data set '{}': {} bytes found, {} needed for shape {} of type {}", name, entry.left(), bytes,
         text(header.shape), header.descr);
  claims.add(name, header.shape, type->item_bytes(),
             is_text ? sizeof(std::string) + type->item_bytes() : std::max(sizeof(double), type->size));

  Array array{header.shape, {}};
  if (header.fortran_order) std::reverse(array.shape.begin(), array.shape.end());
  if (is_text)
    array.values = texts_of(read_bytes(entry), *type, checked_product(header.shape), name);
  else
    array.values = read_numbers(entry, *type);
  entry.finish();
  return header.fortran_order ? reversed(array) : array;
}

// ---- writing ----

std::string npy_header(const std::string& descr, const Shape& shape) {
  const std::string tuple =
      shape.size() == 1 ? fmt::format("({},)", shape[0]) : fmt::format("({})", fmt::join(shape, ", "));
  std::string dictionary = fmt::format("{{'descr': '{}', 'fortran_order': False, 'shape': {}, }}", descr, tuple);
  constexpr size_t before = 10, alignment = 64;
  dictionary.append(alignment - 1 - (before + dictionary.size()) % alignment, ' ');
  dictionary += '\n';
  std::string header(magic);
  header += {'\x01', '\x00', static_cast<char>(dictionary.size() & 0xFF), static_cast<char>(dictionary.size() >> 8)};
  return header + dictionary;
}

// The bytes of an array. libzip reads these bytes when the archive is closed.
struct Payload {
  std::string header;
  std::u32string characters;
  zip_buffer_fragment_t fragments[2] = {};

  void set(const void* data, size_t bytes) {
    const auto fragment = [](const void* at, size_t n) {
      return zip_buffer_fragment_t{static_cast<zip_uint8_t*>(const_cast<void*>(at)), n};
    };
    fragments[0] = fragment(header.data(), header.size());
    fragments[1] = fragment(data, bytes);
  }
};

template <typename T>
void fill(Payload& payload, const Shape& shape, const std::vector<T>& numbers, char kind) {
  payload.header = npy_header(fmt::format("{}{}8", native_order, kind), shape);
  payload.set(numbers.data(), numbers.size() * sizeof(T));
}

void fill(Payload& payload, const Shape& shape, const std::vector<std::string>& texts) {
  std::vector<std::u32string> items;
  size_t longest = 1;  // if all texts are empty, NumPy still needs a length of one
  for (const auto& text : texts) {
    items.push_back(*utf32_from(text));
    longest = std::max(longest, items.back().size());
  }
  for (auto& item : items) payload.characters += item + std::u32string(longest - item.size(), U'\0');
  payload.header = npy_header(fmt::format("{}U{}", native_order, longest), shape);
  payload.set(payload.characters.data(), payload.characters.size() * sizeof(char32_t));
}

void fill(Payload& payload, const Array& array) {
  if (const auto* numbers = std::get_if<std::vector<double>>(&array.values))
    fill(payload, array.shape, *numbers, 'f');
  else if (const auto* integers = std::get_if<std::vector<std::int64_t>>(&array.values))
    fill(payload, array.shape, *integers, 'i');
  else
    fill(payload, array.shape, std::get<std::vector<std::string>>(array.values));
}

void add_entry(zip_t* archive, const std::string& name, const Payload& payload) {
  const zip_uint64_t count = payload.fragments[1].length == 0 ? 1 : 2;
  zip_source_t* source = zip_source_buffer_fragment(archive, payload.fragments, count, 0);
  const zip_int64_t index = source ? zip_file_add(archive, (name + ".npy").c_str(), source, ZIP_FL_ENC_UTF_8) : -1;
  if (source && index < 0) zip_source_free(source);
  constexpr zip_uint16_t january_1980 = (1 << 5) | 1;  // as NumPy; the bytes must not depend on the clock
  const auto at = static_cast<zip_uint64_t>(index);
  if (index < 0 || zip_set_file_compression(archive, at, ZIP_CM_STORE, 0) != 0 ||
      zip_file_set_dostime(archive, at, 0, january_1980, 0) != 0)
    fail_to_write(fmt::format("data set '{}': {}", name, zip_strerror(archive)));
}

}  // namespace

Contents read_npz(const std::filesystem::path& path, const Names& wanted) {
  int code = 0;
  const Archive archive(zip_open(path.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, &code));
  if (!archive && code == ZIP_ER_EXISTS)
    fail("two arrays with the same name found in the archive, different names needed");
  if (!archive) fail("no complete .npz archive found: {}", reason(code));
  Contents contents;
  Claims claims(std::filesystem::file_size(path));
  const zip_int64_t count = zip_get_num_entries(archive.get(), 0);
  std::unordered_set<std::string> known;
  for (zip_int64_t i = 0; i < count; ++i) {
    const auto index = static_cast<zip_uint64_t>(i);
    const char* entry = zip_get_name(archive.get(), index, 0);
    std::string name = entry ? entry : "";
    if (!name.ends_with(".npy")) continue;
    name.resize(name.size() - 4);
    if (!known.insert(name).second) continue;
    contents.names.push_back(name);
    if (contains(wanted, name)) contents.arrays.emplace_back(name, read_array(archive.get(), index, name, claims));
  }
  return contents;
}

namespace {

// The existing file into which libzip writes the archive. Without this class, libzip would create a temporary file of
// its own, which would remain if the process is killed.
class Target {
 public:
  explicit Target(const std::filesystem::path& path)
      : file_(open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666)) {
    if (file_ < 0) fail_to_write(errno);
    zip_error_init(&error_);
  }
  ~Target() { zip_error_fini(&error_); }
  Target(const Target&) = delete;
  Target& operator=(const Target&) = delete;

  zip_source_t* source() { return zip_source_function_create(call, this, &error_); }
  int error() const { return reason_; }

 private:
  static zip_int64_t call(void* self, void* data, zip_uint64_t size, zip_source_cmd_t command) {
    return static_cast<Target*>(self)->answer(data, size, command);
  }

  zip_int64_t answer(void* data, zip_uint64_t size, zip_source_cmd_t command) {
    switch (command) {
      case ZIP_SOURCE_SUPPORTS:
        return zip_source_make_command_bitmap(
            ZIP_SOURCE_STAT, ZIP_SOURCE_ERROR, ZIP_SOURCE_FREE, ZIP_SOURCE_OPEN, ZIP_SOURCE_READ, ZIP_SOURCE_CLOSE,
            ZIP_SOURCE_SEEK, ZIP_SOURCE_TELL, ZIP_SOURCE_BEGIN_WRITE, ZIP_SOURCE_WRITE, ZIP_SOURCE_SEEK_WRITE,
            ZIP_SOURCE_TELL_WRITE, ZIP_SOURCE_COMMIT_WRITE, ZIP_SOURCE_ROLLBACK_WRITE, ZIP_SOURCE_REMOVE, -1);
      case ZIP_SOURCE_STAT:  // there is no archive yet
        zip_error_set(&error_, ZIP_ER_READ, ENOENT);
        return -1;
      case ZIP_SOURCE_ERROR:
        return zip_error_to_data(&error_, data, size);
      case ZIP_SOURCE_WRITE:
        return write(static_cast<const char*>(data), size);
      case ZIP_SOURCE_SEEK_WRITE: {
        const auto* to = ZIP_SOURCE_GET_ARGS(zip_source_args_seek_t, data, size, &error_);
        return to && lseek(file_, off_t(to->offset), to->whence) >= 0 ? 0 : refuse(ZIP_ER_SEEK);
      }
      case ZIP_SOURCE_TELL_WRITE:
        return lseek(file_, 0, SEEK_CUR);
      case ZIP_SOURCE_FREE:
      case ZIP_SOURCE_BEGIN_WRITE:
      case ZIP_SOURCE_COMMIT_WRITE:
      case ZIP_SOURCE_ROLLBACK_WRITE:
        return 0;
      default:
        zip_error_set(&error_, ZIP_ER_OPNOTSUPP, 0);
        return -1;
    }
  }

  zip_int64_t write(const char* bytes, zip_uint64_t count) {
    try {
      write_all(file_, {bytes, count});
    } catch (const WriteError& error) {
      errno = error.error();
      return refuse(ZIP_ER_WRITE);
    }
    return zip_int64_t(count);
  }

  zip_int64_t refuse(int code) {
    reason_ = errno;
    zip_error_set(&error_, code, errno);
    return -1;
  }

  Descriptor file_;
  zip_error_t error_{};
  int reason_ = 0;
};

}  // namespace

void write_npz(const Arrays& arrays, const std::filesystem::path& path) {
  Target target(path);
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* source = target.source();
  Archive archive(source ? zip_open_from_source(source, ZIP_CREATE | ZIP_TRUNCATE, &error) : nullptr);
  if (!archive) fail_to_write(zip_error_strerror(&error));
  std::deque<Payload> payloads;  // must not move until the archive is closed
  for (const auto& [name, array] : arrays) {
    fill(payloads.emplace_back(), array);
    add_entry(archive.get(), name, payloads.back());
  }
  if (zip_close(archive.get()) != 0) {
    if (target.error() != 0) fail_to_write(target.error());
    fail_to_write(zip_strerror(archive.get()));
  }
  static_cast<void>(archive.release());
}

}  // namespace tokid::io
