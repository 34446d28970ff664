// Sentences from templates: "lag order {lags} needs {needed experiment}" → "lag order 3 needs 12 experiments".
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <map>
#include <string>
#include <string_view>

#include "tokid/types.hpp"

namespace tokid {

// The values of the fields of a template. Fields stand in braces:
//   {lags}                a number as an integer
//   {share~} {share~2}    with three significant digits, or another number of them
//   {share%} {dt:.6g}     in per cent; in a format of fmt
//   {ratio*}              as a factor with two digits
//   {needed experiment}   with a noun: "1 experiment", "12 experiments"
//   {#steps}              the number of entries of a list, or 1 if a condition of this name holds
//   {@steps}              a part of the sentence
//   {count|is|{count} are}, {#steps|is|are}   the first text if the number is 1, otherwise the second one
//   {?lags|with|without}  the first text if the number exists, otherwise the second one
struct SentenceFields {
  const std::map<std::string, double>& numbers;
  std::function<Index(std::string_view list)> count;
  std::function<std::string(std::string_view name)> part;
};

// \throws std::logic_error for a number that does not exist
std::string sentence(std::string_view text, const SentenceFields& fields);

}  // namespace tokid
