// The condition on a column that determines step 0 of an experiment.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <string_view>

namespace tokid::io {

// "valve > 0.5": a column, a comparison, and a number or a text.
class Trigger {
 public:
  explicit Trigger(const std::string& text);  // \throws std::invalid_argument

  bool of_number() const { return number_.has_value(); }
  bool holds(double value) const;
  bool is_value(std::string_view cell) const { return cell == value_; }
  bool holds(std::string_view cell) const { return is_value(cell) != (comparison_ == "!="); }

  std::string column;

 private:
  [[noreturn]] void fail_form() const;

  std::string text_, comparison_, value_;
  std::optional<double> number_;
};

}  // namespace tokid::io
