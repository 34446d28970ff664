// SPDX-License-Identifier: BSD-3-Clause
#include "hdf5_handles.hpp"

#include <algorithm>

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

Handle write_values(hid_t group, const std::string& name, const Shape& shape, hid_t stored_type, hid_t memory_type,
                    const void* values) {
  const Handle space = space_of(shape);
  const Handle properties(H5Pcreate(H5P_DATASET_CREATE), H5Pclose, name);
  checked(H5Pset_obj_track_times(properties, false), name);
  Handle data(H5Dcreate2(group, name.c_str(), stored_type, space, H5P_DEFAULT, properties, H5P_DEFAULT), H5Dclose,
              name);
  checked(H5Dwrite(data, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), name);
  return data;
}

namespace {

void write_texts(hid_t file, const std::string& name, const Shape& shape, const std::vector<std::string>& texts) {
  size_t longest = 1;
  for (const auto& text : texts) longest = std::max(longest, text.size());
  // Of fixed length, so that the bytes lie where the data set is, not in a heap.
  const Handle type = text_type(longest, H5T_STR_NULLPAD, H5T_CSET_UTF8);
  std::string bytes;
  for (const auto& text : texts) bytes += text + std::string(longest - text.size(), '\0');
  write_values(file, name, shape, type, type, bytes.data());
}

}  // namespace

void write_array(hid_t file, const std::string& name, const Array& array) {
  if (const auto* numbers = std::get_if<std::vector<double>>(&array.values))
    write_values(file, name, array.shape, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, numbers->data());
  else if (const auto* integers = std::get_if<std::vector<std::int64_t>>(&array.values))
    write_values(file, name, array.shape, H5T_STD_I64LE, H5T_NATIVE_INT64, integers->data());
  else
    write_texts(file, name, array.shape, std::get<std::vector<std::string>>(array.values));
}

}  // namespace tokid::io
