// Common tools for the HDF5 library: handles that close themselves, reasons of errors in words, parts of data sets.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <hdf5.h>

#include <string>
#include <string_view>
#include <utility>

#include "io/arrays.hpp"

namespace tokid::io {

// Stops the library from printing its error stack on stderr. The messages of tokid contain the innermost reason of that
// stack instead.
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

// The reason why the last call of the library failed.
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

// \throws IoError unless the file is a complete HDF5 file
Handle open_hdf5(const std::string& path, hid_t access = H5P_DEFAULT);

// The shape of a chunk of a data set with these creation properties. \throws IoError if the rank is not `rank`
std::vector<hsize_t> chunk_shape(hid_t properties, size_t rank, const std::string& name);

Handle text_type(size_t size, H5T_str_t padding, H5T_cset_t characters);
Handle space_of(const Shape& shape);

// A range of every axis.
struct Hyperslab {
  std::vector<hsize_t> begin, count;
};
Handle selected(hid_t data, const std::string& name, const Hyperslab& part);  // the part as a selection in the file
Handle memory_of(const Hyperslab& part);

}  // namespace tokid::io
