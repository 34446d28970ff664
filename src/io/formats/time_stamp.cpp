// SPDX-License-Identifier: BSD-3-Clause
#include "io/formats/time_stamp.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>

#include "base/words.hpp"
#include "io/text.hpp"

namespace tokid::io {

namespace {

constexpr std::int64_t second = 1'000'000'000, minute = 60 * second, hour = 60 * minute, day_length = 24 * hour;

// Takes parts from the beginning of a text.
class Scanner {
 public:
  explicit Scanner(std::string_view text) : rest_(text) {}

  bool done() const { return rest_.empty(); }
  char front() const { return rest_.empty() ? '\0' : rest_.front(); }

  bool skip(std::string_view any_of) {
    if (rest_.empty() || any_of.find(rest_.front()) == std::string_view::npos) return false;
    rest_.remove_prefix(1);
    return true;
  }
  void skip_all(std::string_view any_of) {
    while (skip(any_of)) continue;
  }

  // A number of at least `least` and at most `most` digits, after which no digit follows.
  std::optional<int> digits(size_t least, size_t most) {
    size_t count = 0;
    while (count < rest_.size() && is_digit(rest_[count])) ++count;
    if (count < least || count > most) return std::nullopt;
    int value = 0;
    for (size_t i = 0; i < count; ++i) value = 10 * value + (rest_[i] - '0');
    rest_.remove_prefix(count);
    return value;
  }

  // Exactly `count` digits; more digits may follow.
  std::optional<int> exactly(size_t count) {
    if (rest_.size() < count || !std::all_of(rest_.begin(), rest_.begin() + std::ptrdiff_t(count), is_digit))
      return std::nullopt;
    Scanner part(rest_.substr(0, count));
    rest_.remove_prefix(count);
    return part.digits(count, count);
  }

  // Digits after a decimal mark, as nanoseconds, and their number.
  std::pair<std::int64_t, int> fraction() {
    std::int64_t value = 0, unit = second;
    int count = 0;
    for (; !rest_.empty() && is_digit(rest_.front()); rest_.remove_prefix(1), ++count)
      if (unit > 1) unit /= 10, value += unit * (rest_.front() - '0');
    return {value, count};
  }

  size_t digits_ahead() const {
    size_t count = 0;
    while (count < rest_.size() && is_digit(rest_[count])) ++count;
    return count;
  }
  char after(size_t count) const { return count < rest_.size() ? rest_[count] : '\0'; }

  // Letters, in lower case.
  std::string word() {
    size_t count = 0;
    while (count < rest_.size() && is_letter(rest_[count])) ++count;
    std::string result = in_lower_case(std::string(rest_.substr(0, count)));
    rest_.remove_prefix(count);
    return result;
  }

 private:
  static bool is_digit(char c) { return c >= '0' && c <= '9'; }
  static bool is_letter(char c) { return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z'); }

  std::string_view rest_;
};

// The number of a month from its English or German name, or from the first three letters of it; 0 for another word.
int month_of(const std::string& word) {
  constexpr std::array<std::string_view, 12> names{"january",   "february", "march",    "april",
                                                   "may",       "june",     "july",     "august",
                                                   "september", "october",  "november", "december"};
  for (size_t i = 0; i < names.size(); ++i)
    if (word.size() >= 3 && (names[i].starts_with(word) || word == names[i].substr(0, 3))) return int(i) + 1;
  for (const auto& [name, month] :
       {std::pair("sept", 9), std::pair("mrz", 3), std::pair("mai", 5), std::pair("okt", 10), std::pair("dez", 12)})
    if (word == name) return month;
  return 0;
}

std::optional<int> year_of(Scanner& text) {
  const size_t count = text.digits_ahead();
  if (count != 2 && count != 4) return std::nullopt;
  const std::optional<int> year = text.digits(count, count);
  return count == 4 ? year : std::optional(*year < 70 ? 2000 + *year : 1900 + *year);
}

// "2026-11-27", "20261127" before a "T".
bool year_first(Scanner& text, Stamp& stamp) {
  const bool packed = text.digits_ahead() == 8;
  const auto year = text.exactly(4);
  const char mark = text.front();
  if (!year || (!packed && !text.skip("-/."))) return false;
  const auto month = packed ? text.exactly(2) : text.digits(1, 2);
  if (!month || (!packed && !text.skip(std::string_view(&mark, 1)))) return false;
  const auto day = packed ? text.exactly(2) : text.digits(1, 2);
  if (!day || (packed && text.front() != 'T')) return false;
  stamp.year = *year, stamp.first = *month, stamp.second = *day;
  return true;
}

// "27.11.2026", "11/27/2026", "27-11-26", "27-Nov-2026", "27 November 2026".
bool year_last(Scanner& text, Stamp& stamp) {
  const auto first = text.digits(1, 2);
  if (!first) return false;
  const char mark = text.front();
  if (!text.skip("./- ")) return false;
  text.skip_all(" ");
  if (const std::string name = text.word(); !name.empty()) {
    const int month = month_of(name);
    text.skip_all("./- ");
    const auto year = year_of(text);
    if (month == 0 || !year) return false;
    stamp.year = *year, stamp.first = month, stamp.second = *first;
    return true;
  }
  if (mark == ' ') return false;
  const auto other = text.digits(1, 2);
  if (!other || !text.skip(std::string_view(&mark, 1))) return false;
  const auto year = year_of(text);
  if (!year) return false;
  stamp.year = *year;
  stamp.open = mark != '.';
  stamp.first = stamp.open ? *first : *other, stamp.second = stamp.open ? *other : *first;
  return true;
}

// "Nov 27, 2026".
bool month_name_first(Scanner& text, Stamp& stamp) {
  const int month = month_of(text.word());
  text.skip_all(". -");
  const auto day = text.digits(1, 2);
  text.skip_all(", -");
  const auto year = day ? year_of(text) : std::nullopt;
  if (month == 0 || !year) return false;
  stamp.year = *year, stamp.first = month, stamp.second = *day;
  return true;
}

// "13:12", "13:12:05.123", "1:12:05 PM", "13:12:05+01:00". Without a date, hours may be more than a day has.
bool clock(Scanner& text, Stamp& stamp) {
  const auto hours = text.digits(1, stamp.has_date ? 2 : 4);
  if (!hours || !text.skip(":")) return false;
  const auto minutes = text.digits(2, 2);
  if (!minutes || *minutes > 59) return false;
  std::int64_t seconds = 0;
  stamp.hours = *hours;
  if (text.skip(":")) {
    stamp.has_seconds = true;
    const auto whole = text.digits(2, 2);
    if (!whole || *whole > 60) return false;
    seconds = *whole * second;
    const bool by_colon = text.front() == ':';
    if (text.skip(".,:")) {
      const auto [part, count] = text.fraction();
      if (count == 0 || (by_colon && count != 3)) return false;
      seconds += part;
      stamp.decimals = std::min(count, 9);
    }
  }
  int in_day = *hours;
  std::int64_t offset = 0;
  text.skip_all(" ");
  std::string word = text.word();
  if ((word == "a" || word == "p") && text.skip(".")) {
    text.skip_all(" ");
    word += text.word();
    text.skip_all(".");
  }
  if (word == "am" || word == "pm") {
    if (in_day < 1 || in_day > 12) return false;
    in_day = in_day % 12 + (word == "pm" ? 12 : 0);
    stamp.has_half = true;
  } else if (!word.empty()) {
    if (word != "z" && word != "utc" && word != "gmt") return false;
    stamp.has_zone = true;
  }
  const bool east = text.front() == '+';
  if (word.empty() && stamp.has_date && text.skip("+-")) {
    const auto zone_hours = text.exactly(2);
    text.skip(":");
    const auto zone_minutes = text.done() ? std::optional(0) : text.digits(2, 2);
    if (!zone_hours || !zone_minutes) return false;
    stamp.has_zone = true;
    offset = (east ? 1 : -1) * (*zone_hours * hour + *zone_minutes * minute);
  }
  if (stamp.has_date && in_day > 24) return false;
  stamp.nanoseconds = in_day * hour + *minutes * minute + seconds - offset;
  return text.done();
}

std::optional<std::int64_t> days_of(int year, int month, int day) {
  const std::chrono::year_month_day date{std::chrono::year(year), std::chrono::month(unsigned(month)),
                                         std::chrono::day(unsigned(day))};
  constexpr int earliest = 1900, latest = 2200;  // so that nanoseconds fit into 64 bits
  if (!date.ok() || year < earliest || year > latest) return std::nullopt;
  return std::chrono::sys_days(date).time_since_epoch().count();
}

bool may_be_valid(const Stamp& stamp) {
  if (!stamp.has_date) return true;
  return days_of(stamp.year, stamp.first, stamp.second) ||
         (stamp.open && days_of(stamp.year, stamp.second, stamp.first));
}

// Which number of the open dates is the day? Needs `stamps` with a date that is not the same in all of them.
struct Order {
  bool day_first = false;
  std::optional<size_t> day_is_first, month_is_first;  // stamps that show it, because one number is larger than 12
};

Order order_of(const std::vector<Stamp>& stamps) {
  Order order;
  for (size_t i = 0; i < stamps.size(); ++i) {
    if (!stamps[i].open) continue;
    if (stamps[i].first > 12 && !order.day_is_first) order.day_is_first = i;
    if (stamps[i].second > 12 && !order.month_is_first) order.month_is_first = i;
  }
  return order;
}

bool is_same_date(const Stamp& a, const Stamp& b) {
  return a.year == b.year && a.first == b.first && a.second == b.second;
}

// Decides the order of day and month, and returns a remark if the dates of the column showed it.
std::optional<std::string> settle(const std::vector<Index>& lines, const Names& texts, DateOrder stated,
                                  std::vector<Stamp>& stamps) {
  const auto any = std::find_if(stamps.begin(), stamps.end(), [](const Stamp& stamp) { return stamp.open; });
  if (any == stamps.end()) return std::nullopt;
  const Order order = order_of(stamps);
  const auto at = [&](size_t i) { return fmt::format("line {}, '{}'", lines[i], words::quoted(texts[i])); };
  if (order.day_is_first && order.month_is_first)
    fail(
        "{}: the first number can only be the day, but in {} it can only be the month; one order of day and month needed",
        at(*order.day_is_first), at(*order.month_is_first));
  const std::optional<size_t> shown = order.day_is_first ? order.day_is_first : order.month_is_first;
  const bool all_same =
      std::all_of(stamps.begin(), stamps.end(), [&](const Stamp& s) { return is_same_date(s, *any); });
  if (!shown && stated == DateOrder::automatic && !all_same)
    fail(
        "{}: this may be day/month or month/day, and no date of the column shows which of them; --dates day-first or "
        "--dates month-first needed",
        at(size_t(any - stamps.begin())));
  const bool day_first =
      stated == DateOrder::automatic ? order.day_is_first.has_value() : stated == DateOrder::day_first;
  if (shown && day_first != order.day_is_first.has_value())
    fail("{} found, but {} is stated; a date in the stated order needed", at(*shown),
         day_first ? "day/month" : "month/day");
  for (Stamp& stamp : stamps) {
    if (stamp.open && day_first) std::swap(stamp.first, stamp.second);
    stamp.open = false;
  }
  if (!shown || stated != DateOrder::automatic) return std::nullopt;
  return fmt::format("dates were read as {}, because of '{}' in line {}", day_first ? "day/month" : "month/day",
                     words::quoted(texts[*shown]), lines[*shown]);
}

// A column of stamps, for messages.
struct StampColumn {
  const std::vector<Stamp>& stamps;
  const std::vector<Index>& experiments;
  const std::vector<Index>& lines;
  const Names& texts;

  std::string at(size_t i) const { return fmt::format("line {}: '{}'", lines[i], words::quoted(texts[i])); }
};

void check_alike(const StampColumn& column) {
  const Stamp& first = column.stamps.front();
  const std::string like = fmt::format("'{}' in line {}", words::quoted(column.texts.front()), column.lines.front());
  for (size_t i = 0; i < column.stamps.size(); ++i) {
    const Stamp& stamp = column.stamps[i];
    if (stamp.has_date != first.has_date)
      fail("{} found, a {} like {} needed", column.at(i), stamp.has_date ? "time of day" : "date and time", like);
    if (stamp.has_zone != first.has_zone)
      fail("{} found {} a time zone, but {} {} one; a time zone in all rows or in none needed", column.at(i),
           stamp.has_zone ? "with" : "without", like, first.has_zone ? "with" : "without");
  }
}

[[noreturn]] void fail_without_dates(const StampColumn& column, size_t i, const char* why) {
  fail("{} found after '{}'; {}; dates beside the times of day needed", column.at(i),
       words::quoted(column.texts[i - 1]), why);
}

// The stamps of each experiment, in the order of their rows.
std::vector<std::vector<size_t>> of_experiments(const std::vector<Index>& experiments) {
  std::vector<std::vector<size_t>> of;
  for (size_t i = 0; i < experiments.size(); ++i) {
    of.resize(std::max(of.size(), size_t(experiments[i]) + 1));
    of[size_t(experiments[i])].push_back(i);
  }
  return of;
}

// 1 if the times of day rise, -1 if the newest row is first, 0 if the rows show neither. A change by more than half a
// day is one over midnight.
int direction_of(const std::vector<Stamp>& stamps, const std::vector<size_t>& rows) {
  size_t later = 0, earlier = 0;
  for (size_t i = 1; i < rows.size(); ++i) {
    const std::int64_t change = stamps[rows[i]].nanoseconds - stamps[rows[i - 1]].nanoseconds;
    if (change != 0) ++((change > 0) == (std::abs(change) <= day_length / 2) ? later : earlier);
  }
  return 4 * earlier <= later ? 1 : 4 * later <= earlier ? -1 : 0;
}

struct Midnights {
  std::vector<std::int64_t> days;  // that each stamp is after the day of the first stamp of its experiment
  std::optional<size_t> first;     // the first stamp after a midnight
  std::optional<size_t> doubtful;  // the first one whose time of day changes by less than half a day
};

// Hours of more than a day are elapsed times, which have no midnight. Without AM and PM, hours from 1 to 12 may belong
// to either half of the day.
void check_midnight(const StampColumn& column, size_t i) {
  const auto& stamps = column.stamps;
  if (std::any_of(stamps.begin(), stamps.end(), [](const Stamp& s) { return s.hours >= 24; }))
    fail_without_dates(column, i, "24 or more hours are no time of day");
  const auto may_be_half = [](const Stamp& s) { return !s.has_half && s.hours >= 1 && s.hours <= 12; };
  if (std::all_of(stamps.begin(), stamps.end(), may_be_half))
    fail_without_dates(column, i, "without AM and PM, this may be noon or midnight");
}

Midnights midnights_of(const StampColumn& column) {
  Midnights result;
  result.days.resize(column.stamps.size());
  for (const std::vector<size_t>& rows : of_experiments(column.experiments)) {
    const int direction = direction_of(column.stamps, rows);
    std::int64_t days = 0;
    for (size_t i = 1; i < rows.size(); ++i) {
      const std::int64_t change = column.stamps[rows[i]].nanoseconds - column.stamps[rows[i - 1]].nanoseconds;
      if (change != 0 && direction == 0) fail_without_dates(column, rows[i], "the times of day neither rise nor fall");
      if (change * direction < 0) {
        check_midnight(column, rows[i]);
        days += direction;
        if (!result.first) result.first = rows[i];
        if (!result.doubtful && std::abs(change) <= day_length / 2) result.doubtful = rows[i];
      }
      result.days[rows[i]] = days;
    }
  }
  return result;
}

std::optional<std::string> remark_on_midnights(const StampColumn& column, const Midnights& midnights) {
  if (!midnights.first) return std::nullopt;
  if (midnights.doubtful)
    return fmt::format(
        "{} after '{}' was read as a time of another day. If this is wrong, write dates beside the times of day",
        column.at(*midnights.doubtful), words::quoted(column.texts[*midnights.doubtful - 1]));
  return "the times of day pass midnight. The rows on the other side of midnight were read as rows of another day";
}

}  // namespace

std::optional<Stamp> stamp_from(std::string_view text) {
  const size_t begin = text.find_first_not_of(" \t"), end = text.find_last_not_of(" \t");
  if (begin == std::string_view::npos || text.size() > 64) return std::nullopt;
  text = text.substr(begin, end + 1 - begin);
  if (text.find_first_of(":/-.") == std::string_view::npos && text.find(' ') == std::string_view::npos)
    return std::nullopt;
  for (const auto date : {year_first, year_last, month_name_first}) {
    Scanner scanner(text);
    Stamp stamp;
    if (!date(scanner, stamp)) continue;
    stamp.has_date = true;
    if (!may_be_valid(stamp)) return std::nullopt;
    if (scanner.done()) return stamp;
    if (!scanner.skip("Tt ,_")) continue;
    scanner.skip_all(" ");
    stamp.has_clock = true;
    return clock(scanner, stamp) ? std::optional(stamp) : std::nullopt;
  }
  Scanner scanner(text);
  Stamp stamp;
  stamp.has_clock = true;
  return clock(scanner, stamp) ? std::optional(stamp) : std::nullopt;
}

std::optional<Stamp> joined(const std::optional<Stamp>& date, const std::optional<Stamp>& time) {
  if (!date || !time || !date->has_date || date->has_clock || time->has_date) return std::nullopt;
  Stamp stamp = *date;
  stamp.has_clock = true, stamp.nanoseconds = time->nanoseconds, stamp.decimals = time->decimals;
  stamp.hours = time->hours, stamp.has_seconds = time->has_seconds, stamp.has_half = time->has_half;
  stamp.has_zone = time->has_zone;
  return stamp;
}

StampTimes times_of(const std::vector<Stamp>& stamps, const std::vector<Index>& experiments,
                    const std::vector<Index>& lines, const Names& texts, DateOrder order) {
  StampTimes result;
  if (stamps.empty()) return result;
  std::vector<Stamp> settled = stamps;
  result.remark = settle(lines, texts, order, settled);
  const StampColumn column{settled, experiments, lines, texts};
  check_alike(column);
  Midnights midnights;
  if (!settled.front().has_date) {
    midnights = midnights_of(column);
    result.remark = remark_on_midnights(column, midnights);
  }
  std::int64_t origin = 0;
  for (size_t i = 0; i < settled.size(); ++i) {
    const Stamp& stamp = settled[i];
    const auto days =
        stamp.has_date ? days_of(stamp.year, stamp.first, stamp.second) : std::optional(midnights.days[i]);
    if (!days) fail("line {}: '{}' found, a valid date needed", lines[i], words::quoted(texts[i]));
    const std::int64_t time = *days * day_length + stamp.nanoseconds;
    if (i == 0) origin = time;
    result.seconds.push_back(double(time - origin) / double(second));
    result.decimals = std::max(result.decimals, stamp.decimals);
  }
  return result;
}

}  // namespace tokid::io
