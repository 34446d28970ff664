// HDF5, and the HDF5 that MATLAB writes as version 7.3 of its .mat.
// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cstring>
#include <functional>
#include <optional>
#include <unordered_set>

#include "io/formats/formats.hpp"
#include "io/formats/hdf5_sink.hpp"
#include "io/formats/matlab.hpp"
#include "io/guard/claims.hpp"
#include "io/naming.hpp"
#include "io/text.hpp"

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

// Refuses values in other files, because a data set could then refer to any file that the user may read.
void check_storage(hid_t data, const std::string& name) {
  const Handle properties(H5Dget_create_plist(data), H5Pclose, name);
  if (checked(H5Pget_layout(properties), name) == H5D_VIRTUAL || checked(H5Pget_external_count(properties), name) > 0)
    fail("data set '{}': values in other files found, the values themselves needed", name);
}

Node data_set_of(Handle id, const std::string& name) {
  check_storage(id, name);
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

// The library reads a missing chunk as zeros, whether it was never written or the index of chunks is damaged.
void check_chunks(const Node& node, const Shape& shape, hid_t properties) {
  const std::vector<hsize_t> chunk = chunk_shape(properties, shape.size(), node.name);
  hsize_t needed = 1, found = 0;
  for (size_t axis = 0; axis < shape.size(); ++axis) needed *= (shape[axis] + chunk[axis] - 1) / chunk[axis];
  checked(H5Dget_num_chunks(node.id, node.space, &found), node.name);
  if (found != needed)
    fail(
        "data set '{}': {} chunks found, {} needed for shape {}: some were never written, or the index is damaged. Write "
        "all values, NaN for missing samples",
        node.name, found, needed, text(shape));
}

// Checks that the file contains as many values as the shape states. A data set in one piece that was never written
// reads as its fill value, usually zero. Other programs use this, so it is allowed up to a limit.
void check_stored(const Node& node, const Shape& shape, size_t memory_item, Claims& claims) {
  constexpr std::uint64_t most_unwritten = std::uint64_t{1} << 28;
  const size_t item = H5Tget_size(node.type);
  const std::uint64_t bytes = checked_product(shape, item);
  if (node.is_attribute) return claims.add(node.name, shape, item, memory_item);
  const Handle properties(H5Dget_create_plist(node.id), H5Pclose, node.name);
  const bool chunks = checked(H5Pget_layout(properties), node.name) == H5D_CHUNKED;
  claims.add(node.name, shape, chunks ? item : 0, memory_item);
  if (bytes == 0) return;
  if (chunks)
    check_chunks(node, shape, properties);
  else if (bytes > most_unwritten && H5Dget_storage_size(node.id) < bytes)
    fail("data set '{}': shape {} ({} bytes) found, but most of its values were never written: write the values",
         node.name, text(shape), bytes);
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
  const auto reclaim = [&](char** read) { H5Dvlen_reclaim(node.type, node.space, H5P_DEFAULT, read); };
  const std::unique_ptr<char*, decltype(reclaim)> owner(pointers.data(), reclaim);
  checked(node.read(node.type, pointers.data()), node.name);
  std::vector<std::string> texts;
  texts.reserve(count);
  for (const char* pointer : pointers) texts.emplace_back(pointer ? pointer : "");
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

// If `with_numbers` is false, only the shape of numbers is read.
Array read_node(const Node& node, Claims& claims, bool with_numbers = true) {
  const H5S_class_t extent = H5Sget_simple_extent_type(node.space);
  if (extent != H5S_SCALAR && extent != H5S_SIMPLE) return {{0}, Foreign{"nothing (an empty data space)"}};
  const Shape shape = shape_of(node);
  const H5T_class_t type = H5Tget_class(node.type);
  const bool is_text = type == H5T_STRING, is_number = type == H5T_FLOAT || type == H5T_INTEGER || type == H5T_ENUM;
  check_stored(node, shape,
               is_text                     ? sizeof(std::string) + H5Tget_size(node.type)
               : is_number && with_numbers ? sizeof(double)
                                           : 0,
               claims);
  const size_t count = checked_product(shape);
  if (is_text) return {shape, read_texts(node, count)};
  if (!is_number) return {shape, Foreign{foreign_kind(node, type)}};
  if (!with_numbers) return {shape, std::vector<double>{}};
  std::vector<double> numbers(count);
  if (count > 0) checked(node.read(H5T_NATIVE_DOUBLE, numbers.data()), node.name);
  return {shape, std::move(numbers)};
}

// ---- MATLAB's variables ----

std::optional<std::string> matlab_class(hid_t object, Claims& claims) {
  if (checked(H5Aexists(object, "MATLAB_class")) == 0) return std::nullopt;
  const Array array = read_node(open_attribute(object, "MATLAB_class"), claims);
  const auto* text = std::get_if<std::vector<std::string>>(&array.values);
  return text && text->size() == 1 ? text->front() : "";
}

Array matlab_value(Node node, const std::string& kind, Claims& claims);

Array matlab_cell(const Node& node, const Shape& shape, Claims& claims) {
  std::vector<hobj_ref_t> references(checked_product(shape));
  checked(node.read(H5T_STD_REF_OBJ, references.data()), node.name);
  std::vector<std::string> texts;
  for (const auto& reference : references) {
    Handle object(H5Rdereference2(node.id, H5P_DEFAULT, H5R_OBJECT, &reference), H5Oclose, node.name);
    if (H5Iget_type(object) != H5I_DATASET || matlab_class(object, claims) != "char")
      return {shape, Foreign{"a cell array of other things than texts"}};
    const Array item = matlab_value(data_set_of(std::move(object), node.name), "char", claims);
    const auto* text = std::get_if<std::vector<std::string>>(&item.values);
    if (!text || text->size() != 1) return {shape, Foreign{"a cell array of other things than texts"}};
    texts.push_back(text->front());
  }
  return {{texts.size()}, std::move(texts)};
}

// For an empty array, MATLAB stores its sizes as values.
bool is_empty(const Node& node) { return checked(H5Aexists(node.id, "MATLAB_empty"), node.name) > 0; }

Array matlab_empty(const Node& node, Claims& claims) {
  const Array sizes = read_node(node, claims);
  Shape shape;
  if (const auto* numbers = std::get_if<std::vector<double>>(&sizes.values))
    for (const double n : *numbers) shape.push_back(n >= 0 && n < 9e15 ? static_cast<size_t>(n) : 0);
  if (checked_product(shape) != 0)
    fail("data set '{}': shape {} found for an empty array, a size of 0 needed", node.name, text(shape));
  return {shape, std::vector<double>{}};
}

Array matlab_value(Node node, const std::string& kind, Claims& claims) {
  if (is_empty(node)) {
    Array array = matlab_empty(node, claims);
    return kind == "char" ? char_array(u"", array.shape) : array;
  }
  Shape shape = shape_of(node);
  std::reverse(shape.begin(), shape.end());
  if (kind == "cell" && H5Tget_class(node.type) == H5T_REFERENCE) {
    check_stored(node, shape_of(node), sizeof(hobj_ref_t) + sizeof(std::string), claims);
    return matlab_cell(node, shape, claims);
  }
  Array array = read_node(node, claims);
  const auto* numbers = std::get_if<std::vector<double>>(&array.values);
  if (kind != "char" || !numbers) return numbers ? reversed(array) : array;
  std::u16string codes;
  for (const double code : *numbers) codes += static_cast<char16_t>(code >= 0 && code < 65536 ? code : 0xFFFD);
  return char_array(codes, shape);
}

// ---- the root group ----

// A callback for the iterations of the library. The library is written in C, so no exception may leave the callback.
herr_t keep(const char* name, void* names) {
  try {
    static_cast<Names*>(names)->emplace_back(name);
    return 0;
  } catch (const std::bad_alloc&) {
    return -1;
  }
}

Names link_names(hid_t group) {
  Names names;
  const auto add = [](hid_t, const char* name, const H5L_info_t*, void* to) { return keep(name, to); };
  checked(H5Literate(group, H5_INDEX_NAME, H5_ITER_INC, nullptr, add, &names));
  std::erase_if(names, [](const std::string& name) { return name.starts_with('#'); });  // MATLAB's own
  return names;
}

Names attribute_names(hid_t group) {
  Names names;
  const auto add = [](hid_t, const char* name, const H5A_info_t*, void* to) { return keep(name, to); };
  checked(H5Aiterate2(group, H5_INDEX_NAME, H5_ITER_INC, nullptr, add, &names));
  return names;
}

// Opens an object. Links to other files are refused, even if a soft link leads to them.
Handle open_object(hid_t root, const std::string& name) {
  H5L_info_t link;
  checked(H5Lget_info(root, name.c_str(), &link, H5P_DEFAULT), name);
  if (link.type != H5L_TYPE_HARD && link.type != H5L_TYPE_SOFT)
    fail("data set '{}': a link to another file found, the values themselves needed", name);
  const auto refuse = [](const char*, const char*, const char*, const char*, unsigned*, hid_t, void*) -> herr_t {
    return -1;
  };
  const Handle access(H5Pcreate(H5P_LINK_ACCESS), H5Pclose, name);
  checked(H5Pset_elink_cb(access, refuse, nullptr), name);
  return {H5Oopen(root, name.c_str(), access), H5Oclose, name};
}

Array read_link(hid_t root, const std::string& name, bool with_numbers, Layout& layout, Claims& claims) {
  Handle object = open_object(root, name);
  const auto kind = matlab_class(object, claims);
  if (kind) layout = Layout::matlab;
  if (H5Iget_type(object) != H5I_DATASET) return {{}, Foreign{kind ? "a struct or sparse matrix" : "a group"}};
  Node node = data_set_of(std::move(object), name);
  if (!with_numbers && kind && *kind != "char" && *kind != "cell") return read_node(node, claims, false);
  return kind ? matlab_value(std::move(node), *kind, claims) : read_node(node, claims, with_numbers);
}

}  // namespace

Contents read_hdf5(const std::filesystem::path& path, const Names& wanted, const Names& outlined) {
  const QuietHdf5 quiet;
  const Handle file = open_hdf5(path);
  const Handle root(H5Gopen2(file, "/", H5P_DEFAULT), H5Gclose);
  Claims claims(std::filesystem::file_size(path));
  Contents contents;
  contents.names = link_names(root);
  for (const auto& name : contents.names)
    if (contains(wanted, name))
      contents.arrays.emplace_back(name, read_link(root, name, !contains(outlined, name), contents.layout, claims));
  const std::unordered_set<std::string> known(contents.names.begin(), contents.names.end());
  for (const auto& name : attribute_names(root)) {
    const bool is_new = known.count(name) == 0;
    if (is_new) contents.names.push_back(name);
    if (contains(wanted, name) && (is_new || !contains(outlined, name)))
      add_once(name, read_node(open_attribute(root, name), claims), contents.arrays);
  }
  return contents;
}

// ---- writing ----

namespace {

// ---- MATLAB's variables ----

void write_attribute(hid_t object, const char* name, hid_t type, const void* value) {
  const Handle space = space_of({});
  const Handle attribute(H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT), H5Aclose);
  checked(H5Awrite(attribute, type, value));
}

void set_matlab_class(hid_t object, std::string_view kind) {
  write_attribute(object, "MATLAB_class", text_type(kind.size(), H5T_STR_NULLTERM, H5T_CSET_ASCII), kind.data());
}

// MATLAB stores the sizes of an empty array instead of its values.
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

// A cell array refers to its cells, which have a group of their own.
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

// Upper bound of the bytes that the variable takes in the file.
std::uint64_t matlab_bytes(const Array& array) {
  const auto* texts = std::get_if<std::vector<std::string>>(&array.values);
  if (!texts) {
    Shape shape = array.shape;
    shape.resize(std::max<size_t>(2, shape.size()), 1);
    return stored_bytes(Shape(shape.rbegin(), shape.rend()));
  }
  std::uint64_t bytes = stored_bytes({texts->size()});
  for (const auto& text : *texts) bytes += stored_bytes({text.size(), 1});  // codes are shorter than numbers
  return bytes;
}

// The block at the beginning of a file by which MATLAB recognises its files.
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
  written_by_library([&] {
    std::uint64_t bytes = 0;
    for (const auto& [name, array] : arrays) bytes += stored_bytes(array);
    Hdf5Sink sink(path, bytes);
    for (const auto& [name, array] : arrays) sink.write(name, array);
    sink.close();
  });
}

void write_mat73(const Arrays& arrays, const std::filesystem::path& path) {
  const QuietHdf5 quiet;
  written_by_library([&] {
    std::uint64_t bytes = 0;
    for (const auto& [name, array] : arrays) bytes += matlab_bytes(array);
    Hdf5Sink sink(path, bytes, matlab_header());
    for (const auto& [name, array] : arrays) write_matlab_variable(sink.file(), name, array);
    sink.close();
  });
}

}  // namespace tokid::io
