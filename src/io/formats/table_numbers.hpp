// The numbers in the cells of a table, and the words that were taken for missing samples.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_set>
#include <vector>

#include "io/arrays.hpp"
#include "io/formats/cells.hpp"
#include "tokid/io.hpp"

namespace tokid::io {

// Words that were taken for missing samples without being stated.
struct Guess {
  Index cells = 0;
  size_t file = 0;    // number of the file of the first one
  Index line = 0;     // of the first one
  std::string first;  // where the first one stands
};
using Guesses = std::map<std::string, Guess>;

std::string remark_on_guesses(const Guesses& guesses);
// Adds the guesses of the file with this number and name.
void add_guesses(const Guesses& more, size_t number, const std::string& file, Guesses& to);

// The error for a cell with a text in place of a number.
class TextFound : public IoError {
 public:
  // `text`: place, text and what is needed; `advice`: its end, if the column also has numbers
  TextFound(const std::string& text, const std::string& advice) : IoError(text + advice), text_(text) {}
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

// What the cells of a column contain, apart from missing samples; for messages.
class ColumnValues {
 public:
  void add(double number) { low_ = std::min(low_, number), high_ = std::max(high_, number); }
  void add(std::string_view text);  // not empty
  void add(const ColumnValues& more);

  const Names& texts() const { return texts_; }  // the first different texts, in the order of appearance
  bool has_numbers() const { return low_ <= high_; }
  // Are all cells words, such as the states of a switch?
  bool has_only_words() const { return !texts_.empty() && only_words_ && !has_numbers(); }
  // "the texts 'ZU' and 'AUF'", "numbers from 0 to 100"
  std::string described() const;

  static constexpr size_t most = 4;  // texts that are described
  bool has_more() const { return texts_.size() > most; }

 private:
  Names texts_;  // one more than are described
  bool only_words_ = true;
  double low_ = std::numeric_limits<double>::infinity(), high_ = -low_;
};

// Reads numbers. The first number with a decimal comma or a decimal point decides for the table.
class NumberReader {
 public:
  explicit NumberReader(const Names& missing_words);

  double number(std::string_view cell, Index line, const std::string& column);

  // A time or step number. No word and no number stands for a missing one.
  double time(std::string_view cell, Index line, const std::string& column);

  // Does a text stand for a missing sample? Words that nobody stated are counted as guesses.
  bool stands_for_missing(std::string_view text, Index line, const std::string& column);

  // Is the text empty, or a word for a missing sample? Unlike stands_for_missing(), this counts no guess.
  bool is_word_or_empty(std::string_view text) const {
    return is_missing(text) || contains(words_, text) || is_word_for_missing(text);
  }

  const Guesses& guesses() const { return guesses_; }
  // How the marks in numbers were read, if a program may have meant them otherwise. Must be called after the last
  // number. \throws IoError if commas in a table with commas between cells can as well group thousands, and if the
  // numbers of a column show that they do
  std::optional<std::string> remark_on_marks(char separator) const;
  std::optional<std::string> remark_on_switches() const;
  // A number of a decimal comma as one of a decimal point; for the precision of times.
  std::string with_point(std::string text) const;

 private:
  std::optional<double> counted_value(std::string_view cell, Index line, const std::string& column);
  std::optional<double> value_of(std::string_view cell, Index line, const std::string& column);
  void decide(char mark, Index line, std::string_view cell) { mark_ = mark, mark_line_ = line, mark_cell_ = cell; }
  // `may_be_missing`: the message about a text says how to read it as a missing sample.
  [[noreturn]] void fail_number(std::string_view cell, Index line, const std::string& column,
                                bool may_be_missing) const;

  Names words_;
  std::vector<double> numbers_;
  char mark_ = '\0';  // not decided
  Index mark_line_ = 0;
  std::string mark_cell_;
  bool only_thousands_ = true;  // of the numbers with a mark: each may be a whole number with a mark of thousands
  std::unordered_set<std::string> marked_, below_thousand_;  // columns, while that is so
  bool has_switches_ = false;
  Guesses guesses_;
};

}  // namespace tokid::io
