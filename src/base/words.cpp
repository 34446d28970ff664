// SPDX-License-Identifier: BSD-3-Clause
#include "base/words.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "tokid/printable.hpp"

namespace tokid::words {

std::string quoted(std::string_view name) {
  constexpr Index most = 80;
  // U+061C, U+200E, U+200F, U+202A … U+202E, U+2066 … U+2069 in UTF-8
  const auto turns = [](std::string_view c) {
    if (c == "\xD8\x9C") return true;
    if (c.size() != 3 || c[0] != '\xE2') return false;
    const unsigned char second = static_cast<unsigned char>(c[1]), third = static_cast<unsigned char>(c[2]);
    return (second == 0x80 && (third == 0x8E || third == 0x8F || (third >= 0xAA && third <= 0xAE))) ||
           (second == 0x81 && third >= 0xA6 && third <= 0xA9);
  };
  // Scripts that run from right to left: Hebrew, Arabic and related ones, U+0590 … U+08FF, and their presentation
  // forms.
  const auto right_to_left = [](std::string_view c) {
    const unsigned char first = static_cast<unsigned char>(c[0]);
    const unsigned char second = c.size() > 1 ? static_cast<unsigned char>(c[1]) : 0;
    return (c.size() == 2 && first >= 0xD6 && first <= 0xDF) || (c.size() == 3 && first == 0xE0 && second <= 0xA3) ||
           (c.size() == 3 && first == 0xEF && second >= 0xAC && second <= 0xBB);
  };
  std::string text;
  bool isolate = false;
  Index letters = 0;
  while (!name.empty()) {
    size_t length = 1;
    while (length < name.size() && length < 4 && (name[length] & 0xC0) == 0x80 && (name[0] & 0x80) != 0) ++length;
    const std::string_view character = name.substr(0, length);
    name.remove_prefix(length);
    if (turns(character)) continue;
    if (letters++ == most) {
      text += "…";
      break;
    }
    isolate = isolate || right_to_left(character);
    text += character;
  }
  return isolate ? "\u2068" + text + "\u2069" : text;
}

std::string experiment(Index row, std::string_view name) {
  const std::string number = fmt::format("{}", row);
  return name.empty() || name == number ? number : fmt::format("\"{}\" (row {})", printable(quoted(name)), number);
}

std::string superscript(int exponent) {
  static constexpr const char* digits[] = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string text = exponent < 0 ? "⁻" : "";
  for (const char digit : std::to_string(std::abs(exponent))) text += digits[digit - '0'];
  return text;
}

std::string listed(const std::vector<std::string>& names) {
  std::string text = names.empty() ? "" : names.front();
  for (size_t i = 1; i < names.size(); ++i) text += (i + 1 == names.size() ? " and " : ", ") + names[i];
  return text;
}

std::string ranges(const std::vector<Index>& numbers) {
  constexpr size_t most_ranges = 6;
  std::vector<std::string> found;
  for (size_t i = 0; i < numbers.size();) {
    size_t j = i;
    while (j + 1 < numbers.size() && numbers[j + 1] == numbers[j] + 1) ++j;
    found.push_back(i == j ? fmt::format("{}", numbers[i]) : fmt::format("{}–{}", numbers[i], numbers[j]));
    i = j + 1;
  }
  if (found.size() <= most_ranges) return listed(found);
  found.resize(most_ranges);
  return fmt::format("{} and more ({} in all)", fmt::join(found, ", "), numbers.size());
}

std::string step_list(const std::vector<Index>& steps) {
  return (steps.size() == 1 ? "step " : "steps ") + ranges(steps);
}

namespace {

// The number without the sign "%". It is rounded down, because 99.97 must not become 100.
std::string percent_figure(double fit, int least_digits) {
  if (!std::isfinite(fit)) return "–";
  if (fit < -999) return "below −999";
  const double gap = 100 - fit;
  if (gap < 1e-6) return "100";
  const int digits = std::max(least_digits, gap >= 10 ? 0 : std::clamp(int(std::ceil(-std::log10(gap))), 1, 6));
  const double scale = std::pow(10.0, digits);
  const double cut = std::floor(fit * scale) / scale;
  return cut < 0 ? fmt::format("−{:.{}f}", -cut, digits) : fmt::format("{:.{}f}", cut, digits);
}

}  // namespace

std::string percent(double fit, int digits) { return percent_figure(fit, digits) + (std::isfinite(fit) ? " %" : ""); }

std::string figure(double value, int digits) {
  if (std::isnan(value)) return "–";
  if (std::isinf(value)) return value > 0 ? "∞" : "−∞";
  const double size = std::abs(value);
  if (size == 0 || (size >= 1e-4 && size < 1e4)) {
    // Numbers in this range get no exponent. A large number is written with all of its integer digits.
    const int integers = size >= 1 ? static_cast<int>(std::log10(size)) + 1 : 1;
    std::string text = fmt::format("{:.{}g}", size, std::max(digits, integers));
    // the number was rounded up to a power of ten
    if (text.find('e') != std::string::npos) text = fmt::format("{:.0f}", std::stod(text));
    return value < 0 ? "−" + text : text;
  }
  const std::string text = fmt::format("{:.{}e}", size, digits - 1);
  const size_t e = text.find('e');
  std::string mantissa = text.substr(0, e);
  while (mantissa.find('.') != std::string::npos && (mantissa.back() == '0' || mantissa.back() == '.')) {
    const bool point = mantissa.back() == '.';
    mantissa.pop_back();
    if (point) break;
  }
  const std::string factor = mantissa == "1" ? "" : mantissa + "·";
  return fmt::format("{}{}10{}", value < 0 ? "−" : "", factor, superscript(std::stoi(text.substr(e + 1))));
}

std::string probability(double p) { return p < 1e-4 ? "p < 0.0001" : fmt::format("p = {:.3g}", p); }

std::string percent_range(const Vector& fits) {
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (const double fit : fits)
    if (std::isfinite(fit)) least = std::min(least, fit), most = std::max(most, fit);
  if (least > most) return "–";
  const std::string a = percent_figure(least, 0), b = percent_figure(most, 0);
  if (a == b) return a + " %";
  // With a minus sign, "to" is easier to read than a dash.
  return fmt::format("{}{}{} %", a, least < 0 ? " to " : "–", b);
}

std::string plural(Index count, std::string_view noun) {
  return fmt::format("{} {}{}", count, noun, count == 1 ? "" : "s");
}

}  // namespace tokid::words
