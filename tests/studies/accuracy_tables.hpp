// The tables of docs/evidence.md: written by tokid_accuracy, read by the test that sees to it that they still hold.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <string>
#include <vector>

#include "studies/accuracy.hpp"

namespace tokid::testing {

// One stage and route.
struct AccuracyRow {
  std::string stage, route;
  size_t cases = 0;
  double condition = 1.0, growth = 1.0;  // the largest
  double median = 0.0, largest = 0.0;    // ratio
};
// The fewest digits that hold in two decades of the condition number: of coefficients without and with noise, of fits
// without and with noise, and of pulse responses of the model. NaN where no case was.
struct DigitsRow {
  int decade = 0;
  std::array<double, 5> digits = {};
};

std::vector<AccuracyRow> accuracy_rows(const std::vector<Accuracy>& all);
std::vector<DigitsRow> digits_rows(const std::vector<Accuracy>& all);

// The document with these tables in the place of those that it has. \throws std::runtime_error where it has none
std::string with_tables(std::string document, const std::vector<AccuracyRow>& rows,
                        const std::vector<DigitsRow>& digits);
// \throws std::runtime_error where the document has no such table
std::vector<AccuracyRow> read_accuracy_rows(const std::string& document);
std::vector<DigitsRow> read_digits_rows(const std::string& document);

}  // namespace tokid::testing
