// SPDX-License-Identifier: BSD-3-Clause
#include "deploy/tables.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <stdexcept>

#include "tokid/printable.hpp"

namespace tokid::c_code {

std::string filled(std::string_view pattern, const Words& words) {
  std::string text;
  while (true) {
    const size_t begin = pattern.find('@');
    text += pattern.substr(0, begin);
    if (begin == std::string_view::npos) return text;
    const size_t end = pattern.find('@', begin + 1);
    const auto word = words.find(pattern.substr(begin + 1, end - begin - 1));
    if (end == std::string_view::npos || word == words.end()) throw std::logic_error("deploy: a word without a text");
    text += word->second;
    pattern.remove_prefix(end + 1);
  }
}

std::string comment_text(std::string_view text) {
  std::string line = printable(text);
  // A backslash at the end of a line would join it with the next one.
  std::replace(line.begin(), line.end(), '\\', '/');
  std::string result;
  for (const char c : line) {
    const char last = result.empty() ? ' ' : result.back();
    const bool joined = (last == '*' && c == '/') || (last == '/' && c == '*') || (last == '?' && c == '?');
    if (joined) result += ' ';
    result += c;
  }
  return result;
}

std::string number_text(double value, bool single_precision) {
  if (!std::isfinite(value)) throw std::invalid_argument(fmt::format("model: {} found, finite numbers needed", value));
  if (single_precision && std::abs(value) > double(std::numeric_limits<float>::max()))
    throw std::invalid_argument(
        fmt::format("model: the number {} found, at most {:.3g} needed in single precision. Use other units", value,
                    double(std::numeric_limits<float>::max())));
  std::string text = single_precision ? fmt::format("{}", float(value)) : fmt::format("{}", value);
  if (text.find_first_of(".e") == std::string::npos) text += ".0";
  return single_precision ? text + 'f' : text;
}

void Blocks::add(std::vector<double> block) {
  const auto [place, fresh] = place_.try_emplace(std::move(block), count());
  if (fresh) blocks_.push_back(place->first);
  block_of_.push_back(place->second);
}

bool Blocks::same_size() const {
  return std::all_of(blocks_.begin(), blocks_.end(),
                     [&](const std::vector<double>& block) { return block.size() == blocks_.front().size(); });
}

Index Blocks::largest() const {
  size_t most = 0;
  for (const std::vector<double>& block : blocks_) most = std::max(most, block.size());
  return Index(most);
}

Index Blocks::numbers() const {
  Index sum = 0;
  for (const std::vector<double>& block : blocks_) sum += Index(block.size());
  return sum;
}

std::vector<Index> Blocks::begins() const {
  std::vector<Index> begins;
  Index next = 0;
  for (const std::vector<double>& block : blocks_) {
    begins.push_back(next);
    next += Index(block.size());
  }
  return begins;
}

namespace {

constexpr size_t width = 110;

// Appends one element to the last line, or to a new one.
void append(std::string& text, size_t& column, const std::string& element) {
  if (column + element.size() + 2 > width) {
    text += "\n ";
    column = 1;
  }
  text += ' ' + element + ',';
  column += element.size() + 2;
}

struct Integer {
  const char* type;
  Index bytes;
};
Integer smallest_for(Index largest) {
  if (largest <= std::numeric_limits<std::uint8_t>::max()) return {"uint8_t", 1};
  if (largest <= std::numeric_limits<std::uint16_t>::max()) return {"uint16_t", 2};
  if (largest <= std::numeric_limits<std::uint32_t>::max()) return {"uint32_t", 4};
  throw std::invalid_argument("model: tables of more than 2^32 numbers found, fewer needed");
}

}  // namespace

void Tables::numbers(const std::string& name, const std::string& comment,
                     const std::vector<std::vector<double>>& blocks) {
  size_t count = 0;
  for (const std::vector<double>& block : blocks) count += block.size();
  const std::vector<std::vector<double>> one{{0.0}};
  text_ += fmt::format("/* {} */\nstatic const real {}[{}] = {{", comment, name, std::max<size_t>(count, 1));
  for (const std::vector<double>& block : count > 0 ? blocks : one) {
    if (block.empty()) continue;
    text_ += "\n ";
    size_t column = 1;
    for (const double value : block) append(text_, column, number_text(value, single_precision_));
  }
  text_.back() = '\n';
  text_ += "};\n\n";
  bytes_ += Index(std::max<size_t>(count, 1)) * (single_precision_ ? 4 : 8);
}

void Tables::integers(const std::string& name, const std::string& comment, const std::vector<Index>& values) {
  const Integer integer = smallest_for(*std::max_element(values.begin(), values.end()));
  text_ += fmt::format("/* {} */\nstatic const {} {}[{}] = {{\n ", comment, integer.type, name, values.size());
  size_t column = 1;
  for (const Index value : values) append(text_, column, fmt::format("{}", value));
  text_.back() = '\n';
  text_ += "};\n\n";
  bytes_ += Index(values.size()) * integer.bytes;
}

std::string Tables::lookup(const std::string& name, const std::string& comment, const std::vector<Index>& values,
                           const std::string& row) {
  bool constant = true, own = true;
  for (size_t i = 0; i < values.size(); ++i) {
    constant = constant && values[i] == values[0];
    own = own && values[i] == Index(i);
  }
  if (constant) return fmt::format("{}", values[0]);
  if (own) return row;
  integers(name, comment, values);
  return fmt::format("{}[{}]", name, row);
}

std::string Tables::place(const std::string& name, const std::string& comment, const Blocks& blocks,
                          const std::string& row) {
  numbers(name, comment, blocks.blocks());
  if (blocks.count() == 1) return name;
  const std::string which = lookup(name + "_of", "the block of " + name + " for each " + row, blocks.block_of(), row);
  smallest_for(blocks.numbers());
  if (blocks.same_size()) return fmt::format("{} + (uint32_t){} * {}", name, which, blocks.largest());
  return fmt::format("{} + {}", name,
                     lookup(name + "_begin", "first number of each block of " + name, blocks.begins(), which));
}

}  // namespace tokid::c_code
