// SPDX-License-Identifier: BSD-3-Clause
#include "base/sentence.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "base/words.hpp"

namespace tokid {

namespace {

// The first of these characters at or after `from` that stands in no inner braces; npos if there is none.
size_t find_outside(std::string_view text, std::string_view characters, size_t from) {
  int depth = 0;
  for (size_t i = from; i < text.size(); ++i) {
    if (depth == 0 && characters.find(text[i]) != std::string_view::npos) return i;
    depth += text[i] == '{' ? 1 : text[i] == '}' ? -1 : 0;
  }
  return std::string_view::npos;
}

// A factor with two digits.
std::string factor(double ratio) {
  if (ratio >= 1e4) return "more than 10000";
  const double unit = ratio >= 1000 ? 100 : ratio >= 100 ? 10 : ratio >= 10 ? 1 : 0.1;
  return fmt::format("{:.{}f}", std::round(ratio / unit) * unit, unit < 1 ? 1 : 0);
}

class Filling {
 public:
  explicit Filling(const SentenceFields& fields) : fields_(fields) {}

  std::string text(std::string_view text) const {
    std::string result;
    for (size_t i = 0; i < text.size();) {
      const size_t open = std::min(text.find('{', i), text.size());
      result += text.substr(i, open - i);
      if (open == text.size()) break;
      const size_t close = find_outside(text, "}", open + 1);
      if (close == std::string_view::npos) throw std::logic_error(fmt::format("sentence: no end of a field in {}", text));
      result += field(text.substr(open + 1, close - open - 1));
      i = close + 1;
    }
    return result;
  }

 private:
  double number(std::string_view name) const {
    const auto found = fields_.numbers.find(std::string(name));
    if (found == fields_.numbers.end()) throw std::logic_error(fmt::format("sentence: no number {}", name));
    return found->second;
  }
  Index integer(std::string_view name) const {
    if (name.front() == '?') return Index(fields_.numbers.count(std::string(name.substr(1))));
    return name.front() == '#' ? fields_.count(name.substr(1)) : Index(std::llround(number(name)));
  }

  std::string field(std::string_view field) const {
    if (const size_t bar = field.find('|'); bar != std::string_view::npos) {
      const size_t second = find_outside(field, "|", bar + 1);
      return text(integer(field.substr(0, bar)) == 1 ? field.substr(bar + 1, second - bar - 1)
                                                     : field.substr(second + 1));
    }
    if (field.front() == '@') return fields_.part(field.substr(1));
    const size_t end = field.find_first_of("~%:* ");
    const std::string_view name = field.substr(0, end);
    if (end == std::string_view::npos) return fmt::to_string(integer(name));
    const std::string_view rest = field.substr(end + 1);
    switch (field[end]) {
      case '~':
        return words::figure(number(name), rest.empty() ? 3 : rest.front() - '0');
      case '%':
        return fmt::format("{:.0f}", 100 * number(name));
      case ':':
        return fmt::format(fmt::runtime(fmt::format("{{:{}}}", rest)), number(name));
      case '*':
        return factor(number(name));
      default:
        return words::plural(integer(name), rest);
    }
  }

  const SentenceFields& fields_;
};

}  // namespace

std::string sentence(std::string_view text, const SentenceFields& fields) { return Filling(fields).text(text); }

}  // namespace tokid
