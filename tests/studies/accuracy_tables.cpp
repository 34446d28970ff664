// SPDX-License-Identifier: BSD-3-Clause
#include "studies/accuracy_tables.hpp"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "testing.hpp"

namespace tokid::testing {

namespace {

constexpr const char* none = "–";

// Where the table of that name begins and ends in the document.
std::pair<size_t, size_t> place(const std::string& document, const std::string& name) {
  const std::string mark = "<!-- table: " + name + " -->\n";
  const size_t begin = document.find(mark), end = document.find("<!-- end -->", begin);
  if (begin == std::string::npos || end == std::string::npos)
    throw std::runtime_error("no place found for the table " + name);
  return {begin + mark.size(), end};
}

void replace(std::string& document, const std::string& name, const std::string& table) {
  const auto [begin, end] = place(document, name);
  document.replace(begin, end - begin, table);
}

// The cells of the rows below the head.
std::vector<std::vector<std::string>> cells(const std::string& document, const std::string& name) {
  const auto [begin, end] = place(document, name);
  std::istringstream lines(document.substr(begin, end - begin));
  std::vector<std::vector<std::string>> rows;
  for (std::string line; std::getline(lines, line);) {
    std::vector<std::string> row;
    for (size_t from = 1, to; (to = line.find('|', from)) != std::string::npos; from = to + 1) {
      const std::string cell = line.substr(from, to - from);
      const size_t first = cell.find_first_not_of(' '), last = cell.find_last_not_of(' ');
      row.push_back(first == std::string::npos ? "" : cell.substr(first, last - first + 1));
    }
    rows.push_back(std::move(row));
  }
  rows.erase(rows.begin(), rows.begin() + std::min<std::ptrdiff_t>(2, std::ssize(rows)));
  return rows;
}

double number(const std::string& cell, double otherwise) { return cell == none ? otherwise : std::stod(cell); }

}  // namespace

std::vector<AccuracyRow> accuracy_rows(const std::vector<Accuracy>& all) {
  std::vector<AccuracyRow> rows;
  std::vector<std::string> stages;
  std::vector<std::vector<double>> ratios;
  for (const Accuracy& a : all) {
    const auto same = [&](const AccuracyRow& row) { return row.stage == a.stage && row.route == a.route; };
    auto row = std::find_if(rows.begin(), rows.end(), same);
    if (row == rows.end()) row = rows.insert(row, {a.stage, a.route});
    if (std::find(stages.begin(), stages.end(), a.stage) == stages.end()) stages.push_back(a.stage);
    const size_t at = size_t(row - rows.begin());
    ratios.resize(rows.size());
    ratios[at].push_back(a.ratio);
    row->condition = std::max(row->condition, a.condition);
    row->growth = std::max(row->growth, a.growth);
  }
  for (size_t i = 0; i < rows.size(); ++i) {
    std::sort(ratios[i].begin(), ratios[i].end());
    rows[i].cases = ratios[i].size();
    rows[i].median = ratios[i][ratios[i].size() / 2];
    rows[i].largest = ratios[i].back();
  }
  const auto order = [&](const AccuracyRow& row) { return std::find(stages.begin(), stages.end(), row.stage); };
  std::stable_sort(rows.begin(), rows.end(), [&](const auto& a, const auto& b) { return order(a) < order(b); });
  return rows;
}

std::vector<DigitsRow> digits_rows(const std::vector<Accuracy>& all) {
  std::vector<DigitsRow> rows;
  for (int decade = 0; decade < 12; decade += 2) {
    const auto fewest = [&](const char* stage, bool noisy) {
      double error = 0.0;
      for (const Accuracy& a : all)
        if (a.stage == stage && a.noisy == noisy && 2 * std::floor(std::log10(a.condition) / 2) == decade)
          error = std::max(error, a.error);
      return error > 0 ? -std::log10(error) : nan;
    };
    rows.push_back({decade,
                    {fewest("coefficients", false), fewest("coefficients", true), fewest("fit", false),
                     fewest("fit", true), fewest("whole identification", false)}});
  }
  return rows;
}

std::string with_tables(std::string document, const std::vector<AccuracyRow>& rows,
                        const std::vector<DigitsRow>& digits) {
  std::string table =
      "| stage | route | cases | condition up to | × growth up to | ratio, median | largest |\n"
      "| --- | --- | ---: | ---: | ---: | ---: | ---: |\n";
  std::string before;
  for (const AccuracyRow& row : rows) {
    table += fmt::format("| {} | {} | {} | {} | {:.0e} | {:.2g} | {:.2g} |\n", row.stage == before ? "" : row.stage,
                         row.route, row.cases, row.condition > 1 ? fmt::format("{:.0e}", row.condition) : none,
                         row.growth, row.median, row.largest);
    before = row.stage;
  }
  replace(document, "stages", table);
  table =
      "| condition number | coefficients | with noise | one-step fit | with noise | pulse responses of the model |\n"
      "| --- | ---: | ---: | ---: | ---: | ---: |\n";
  for (const DigitsRow& row : digits) {
    std::vector<std::string> shown;
    for (const double value : row.digits) shown.push_back(std::isnan(value) ? none : fmt::format("{:.1f}", value));
    table += fmt::format("| $10^{{{}}}$ to $10^{{{}}}$ | {} |\n", row.decade, row.decade + 2, fmt::join(shown, " | "));
  }
  replace(document, "digits", table);
  return document;
}

std::vector<AccuracyRow> read_accuracy_rows(const std::string& document) {
  std::vector<AccuracyRow> rows;
  for (const std::vector<std::string>& row : cells(document, "stages"))
    rows.push_back({row.at(0).empty() ? rows.at(rows.size() - 1).stage : row[0], row.at(1),
                    size_t(number(row.at(2), 0.0)), number(row.at(3), 1.0), number(row.at(4), 1.0),
                    number(row.at(5), nan), number(row.at(6), nan)});
  return rows;
}

std::vector<DigitsRow> read_digits_rows(const std::string& document) {
  std::vector<DigitsRow> rows;
  for (const std::vector<std::string>& row : cells(document, "digits")) {
    DigitsRow& digits = rows.emplace_back();
    digits.decade = 2 * int(rows.size() - 1);
    for (size_t i = 0; i < digits.digits.size(); ++i) digits.digits[i] = number(row.at(i + 1), nan);
  }
  return rows;
}

}  // namespace tokid::testing
