// SPDX-License-Identifier: BSD-3-Clause
#include "io/hdf5_handles.hpp"

namespace tokid::io {

QuietHdf5::QuietHdf5() {
  H5Eget_auto2(H5E_DEFAULT, &print_, &data_);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

QuietHdf5::~QuietHdf5() { H5Eset_auto2(H5E_DEFAULT, print_, data_); }

std::string hdf5_reason() {
  std::string text;
  const auto innermost = [](unsigned n, const H5E_error2_t* error, void* out) -> herr_t {
    if (n == 0 && error->desc) static_cast<std::string*>(out)->assign(error->desc);
    return 0;
  };
  H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, innermost, &text);
  return text.empty() ? "the HDF5 library gives no reason" : text;
}

Handle open_hdf5(const std::string& path, hid_t access) {
  const hid_t id = H5Fopen(path.c_str(), H5F_ACC_RDONLY, access);
  if (id < 0) fail("no complete HDF5 file found: {}", hdf5_reason());
  return {id, H5Fclose};
}

std::vector<hsize_t> chunk_shape(hid_t properties, size_t rank, const std::string& name) {
  std::vector<hsize_t> shape(std::max<size_t>(1, rank));
  const int found = checked(H5Pget_chunk(properties, int(shape.size()), shape.data()), name);
  if (size_t(found) != rank) fail("data set '{}': {} dimensions in its chunks found, {} needed", name, found, rank);
  if (std::find(shape.begin(), shape.end(), 0) != shape.end()) fail("data set '{}': chunks without values found", name);
  return shape;
}

Handle text_type(size_t size, H5T_str_t padding, H5T_cset_t characters) {
  Handle type(H5Tcopy(H5T_C_S1), H5Tclose);
  checked(H5Tset_size(type, size));
  checked(H5Tset_strpad(type, padding));
  checked(H5Tset_cset(type, characters));
  return type;
}

Handle space_of(const Shape& shape) {
  const std::vector<hsize_t> dims(shape.begin(), shape.end());
  return {shape.empty() ? H5Screate(H5S_SCALAR) : H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr),
          H5Sclose};
}

Handle selected(hid_t data, const std::string& name, const Hyperslab& part) {
  Handle space(H5Dget_space(data), H5Sclose, name);
  checked(H5Sselect_hyperslab(space, H5S_SELECT_SET, part.begin.data(), nullptr, part.count.data(), nullptr), name);
  return space;
}

Handle memory_of(const Hyperslab& part) {
  return {H5Screate_simple(int(part.count.size()), part.count.data(), nullptr), H5Sclose};
}

}  // namespace tokid::io
