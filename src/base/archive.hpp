// Converts values to bytes and back, for files and for messages between processes of the same program on machines of
// the same kind.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <cstring>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "tokid/types.hpp"

namespace tokid::archive {

// A struct can be archived if it has a function `template <class Archive, class S> void fields(Archive& archive, S& s)`
// that calls archive(s.a, s.b, …).

// Smallest number of bytes of a record of a type. A list cannot have more entries than the available bytes divided by
// this number.
template <class T>
inline constexpr size_t least_bytes = sizeof(size_t);

class Writer {
 public:
  template <class... T>
  void operator()(const T&... values) {
    (write(values), ...);
  }
  const std::string& bytes() const { return bytes_; }

 private:
  template <class T>
  void write(const T& value) {
    if constexpr (requires(Writer & writer) { fields(writer, value); })
      fields(*this, value);
    else {
      static_assert(std::is_trivially_copyable_v<T>);
      bytes_.append(reinterpret_cast<const char*>(&value), sizeof(T));
    }
  }
  template <class T>
  void write(const std::vector<T>& list) {
    write(list.size());
    for (const T& value : list) write(value);
  }
  template <class T>
  void write(const std::optional<T>& value) {
    write(value.has_value());
    if (value) write(*value);
  }
  template <class K, class V>
  void write(const std::map<K, V>& entries) {
    write(entries.size());
    for (const auto& [key, value] : entries) write(key), write(value);
  }
  void write(const std::string& text) {
    write(text.size());
    bytes_ += text;
  }
  void write(const Matrix& a) {
    write(a.rows()), write(a.cols());
    bytes_.append(reinterpret_cast<const char*>(a.data()), size_t(a.size()) * sizeof(double));
  }
  void write(const Vector& a) {
    write(a.size());
    bytes_.append(reinterpret_cast<const char*>(a.data()), size_t(a.size()) * sizeof(double));
  }

  std::string bytes_;
};

// Reads values. Compares every stored size with the number of remaining bytes before it allocates memory.
// \throws std::runtime_error
class Reader {
 public:
  explicit Reader(std::string_view bytes) : rest_(bytes) {}

  template <class... T>
  void operator()(T&... values) {
    (read(values), ...);
  }

  void finish() const {
    if (!rest_.empty()) damaged();
  }

 private:
  [[noreturn]] static void damaged() { throw std::runtime_error("a damaged record found"); }

  // Reads the number of entries of a list. An entry has at least `bytes` bytes.
  size_t taken_count(size_t bytes) {
    const auto count = taken<size_t>();
    if (count > rest_.size() / bytes) damaged();
    return count;
  }
  Index taken_dimension() {
    const auto size = taken<Index>();
    if (size < 0 || size > std::numeric_limits<std::int32_t>::max()) damaged();
    return size;
  }

  void take(void* to, size_t count) {
    if (count > rest_.size()) damaged();
    if (count > 0) std::memcpy(to, rest_.data(), count);
    rest_.remove_prefix(count);
  }
  template <class T>
  T taken() {
    T value{};
    take(&value, sizeof(T));
    return value;
  }
  template <class T>
  void read(T& value) {
    if constexpr (requires(Reader & reader) { fields(reader, value); })
      fields(*this, value);
    else {
      static_assert(std::is_trivially_copyable_v<T>);
      take(&value, sizeof(T));
    }
  }
  void read(bool& value) {
    const auto byte = taken<std::uint8_t>();
    if (byte > 1) damaged();
    value = byte == 1;
  }
  template <class T>
  void read(std::vector<T>& list) {
    constexpr bool plain = std::is_arithmetic_v<T> || std::is_enum_v<T>;
    list.resize(taken_count(plain ? sizeof(T) : least_bytes<T>));
    for (T& value : list) read(value);
  }
  template <class T>
  void read(std::optional<T>& value) {
    bool there = false;
    read(there);
    if (!there) return value.reset();
    read(value.emplace());
  }
  template <class K, class V>
  void read(std::map<K, V>& entries) {
    for (size_t count = taken_count(least_bytes<K>); count > 0; --count) {
      K key;
      read(key);
      read(entries[std::move(key)]);
    }
  }
  void read(std::string& text) {
    text.resize(taken_count(1));
    take(text.data(), text.size());
  }
  void read(Matrix& a) {
    const Index rows = taken_dimension(), cols = taken_dimension();
    if (size_t(rows) * size_t(cols) > rest_.size() / sizeof(double)) damaged();
    a.resize(rows, cols);
    take(a.data(), size_t(a.size()) * sizeof(double));
  }
  void read(Vector& a) {
    const Index size = taken_dimension();
    if (size_t(size) > rest_.size() / sizeof(double)) damaged();
    a.resize(size);
    take(a.data(), size_t(a.size()) * sizeof(double));
  }

  std::string_view rest_;
};

template <class T>
std::string packed(const T& value) {
  Writer writer;
  writer(value);
  return writer.bytes();
}

template <class T>
T unpacked(std::string_view bytes) {
  T value;
  Reader reader(bytes);
  reader(value);
  reader.finish();
  return value;
}

}  // namespace tokid::archive
