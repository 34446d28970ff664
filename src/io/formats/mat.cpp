// MATLAB's .mat: versions 5 and 7, read and written by matio. Version 7.3 is HDF5 and has its own reader and writer.
// SPDX-License-Identifier: BSD-3-Clause
#include <fcntl.h>
#include <matio.h>

#include <algorithm>
#include <cerrno>
#include <memory>
#include <mutex>
#include <optional>

#include "io/formats/formats.hpp"
#include "io/formats/matlab.hpp"
#include "io/guard/atomic_file.hpp"
#include "io/guard/claims.hpp"
#include "io/guard/mat_frame.hpp"
#include "io/text.hpp"

namespace tokid::io {

namespace {

struct CloseFile {
  void operator()(mat_t* file) const { Mat_Close(file); }
};
struct FreeVariable {
  void operator()(matvar_t* variable) const { Mat_VarFree(variable); }
};
using File = std::unique_ptr<mat_t, CloseFile>;
using Variable = std::unique_ptr<matvar_t, FreeVariable>;

// ---- messages of matio ----

thread_local std::string last_message;

void listen_to_matio() {
  static std::once_flag once;
  std::call_once(once, [] { Mat_LogInitFunc("tokid", [](int, auto* message) { last_message = message; }); });
  last_message.clear();
}

std::string reason() { return last_message.empty() ? "truncated or damaged" : last_message; }

// ---- reading ----

template <typename T>
std::vector<double> numbers_of(const matvar_t& variable, size_t count) {
  const auto* values = static_cast<const T*>(variable.data);
  std::vector<double> numbers(count);
  for (size_t i = 0; i < count; ++i) numbers[i] = static_cast<double>(values[i]);
  return numbers;
}

std::optional<std::vector<double>> numbers_of(const matvar_t& variable, size_t count) {
  switch (variable.data_type) {
    case MAT_T_DOUBLE:
      return numbers_of<double>(variable, count);
    case MAT_T_SINGLE:
      return numbers_of<float>(variable, count);
    case MAT_T_INT8:
      return numbers_of<std::int8_t>(variable, count);
    case MAT_T_UINT8:
      return numbers_of<std::uint8_t>(variable, count);
    case MAT_T_INT16:
      return numbers_of<std::int16_t>(variable, count);
    case MAT_T_UINT16:
      return numbers_of<std::uint16_t>(variable, count);
    case MAT_T_INT32:
      return numbers_of<std::int32_t>(variable, count);
    case MAT_T_UINT32:
      return numbers_of<std::uint32_t>(variable, count);
    case MAT_T_INT64:
      return numbers_of<std::int64_t>(variable, count);
    case MAT_T_UINT64:
      return numbers_of<std::uint64_t>(variable, count);
    default:
      return std::nullopt;
  }
}

Shape shape_of(const matvar_t& variable) {
  return variable.rank > 0 && variable.dims ? Shape(variable.dims, variable.dims + variable.rank) : Shape{};
}

std::u16string utf16_codes(const matvar_t& variable, size_t count) {
  const auto* bytes = static_cast<const char*>(variable.data);
  // A text in UTF-8 has more bytes than characters if a character takes several bytes.
  if (variable.data_type == MAT_T_UTF8) return utf16_from({bytes, variable.nbytes});
  const auto width = static_cast<size_t>(variable.data_size);
  if (count > variable.nbytes / std::max(width, size_t{1})) fail("truncated text found, all of its characters needed");
  std::u16string codes;
  for (size_t i = 0; i < count; ++i)
    codes += width == 1   ? static_cast<char16_t>(static_cast<unsigned char>(bytes[i]))
             : width == 2 ? static_cast<char16_t>(load_bytes<std::uint16_t>(bytes + 2 * i, false))
                          : u'\xFFFD';
  return codes;
}

Array text_value(const matvar_t& variable, const Shape& shape, size_t count) {
  if (count == 0 || !variable.data) return char_array(u"", shape);
  const std::u16string codes = utf16_codes(variable, count);
  if (codes.size() == count) return char_array(codes, shape);
  if (shape.size() == 2 && shape[0] == 1) return char_array(codes, {1, codes.size()});
  return {shape, Foreign{"a char array of several rows that is not ASCII"}};
}

Array cell_value(const matvar_t& variable, const Shape& shape, size_t count) {
  Array foreign{shape, Foreign{"a cell array of other things than texts"}};
  auto* const* cells = static_cast<matvar_t* const*>(variable.data);
  // In a damaged file, a variable may state more cells than matio has read.
  if (cells && variable.nbytes < checked_product(shape, sizeof(matvar_t*))) return foreign;
  std::vector<std::string> texts;
  for (size_t i = 0; i < count; ++i) {
    const matvar_t* cell = cells ? cells[i] : nullptr;
    if (!cell || cell->class_type != MAT_C_CHAR) return foreign;
    const Shape cell_shape = shape_of(*cell);
    const Array item = text_value(*cell, cell_shape, checked_product(cell_shape));
    const auto* text = std::get_if<std::vector<std::string>>(&item.values);
    if (!text || text->size() != 1) return foreign;
    texts.push_back(text->front());
  }
  return {{count}, std::move(texts)};
}

std::string foreign_kind(const matvar_t& variable) {
  switch (variable.class_type) {
    case MAT_C_SPARSE:
      return "a sparse matrix";
    case MAT_C_STRUCT:
      return "a struct";
    case MAT_C_FUNCTION:
      return "a function";
    default:
      return "an object";
  }
}

Array value_of(const matvar_t& variable) {
  const Shape shape = shape_of(variable);
  if (variable.isComplex) return {shape, Foreign{"complex numbers"}};
  const size_t count = checked_product(shape);
  if (variable.class_type == MAT_C_CHAR) return text_value(variable, shape, count);
  if (variable.class_type == MAT_C_CELL) return cell_value(variable, shape, count);
  if (variable.class_type < MAT_C_DOUBLE || variable.class_type > MAT_C_UINT64)
    return {shape, Foreign{foreign_kind(variable)}};
  if (count == 0) return {shape, std::vector<double>{}};
  const bool complete =
      variable.data && variable.nbytes == checked_product(shape, static_cast<size_t>(variable.data_size));
  auto numbers = complete ? numbers_of(variable, count) : std::nullopt;
  if (!numbers) fail("data set '{}' can't be read: {}", variable.name, reason());
  return reversed({Shape(shape.rbegin(), shape.rend()), std::move(*numbers)});
}

Array read_variable(mat_t* file, matvar_t* variable, Claims& claims) {
  // A number takes at least one byte in the file, and eight bytes in memory.
  claims.add(variable->name, shape_of(*variable), 1, sizeof(double));
  if (Mat_VarReadDataAll(file, variable) != 0) fail("data set '{}' can't be read: {}", variable->name, reason());
  return value_of(*variable);
}

// ---- writing ----

std::string_view bits(const Array& array) {
  const auto& values = std::get<std::vector<double>>(array.values);
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(double)};
}

// The largest number of bytes of a variable in version 7.
constexpr size_t version7_bytes = (size_t{1} << 31) - 1;

Variable create(const std::string& name, matio_classes kind, matio_types type, Shape shape, const void* values) {
  Variable variable(Mat_VarCreate(name.c_str(), kind, type, static_cast<int>(shape.size()), shape.data(),
                                  const_cast<void*>(values), 0));
  if (!variable) fail_to_write(fmt::format("data set '{}': {}", name, reason()));
  return variable;
}

Variable text_variable(const std::string& name, const std::string& text) {
  const std::u16string codes = utf16_from(text);
  return create(name, MAT_C_CHAR, MAT_T_UTF16, {codes.empty() ? size_t{0} : size_t{1}, codes.size()}, codes.data());
}

Variable cell_variable(const std::string& name, const std::vector<std::string>& texts) {
  std::vector<matvar_t*> cells;
  cells.reserve(texts.size());
  for (const auto& text : texts) cells.push_back(text_variable(name, text).release());
  return create(name, MAT_C_CELL, MAT_T_CELL, {texts.size(), 1}, cells.data());
}

Variable number_variable(const std::string& name, const Array& array) {
  const Array numbers = column_major(array);
  return create(name, MAT_C_DOUBLE, MAT_T_DOUBLE, {numbers.shape.rbegin(), numbers.shape.rend()},
                std::get<std::vector<double>>(numbers.values).data());
}

Variable variable_of(const std::string& name, const Array& array) {
  const auto* texts = std::get_if<std::vector<std::string>>(&array.values);
  if (!texts) return number_variable(name, array);
  return array.shape.empty() ? text_variable(name, texts->front()) : cell_variable(name, *texts);
}

}  // namespace

Contents read_mat(const std::filesystem::path& path, const Names& wanted) {
  if (check_mat(path) == MatContainer::hdf5) return read_hdf5(path, wanted);
  listen_to_matio();
  const File file(Mat_Open(path.c_str(), MAT_ACC_RDONLY));
  if (!file) fail("no readable .mat file: {}", reason());
  Contents contents;
  contents.layout = Layout::matlab;
  Claims claims(std::filesystem::file_size(path));
  while (const Variable variable{Mat_VarReadNextInfo(file.get())}) {
    if (!variable->name) continue;
    const std::string name = variable->name;
    contents.names.push_back(name);
    if (contains(wanted, name)) add_once(name, read_variable(file.get(), variable.get(), claims), contents.arrays);
  }
  return contents;
}

namespace {

bool reads_back(const Arrays& arrays, const std::filesystem::path& path) {
  Names names;
  for (const auto& [name, array] : arrays) names.push_back(name);
  const Contents written = read_mat(path, names);
  const auto same = [](const auto& there, const auto& here) {
    if (std::holds_alternative<std::vector<std::string>>(here.second.values))
      return there.second.values == here.second.values;
    return bits(there.second) == bits(reversed(column_major(here.second)));
  };
  return std::equal(written.arrays.begin(), written.arrays.end(), arrays.begin(), arrays.end(), same);
}

// Throws the reason why the file is incomplete. matio does not report it, so reserve() tests whether the disk is full.
[[noreturn]] void fail_incomplete(const Arrays& arrays, const std::filesystem::path& path, std::string_view why) {
  std::uint64_t bytes = mat_header_bytes;
  for (const auto& [name, array] : arrays) bytes += mat_header_bytes + checked_product(array.shape, sizeof(double));
  reserve(path, bytes);
  throw WriteError(fmt::format("can't be written completely: {}", why), 0);
}

// Reads the file back, because matio does not check its writes and so does not notice a full disk.
void check_written(const Arrays& arrays, const std::filesystem::path& path) {
  std::string why = "other data read back";
  try {
    if (reads_back(arrays, path)) return;
  } catch (const IoError& error) {
    why = error.what();
  }
  fail_incomplete(arrays, path, why);
}

}  // namespace

void write_mat(const Arrays& arrays, const std::filesystem::path& path) {
  listen_to_matio();
  // The default header contains the date. This header does not, so the same data give the same bytes.
  File file(Mat_CreateVer(path.c_str(), "MATLAB 5.0 MAT-file, created by tokid", MAT_FT_MAT5));
  if (!file) fail_incomplete(arrays, path, reason());
  for (const auto& [name, array] : arrays) {
    if (checked_product(array.shape, sizeof(double)) > version7_bytes)
      fail("data set '{}': shape {} found, at most 2 GiB needed for a .mat of version 7; use version 7.3 or .h5", name,
           text(array.shape));
    if (Mat_VarWrite(file.get(), variable_of(name, array).get(), MAT_COMPRESSION_ZLIB) != 0)
      fail_incomplete(arrays, path, fmt::format("data set '{}': {}", name, reason()));
  }
  if (Mat_Close(file.release()) != 0) fail_incomplete(arrays, path, reason());
  check_written(arrays, path);
}

}  // namespace tokid::io
