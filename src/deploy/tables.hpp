// Constant tables of C: blocks of numbers, of which equal ones are stored once.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "tokid/types.hpp"

namespace tokid::c_code {

// Replaces @word@ by its text. The text itself is not searched.
using Words = std::map<std::string, std::string, std::less<>>;
std::string filled(std::string_view pattern, const Words& words);

// A text for a comment of C: one line, without the characters that end a comment or begin another one.
std::string comment_text(std::string_view text);

// The shortest digits that read back as the same number. \throws std::invalid_argument for a number beyond the range,
// or one that is not finite
std::string number_text(double value, bool single_precision);

// A table of numbers for each of a list of rows. Equal blocks share their place.
class Blocks {
 public:
  void add(std::vector<double> block);  // the block of the next row

  Index rows() const { return Index(block_of_.size()); }
  Index count() const { return Index(blocks_.size()); }  // different blocks
  Index block_of(Index row) const { return block_of_[size_t(row)]; }
  bool same_size() const;
  Index largest() const;
  Index numbers() const;  // of all different blocks

  const std::vector<std::vector<double>>& blocks() const { return blocks_; }
  std::vector<Index> begins() const;  // (count) index of the first number of each block
  const std::vector<Index>& block_of() const { return block_of_; }

 private:
  std::map<std::vector<double>, Index> place_;
  std::vector<std::vector<double>> blocks_;
  std::vector<Index> block_of_;
};

// Collects the definitions of tables and counts their bytes.
class Tables {
 public:
  explicit Tables(bool single_precision) : single_precision_(single_precision) {}

  // Definitions of constant arrays. An empty table gets one zero, because C has no empty arrays.
  void numbers(const std::string& name, const std::string& comment, const std::vector<std::vector<double>>& blocks);
  void integers(const std::string& name, const std::string& comment, const std::vector<Index>& values);

  // An expression of C for values[row]: a constant, `row` itself, or an element of a table that is defined here.
  std::string lookup(const std::string& name, const std::string& comment, const std::vector<Index>& values,
                     const std::string& row);
  // The numbers of all blocks, and an expression for the first number of the block of `row`.
  std::string place(const std::string& name, const std::string& comment, const Blocks& blocks, const std::string& row);

  const std::string& text() const { return text_; }
  Index bytes() const { return bytes_; }

 private:
  bool single_precision_;
  std::string text_;
  Index bytes_ = 0;
};

}  // namespace tokid::c_code
