// What every use of the HDF5 library needs: handles that close themselves, reasons in words, data sets written whole.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <hdf5.h>

#include <string>
#include <string_view>
#include <utility>

#include "arrays.hpp"

namespace tokid::io {

// The library would print its error stack on stderr; the innermost reason goes into our own message instead.
class QuietHdf5 {
 public:
  QuietHdf5();
  ~QuietHdf5();
  QuietHdf5(const QuietHdf5&) = delete;
  QuietHdf5& operator=(const QuietHdf5&) = delete;

 private:
  H5E_auto2_t print_ = nullptr;
  void* data_ = nullptr;
};

// Why the last call failed.
std::string hdf5_reason();

// \throws IoError for a negative status
template <typename T>
T checked(T status, std::string_view name = {}) {
  if (status < 0) name.empty() ? fail("HDF5: {}", hdf5_reason()) : fail("data set '{}': HDF5: {}", name, hdf5_reason());
  return status;
}

class Handle {
 public:
  using Closer = herr_t (*)(hid_t);
  Handle(hid_t id, Closer closer, std::string_view name = {}) : id_(checked(id, name)), closer_(closer) {}
  Handle(Handle&& other) noexcept : id_(std::exchange(other.id_, -1)), closer_(other.closer_) {}
  Handle& operator=(Handle&&) = delete;
  ~Handle() {
    if (id_ >= 0) closer_(id_);
  }
  operator hid_t() const { return id_; }

 private:
  hid_t id_;
  Closer closer_;
};

// \throws IoError unless the file is a complete one
Handle open_hdf5(const std::string& path, hid_t access = H5P_DEFAULT);

Handle text_type(size_t size, H5T_str_t padding, H5T_cset_t characters);
Handle space_of(const Shape& shape);

// A data set of its own for all of the values. \throws IoError
Handle write_values(hid_t group, const std::string& name, const Shape& shape, hid_t stored_type, hid_t memory_type,
                    const void* values);
void write_array(hid_t file, const std::string& name, const Array& array);

}  // namespace tokid::io
