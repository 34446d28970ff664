// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/trigger.hpp"

#include "io/arrays.hpp"
#include "io/formats/cells.hpp"

namespace tokid::io {

Trigger::Trigger(const std::string& text) : text_(text) {
  const size_t begin = text.find_first_of("<>=!");
  const size_t end = begin == std::string::npos ? begin : text.find_first_not_of("<>=!", begin);
  if (end == std::string::npos) fail_form();
  column = stripped(std::string_view(text).substr(0, begin));
  comparison_ = text.substr(begin, end - begin);
  value_ = stripped(std::string_view(text).substr(end));
  if (value_.size() > 1 && (value_.front() == '"' || value_.front() == '\'') && value_.back() == value_.front())
    value_ = value_.substr(1, value_.size() - 2);
  else
    number_ = number_from(value_, '.');
  const Names comparisons{">", ">=", "<", "<=", "==", "!=", "="};
  const bool of_text = comparison_ == "==" || comparison_ == "!=" || comparison_ == "=";
  if (column.empty() || value_.empty() || !contains(comparisons, comparison_) || (!number_ && !of_text)) fail_form();
}

bool Trigger::holds(double value) const {
  if (comparison_ == ">") return value > *number_;
  if (comparison_ == ">=") return value >= *number_;
  if (comparison_ == "<") return value < *number_;
  if (comparison_ == "<=") return value <= *number_;
  return (value == *number_) != (comparison_ == "!=");
}

void Trigger::fail_form() const {
  throw std::invalid_argument(
      fmt::format("trigger: '{}' found, a column, one of > >= < <= == != and a number needed, as in 'valve > 0.5'; "
                  "with == and != a text is possible, too",
                  text_));
}

}  // namespace tokid::io
