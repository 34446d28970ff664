// HDF5, and the HDF5 that MATLAB writes as version 7.3 of its .mat.
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstring>
#include <functional>
#include <optional>

#include "atomic_file.hpp"
#include "formats.hpp"
#include "hdf5_handles.hpp"
#include "matlab.hpp"
#include "text.hpp"

namespace tokid::io {

namespace {

// ---- reading ----

// A data set or an attribute.
struct Node {
  std::string name;
  Handle id, type, space;
  std::function<herr_t(hid_t memory_type, void* to)> read;
  bool is_attribute;
};

Node open_attribute(hid_t object, const std::string& name) {
  Handle id(H5Aopen(object, name.c_str(), H5P_DEFAULT), H5Aclose, name);
  Handle type(H5Aget_type(id), H5Tclose, name), space(H5Aget_space(id), H5Sclose, name);
  const hid_t raw = id;
  return {name,
          std::move(id),
          std::move(type),
          std::move(space),
          [raw](hid_t memory_type, void* to) { return H5Aread(raw, memory_type, to); },
          true};
}

Node data_set_of(Handle id, const std::string& name) {
  Handle type(H5Dget_type(id), H5Tclose, name), space(H5Dget_space(id), H5Sclose, name);
  const hid_t raw = id;
  return {name,
          std::move(id),
          std::move(type),
          std::move(space),
          [raw](hid_t memory_type, void* to) { return H5Dread(raw, memory_type, H5S_ALL, H5S_ALL, H5P_DEFAULT, to); },
          false};
}

Shape shape_of(const Node& node) {
  const int rank = checked(H5Sget_simple_extent_ndims(node.space), node.name);
  std::vector<hsize_t> dims(static_cast<size_t>(rank));
  if (rank > 0) checked(H5Sget_simple_extent_dims(node.space, dims.data(), nullptr), node.name);
  return Shape(dims.begin(), dims.end());
}

hsize_t file_size(hid_t object) {
  const Handle file(H5Iget_file_id(object), H5Fclose);
  hsize_t bytes = 0;
  checked(H5Fget_filesize(file, &bytes));
  return bytes;
}

void check_stored(const Node& node, const Shape& shape) {
  const size_t item = H5Tget_size(node.type);
  const size_t bytes = checked_product(shape, item);
  check_claim(node.name, shape, item, file_size(node.id));
  if (node.is_attribute || bytes == 0) return;
  const Handle properties(H5Dget_create_plist(node.id), H5Pclose, node.name);
  const H5D_layout_t layout = H5Pget_layout(properties);
  const hsize_t stored = H5Dget_storage_size(node.id);
  if ((layout == H5D_CONTIGUOUS && stored < bytes) || stored == 0)
    fail("data set '{}': {} stored bytes found, {} needed for shape {}", node.name, stored, bytes, text(shape));
}

std::string fixed_text(const char* bytes, size_t size, H5T_str_t padding) {
  std::string text(bytes, padding == H5T_STR_NULLTERM ? strnlen(bytes, size) : size);
  text.erase(text.find_last_not_of(padding == H5T_STR_SPACEPAD ? ' ' : '\0') + 1);
  return text;
}

std::vector<std::string> read_fixed_texts(const Node& node, size_t count) {
  const size_t size = H5Tget_size(node.type);
  std::vector<char> bytes(checked_product({count, size}));
  checked(node.read(node.type, bytes.data()), node.name);
  const H5T_str_t padding = H5Tget_strpad(node.type);
  std::vector<std::string> texts;
  for (size_t i = 0; i < count; ++i) texts.push_back(fixed_text(bytes.data() + i * size, size, padding));
  return texts;
}

std::vector<std::string> read_variable_texts(const Node& node, size_t count) {
  std::vector<char*> pointers(count, nullptr);
  checked(node.read(node.type, pointers.data()), node.name);
  std::vector<std::string> texts;
  texts.reserve(count);
  for (const char* pointer : pointers) texts.emplace_back(pointer ? pointer : "");
  checked(H5Dvlen_reclaim(node.type, node.space, H5P_DEFAULT, pointers.data()), node.name);
  return texts;
}

std::vector<std::string> read_texts(const Node& node, size_t count) {
  auto texts = checked(H5Tis_variable_str(node.type), node.name) > 0 ? read_variable_texts(node, count)
                                                                     : read_fixed_texts(node, count);
  for (const auto& text : texts)
    if (!utf32_from(text)) fail("data set '{}': invalid bytes found, UTF-8 text needed", node.name);
  return texts;
}

std::string foreign_kind(const Node& node, H5T_class_t type) {
  if (type == H5T_REFERENCE) return "references";
  if (type != H5T_COMPOUND) return "values of an unusual HDF5 type";
  const bool complex = H5Tget_nmembers(node.type) == 2 &&
                       (H5Tget_member_index(node.type, "r") >= 0 || H5Tget_member_index(node.type, "real") >= 0);
  return complex ? "complex numbers" : "records (a compound type)";
}

// The library's conversion of numbers that don't fill their bytes writes past its buffers, so it gets none of them.
bool is_plain_integer(hid_t type) {
  return H5Tget_precision(type) == 8 * H5Tget_size(type) && H5Tget_offset(type) == 0 && H5Tget_size(type) <= 8;
}

bool is_half_float(hid_t type) {
  size_t sign = 0, exponent = 0, exponent_bits = 0, mantissa = 0, mantissa_bits = 0;
  return H5Tget_size(type) == 2 && H5Tget_precision(type) == 16 && H5Tget_offset(type) == 0 &&
         H5Tget_fields(type, &sign, &exponent, &exponent_bits, &mantissa, &mantissa_bits) >= 0 && sign == 15 &&
         exponent == 10 && exponent_bits == 5 && mantissa == 0 && mantissa_bits == 10;
}

bool is_plain_float(hid_t type) {
  for (const hid_t known : {H5T_IEEE_F64LE, H5T_IEEE_F32LE, H5T_IEEE_F64BE, H5T_IEEE_F32BE})
    if (H5Tequal(type, known) > 0) return true;
  return is_half_float(type);
}

bool is_plain_number(const Node& node, H5T_class_t type) {
  if (type == H5T_FLOAT) return is_plain_float(node.type);
  if (type == H5T_INTEGER) return is_plain_integer(node.type);
  return type == H5T_ENUM && is_plain_integer(Handle(H5Tget_super(node.type), H5Tclose, node.name));
}

// Numbers may be left in the file: their shape alone then.
Array read_node(const Node& node, bool with_numbers = true) {
  const H5S_class_t extent = H5Sget_simple_extent_type(node.space);
  if (extent != H5S_SCALAR && extent != H5S_SIMPLE) return {{0}, Foreign{"nothing (an empty data space)"}};
  const Shape shape = shape_of(node);
  check_stored(node, shape);
  const size_t count = checked_product(shape);
  const H5T_class_t type = H5Tget_class(node.type);
  if (type == H5T_STRING) return {shape, read_texts(node, count)};
  if (!is_plain_number(node, type)) return {shape, Foreign{foreign_kind(node, type)}};
  if (!with_numbers) return {shape, std::vector<double>{}};
  check_claim(node.name, shape, sizeof(double), file_size(node.id) * sizeof(double));
  std::vector<double> numbers(count);
  if (count > 0) checked(node.read(H5T_NATIVE_DOUBLE, numbers.data()), node.name);
  return {shape, std::move(numbers)};
}

// ---- MATLAB's variables ----

std::optional<std::string> matlab_class(hid_t object) {
  if (checked(H5Aexists(object, "MATLAB_class")) == 0) return std::nullopt;
  const Array array = read_node(open_attribute(object, "MATLAB_class"));
  const auto* text = std::get_if<std::vector<std::string>>(&array.values);
  return text && text->size() == 1 ? text->front() : "";
}

Array matlab_value(Node node, const std::string& kind);

Array matlab_cell(const Node& node, const Shape& shape) {
  std::vector<hobj_ref_t> references(checked_product(shape));
  checked(node.read(H5T_STD_REF_OBJ, references.data()), node.name);
  std::vector<std::string> texts;
  for (const auto& reference : references) {
    Handle object(H5Rdereference2(node.id, H5P_DEFAULT, H5R_OBJECT, &reference), H5Oclose, node.name);
    if (H5Iget_type(object) != H5I_DATASET || matlab_class(object) != "char")
      return {shape, Foreign{"a cell array of other things than texts"}};
    const Array item = matlab_value(data_set_of(std::move(object), node.name), "char");
    const auto* text = std::get_if<std::vector<std::string>>(&item.values);
    if (!text || text->size() != 1) return {shape, Foreign{"a cell array of other things than texts"}};
    texts.push_back(text->front());
  }
  return {{texts.size()}, std::move(texts)};
}

// Empty arrays are stored as their sizes.
bool is_empty(const Node& node) { return checked(H5Aexists(node.id, "MATLAB_empty"), node.name) > 0; }

Array matlab_empty(const Node& node) {
  const Array sizes = read_node(node);
  Shape shape;
  if (const auto* numbers = std::get_if<std::vector<double>>(&sizes.values))
    for (const double n : *numbers) shape.push_back(n >= 0 && n < 9e15 ? static_cast<size_t>(n) : 0);
  if (checked_product(shape) != 0) fail("data set '{}': shape {} found for an empty array", node.name, text(shape));
  return {shape, std::vector<double>{}};
}

Array matlab_value(Node node, const std::string& kind) {
  if (is_empty(node)) {
    Array array = matlab_empty(node);
    return kind == "char" ? char_array(u"", array.shape) : array;
  }
  Shape shape = shape_of(node);
  std::reverse(shape.begin(), shape.end());
  if (kind == "cell" && H5Tget_class(node.type) == H5T_REFERENCE) {
    check_stored(node, shape);
    return matlab_cell(node, shape);
  }
  Array array = read_node(node);
  const auto* numbers = std::get_if<std::vector<double>>(&array.values);
  if (kind != "char" || !numbers) return numbers ? reversed(array) : array;
  std::u16string codes;
  for (const double code : *numbers) codes += static_cast<char16_t>(code >= 0 && code < 65536 ? code : 0xFFFD);
  return char_array(codes, shape);
}

// ---- the root group ----

Names link_names(hid_t group) {
  H5G_info_t info;
  checked(H5Gget_info(group, &info));
  Names names;
  for (hsize_t i = 0; i < info.nlinks; ++i) {
    const auto get = [&](char* to, size_t size) {
      return checked(H5Lget_name_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, i, to, size, H5P_DEFAULT));
    };
    std::string name(static_cast<size_t>(get(nullptr, 0)), '\0');
    get(name.data(), name.size() + 1);
    if (!name.starts_with('#')) names.push_back(std::move(name));  // MATLAB's own
  }
  return names;
}

Names attribute_names(hid_t group) {
  const int count = checked(H5Aget_num_attrs(group));
  Names names;
  for (int i = 0; i < count; ++i) {
    const Handle id(
        H5Aopen_by_idx(group, ".", H5_INDEX_NAME, H5_ITER_INC, static_cast<hsize_t>(i), H5P_DEFAULT, H5P_DEFAULT),
        H5Aclose);
    std::string name(static_cast<size_t>(checked(H5Aget_name(id, 0, nullptr))), '\0');
    checked(H5Aget_name(id, name.size() + 1, name.data()));
    names.push_back(std::move(name));
  }
  return names;
}

Array read_link(hid_t root, const std::string& name, bool with_numbers, Layout& layout) {
  Handle object(H5Oopen(root, name.c_str(), H5P_DEFAULT), H5Oclose, name);
  const auto kind = matlab_class(object);
  if (kind) layout = Layout::matlab;
  if (H5Iget_type(object) != H5I_DATASET) return {{}, Foreign{kind ? "a struct or sparse matrix" : "a group"}};
  Node node = data_set_of(std::move(object), name);
  if (!with_numbers && kind && *kind != "char" && *kind != "cell") return read_node(node, false);
  return kind ? matlab_value(std::move(node), *kind) : read_node(node, with_numbers);
}

}  // namespace

Contents read_hdf5(const std::filesystem::path& path, const Names& wanted, const Names& outlined) {
  const QuietHdf5 quiet;
  const Handle file = open_hdf5(path);
  const Handle root(H5Gopen2(file, "/", H5P_DEFAULT), H5Gclose);
  Contents contents;
  contents.names = link_names(root);
  for (const auto& name : contents.names)
    if (contains(wanted, name))
      contents.arrays.emplace_back(name, read_link(root, name, !contains(outlined, name), contents.layout));
  for (const auto& name : attribute_names(root)) {
    if (contains(contents.names, name)) continue;
    contents.names.push_back(name);
    if (contains(wanted, name)) contents.arrays.emplace_back(name, read_node(open_attribute(root, name)));
  }
  return contents;
}

// ---- writing ----

namespace {

// The file is made in memory: once a write to the disk has failed, the library can't close the file any more.
class MemoryFile {
 public:
  explicit MemoryFile(hsize_t userblock) : file_(create(userblock)) {}

  operator hid_t() const { return file_; }

  std::string image() {
    checked(H5Fflush(file_, H5F_SCOPE_GLOBAL));
    std::string bytes(static_cast<size_t>(checked(H5Fget_file_image(file_, nullptr, 0))), '\0');
    checked(H5Fget_file_image(file_, bytes.data(), bytes.size()));
    return bytes;
  }

 private:
  static Handle create(hsize_t userblock) {
    const Handle creation(H5Pcreate(H5P_FILE_CREATE), H5Pclose), access(H5Pcreate(H5P_FILE_ACCESS), H5Pclose);
    checked(H5Pset_obj_track_times(creation, false));
    checked(H5Pset_userblock(creation, userblock));
    // Older than the default allows, for older readers; the image of a newer file would have a false checksum.
    checked(H5Pset_libver_bounds(access, H5F_LIBVER_EARLIEST, H5F_LIBVER_V18));
    constexpr size_t increment = size_t{1} << 20;
    checked(H5Pset_fapl_core(access, increment, false));
    return {H5Fcreate("in memory", H5F_ACC_TRUNC, creation, access), H5Fclose};
  }

  Handle file_;
};

// ---- MATLAB's variables ----

void write_attribute(hid_t object, const char* name, hid_t type, const void* value) {
  const Handle space = space_of({});
  const Handle attribute(H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  checked(H5Awrite(attribute, type, value));
}

void set_matlab_class(hid_t object, std::string_view kind) {
  write_attribute(object, "MATLAB_class", text_type(kind.size(), H5T_STR_NULLTERM, H5T_CSET_ASCII), kind.data());
}

// MATLAB has the sizes of an empty array in place of its values.
void write_matlab_empty(hid_t group, const std::string& name, const Shape& shape, std::string_view kind) {
  const std::vector<std::uint64_t> sizes(shape.rbegin(), shape.rend());
  const Handle data = write_values(group, name, {sizes.size()}, H5T_STD_U64LE, H5T_NATIVE_UINT64, sizes.data());
  constexpr std::uint8_t yes = 1;
  set_matlab_class(data, kind);
  write_attribute(data, "MATLAB_empty", H5T_NATIVE_UINT8, &yes);
}

void write_matlab_text(hid_t group, const std::string& name, const std::string& text) {
  const std::u16string codes = utf16_from(text);
  if (codes.empty()) return write_matlab_empty(group, name, {0, 0}, "char");
  const Handle data = write_values(group, name, {codes.size(), 1}, H5T_STD_U16LE, H5T_NATIVE_UINT16, codes.data());
  constexpr std::int32_t bytes_of_a_character = 2;
  set_matlab_class(data, "char");
  write_attribute(data, "MATLAB_int_decode", H5T_NATIVE_INT32, &bytes_of_a_character);
}

// A cell array refers to its cells, which are kept in a group of their own.
void write_matlab_cell(hid_t file, const std::string& name, const std::vector<std::string>& texts) {
  constexpr const char* cells = "#refs#";
  if (checked(H5Lexists(file, cells, H5P_DEFAULT)) == 0)
    Handle(H5Gcreate2(file, cells, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT), H5Gclose);
  std::vector<hobj_ref_t> references(texts.size());
  for (size_t i = 0; i < texts.size(); ++i) {
    const std::string path = fmt::format("{}/{}_{}", cells, name, i + 1);
    write_matlab_text(file, path, texts[i]);
    checked(H5Rcreate(&references[i], file, path.c_str(), H5R_OBJECT, -1), name);
  }
  const Handle data = write_values(file, name, {1, texts.size()}, H5T_STD_REF_OBJ, H5T_STD_REF_OBJ, references.data());
  set_matlab_class(data, "cell");
}

void write_matlab_numbers(hid_t file, const std::string& name, const Array& array) {
  const Array numbers = column_major(array);
  const auto& values = std::get<std::vector<double>>(numbers.values);
  if (values.empty()) return write_matlab_empty(file, name, numbers.shape, "double");
  set_matlab_class(write_values(file, name, numbers.shape, H5T_IEEE_F64LE, H5T_NATIVE_DOUBLE, values.data()), "double");
}

void write_matlab_variable(hid_t file, const std::string& name, const Array& array) {
  const auto* texts = std::get_if<std::vector<std::string>>(&array.values);
  if (!texts) return write_matlab_numbers(file, name, array);
  array.shape.empty() ? write_matlab_text(file, name, texts->front()) : write_matlab_cell(file, name, *texts);
}

// The block that MATLAB knows its files by.
std::string matlab_header() {
  std::string header = "MATLAB 7.3 MAT-file, created by tokid";
  header.resize(116, ' ');
  header.append(8, '\0');
  header.append({'\x00', '\x02', 'I', 'M'});
  header.resize(512, '\0');
  return header;
}

}  // namespace

void write_hdf5(const Arrays& arrays, const std::filesystem::path& path) {
  const QuietHdf5 quiet;
  MemoryFile file(0);
  for (const auto& [name, array] : arrays) write_array(file, name, array);
  ByteWriter(path).write(file.image());
}

void write_mat73(const Arrays& arrays, const std::filesystem::path& path) {
  const QuietHdf5 quiet;
  const std::string header = matlab_header();
  MemoryFile file(header.size());
  for (const auto& [name, array] : arrays) write_matlab_variable(file, name, array);
  ByteWriter out(path);
  out.write(header);
  out.write(file.image());
}

}  // namespace tokid::io
