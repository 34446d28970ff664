// SPDX-License-Identifier: BSD-3-Clause
#include "picture.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <string_view>

#include "common.hpp"
#include "data/extents.hpp"
#include "data/scales.hpp"
#include "tokid/printable.hpp"

namespace tokid::app {

namespace {

constexpr double none = std::numeric_limits<double>::quiet_NaN();
constexpr size_t widest = 100, label_columns = 20, range_columns = 24, most_channels = 12;
constexpr double odd_ratio = 4.0;  // distance from the median over the usual distance, beyond which it is odd

std::string label_of(const Ensemble& e, Index c) {
  return c < e.inputs() ? input_label(e.names, c) : output_label(e.names, c - e.inputs());
}

// One channel over time.
struct Course {
  std::vector<double> mean, spread;  // over the experiments; NaN without samples
  std::vector<double> missing;       // share of the experiments that have no sample within their length
  Index missing_samples = 0;
};

Course course_of(const Ensemble& e, Index c) {
  Course course;
  const std::vector<Index> length = lengths(e);
  for (Index k = 0; k < e.steps(); ++k) {
    const auto column = e.samples().col(k * e.channels() + c);
    // Differences from the first sample are exactly zero if all samples are equal.
    double first = none, mean = 0, squares = 0;
    Index count = 0, within = 0;
    for (Index n = 0; n < e.experiments(); ++n) {
      within += k < length[size_t(n)];
      if (std::isnan(column(n))) continue;
      if (count++ == 0) first = column(n);
      const double value = column(n) - first, before = value - mean;
      mean += before / double(count);
      squares += before * (value - mean);
    }
    course.mean.push_back(first + mean);
    course.spread.push_back(count > 1 ? spread_above_rounding(std::sqrt(squares / double(count - 1)), first) : none);
    course.missing.push_back(within > 0 ? double(within - std::min(within, count)) / double(within) : 0.0);
    course.missing_samples += within - std::min(within, count);
  }
  return course;
}

struct Range {
  double low = none, high = none;
};

Range range_of(const std::vector<double>& values) {
  Range range;
  for (const double value : values) {
    if (std::isnan(value)) continue;
    range.low = std::isnan(range.low) ? value : std::min(range.low, value);
    range.high = std::isnan(range.high) ? value : std::max(range.high, value);
  }
  return range;
}

// The range of the mean plus and minus the spread. If it were that of the mean alone, the random mean of a channel
// without mean motion would look like a motion.
Range range_with_spread(const Course& course) {
  std::vector<double> values;
  for (size_t k = 0; k < course.mean.size(); ++k) {
    const double spread = std::isnan(course.spread[k]) ? 0.0 : course.spread[k];
    values.insert(values.end(), {course.mean[k] - spread, course.mean[k] + spread});
  }
  return range_of(values);
}

// The mean (or the largest, for gaps) of the values of the steps that share a character. NaN does not count.
std::vector<double> in_cells(const std::vector<double>& values, size_t cells, bool largest) {
  std::vector<double> result;
  for (size_t i = 0; i < cells; ++i) {
    double sum = 0, most = none;
    int count = 0;
    for (size_t k = i * values.size() / cells; k < (i + 1) * values.size() / cells; ++k) {
      if (std::isnan(values[k])) continue;
      sum += values[k], ++count, most = std::isnan(most) ? values[k] : std::max(most, values[k]);
    }
    result.push_back(largest ? most : count > 0 ? sum / count : none);
  }
  return result;
}

// A character for each value, higher for larger ones; a space for NaN.
std::string line_of(const std::vector<double>& values, Range range, bool blocks) {
  constexpr std::array<std::string_view, 8> high{"\u2581", "\u2582", "\u2583", "\u2584",
                                                 "\u2585", "\u2586", "\u2587", "\u2588"};
  constexpr std::array<std::string_view, 8> plain{"_", ".", "-", "~", "=", "+", "*", "#"};
  const auto& levels = blocks ? high : plain;
  std::string line;
  for (const double value : values) {
    if (std::isnan(value)) {
      line += ' ';
      continue;
    }
    // A little more than half a level, so that rounding errors do not decide between two levels of few values.
    const double share = range.high > range.low ? (value - range.low) / (range.high - range.low) : 0.0;
    line += levels[size_t(std::clamp(share * 8 + 1e-9, 0.0, 7.0))];
  }
  return line;
}

std::string short_number(double value) { return std::isnan(value) ? "-" : fmt::format("{:.3g}", value); }

// Cuts a text to a number of characters. `blocks`: the terminal shows characters beyond ASCII.
std::string cut(const std::string& text, size_t most, bool blocks) {
  const std::string_view mark = blocks ? "\u2026" : "...";
  const size_t kept = most - (blocks ? 1 : 3);
  size_t characters = 0, end = 0;
  for (size_t i = 0; i < text.size(); ++i) {
    if ((static_cast<unsigned char>(text[i]) & 0xC0U) == 0x80U) continue;
    if (characters++ == kept) end = i;
  }
  return characters <= most ? text : fmt::format("{}{}", text.substr(0, end), mark);
}

std::string padded(const std::string& text, size_t columns, bool blocks) {
  const std::string shown = cut(text, columns, blocks);
  const auto count = size_t(std::count_if(shown.begin(), shown.end(),
                                          [](char c) { return (static_cast<unsigned char>(c) & 0xC0U) != 0x80U; }));
  return shown + std::string(columns - std::min(columns, count), ' ');
}

void add_line(const std::string& label, const std::string& drawing, const std::string& range, bool blocks,
              std::string& text) {
  std::string line = fmt::format("{}{}  {}", padded(label, label_columns, blocks), drawing, range);
  line.erase(line.find_last_not_of(' ') + 1);
  text += line + '\n';
}

// RMS of the departures of each experiment from the median over the experiments.
std::vector<double> distances(const Ensemble& e, Index c) {
  std::vector<double> squares(size_t(e.experiments())), samples(size_t(e.experiments()));
  for (Index k = 0; k < e.steps(); ++k) {
    const auto column = e.samples().col(k * e.channels() + c);
    const double middle = median({column.begin(), column.end()});
    for (Index n = 0; n < e.experiments(); ++n)
      if (!std::isnan(column(n)))
        squares[size_t(n)] += (column(n) - middle) * (column(n) - middle), samples[size_t(n)] += 1;
  }
  for (size_t n = 0; n < squares.size(); ++n) squares[n] = samples[n] > 0 ? std::sqrt(squares[n] / samples[n]) : none;
  return squares;
}

}  // namespace

bool shows_blocks() {
  for (const char* name : {"LC_ALL", "LC_CTYPE", "LANG"}) {
    const char* value = std::getenv(name);
    if (!value || *value == '\0') continue;
    std::string text = value;
    std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return char(std::tolower(c)); });
    return text.find("utf-8") != std::string::npos || text.find("utf8") != std::string::npos;
  }
  return false;
}

std::vector<Odd> odd_experiments(const Ensemble& e) {
  constexpr Index fewest = 5;
  std::vector<Odd> odd;
  if (e.experiments() < fewest) return odd;
  std::vector<double> largest(size_t(e.experiments()), odd_ratio);
  std::vector<std::string> why(size_t(e.experiments()));
  for (Index c = 0; c < e.channels(); ++c) {
    const std::vector<double> distance = distances(e, c);
    const double usual = median(distance);
    for (size_t n = 0; n < distance.size(); ++n) {
      if (!(distance[n] > largest[n] * usual)) continue;
      largest[n] = distance[n] / usual;  // infinite where most experiments are equal
      why[n] = usual == 0
                   ? fmt::format("{} differs where the others are equal", label_of(e, c))
                   : fmt::format("{} is {:.2g} times as far from the median as usual", label_of(e, c), largest[n]);
    }
  }
  if (!e.length.empty()) {
    const double usual = median({e.length.begin(), e.length.end()});
    for (size_t n = 0; n < why.size(); ++n)
      if (why[n].empty() && double(e.length[n]) < 0.5 * usual)
        why[n] = fmt::format("has {} of the usual {:.0f}", plural(e.length[n], "step"), usual);
  }
  for (size_t n = 0; n < why.size(); ++n)
    if (!why[n].empty()) odd.push_back({Index(n), why[n]});
  return odd;
}

std::string picture(const Ensemble& e, bool blocks) {
  const size_t cells = std::min(size_t(e.steps()), widest - label_columns - range_columns);
  std::string text;
  const size_t shown = std::min(size_t(e.channels()), most_channels);
  add_line("Picture",
           fmt::format("steps 0 to {} from left to right, mean and spread over the experiments", e.steps() - 1), "",
           blocks, text);
  for (size_t c = 0; c < shown; ++c) {
    const Course course = course_of(e, Index(c));
    const auto draw = [&](const std::string& label, const std::vector<double>& values, Range range,
                          const std::string& of) {
      add_line(label, line_of(in_cells(values, cells, false), range, blocks), of, blocks, text);
    };
    const Range spread = range_of(course.spread), drawn = range_with_spread(course);
    draw(label_of(e, Index(c)), course.mean, drawn,
         fmt::format("{} to {}", short_number(drawn.low), short_number(drawn.high)));
    if (!std::isnan(spread.high))
      draw("  spread", course.spread, {0.0, spread.high}, fmt::format("up to {}", short_number(spread.high)));
    if (course.missing_samples == 0) continue;
    std::vector<double> gaps = in_cells(course.missing, cells, true);
    std::replace(gaps.begin(), gaps.end(), 0.0, none);
    add_line("  missing", line_of(gaps, {0.0, 1.0}, blocks), plural(course.missing_samples, "sample"), blocks, text);
  }
  if (shown < size_t(e.channels()))
    add_line(
        "",
        fmt::format("{} more; --picture FILE.html draws all of them", plural(e.channels() - Index(shown), "channel")),
        "", blocks, text);
  constexpr size_t most_odd = 5;
  const std::vector<Odd> odd = odd_experiments(e);
  for (size_t i = 0; i < std::min(odd.size(), most_odd); ++i)
    add_line(i == 0 ? "Odd" : "",
             cut(printable(fmt::format("experiment {}: {}", e.experiment(odd[i].experiment), odd[i].why)),
                 widest - label_columns, blocks),
             "", blocks, text);
  if (odd.size() > most_odd) add_line("", fmt::format("{} more", odd.size() - most_odd), "", blocks, text);
  return text;
}

// ---- the page ----

namespace {

std::string escaped(std::string_view text) {
  std::string result;
  for (const char c : printable(text)) {
    if (c == '<')
      result += "&lt;";
    else if (c == '>')
      result += "&gt;";
    else if (c == '&')
      result += "&amp;";
    else if (c == '"')
      result += "&quot;";
    else
      result += c;
  }
  return result;
}

constexpr double drawing_width = 900, drawing_height = 120;

// Coordinates of a value in a drawing.
struct Scale {
  double steps, low, high;
  double x(size_t k) const { return steps > 1 ? drawing_width * double(k) / (steps - 1) : 0.0; }
  double y(double value) const {
    return high > low ? drawing_height * (1.0 - (value - low) / (high - low)) : 0.5 * drawing_height;
  }
};

// A line through the values, interrupted at NaN.
std::string path_of(const std::vector<double>& values, const Scale& scale) {
  std::string path;
  bool drawn = false;
  for (size_t k = 0; k < values.size(); ++k) {
    if (std::isnan(values[k])) {
      drawn = false;
      continue;
    }
    // A lone sample becomes a line of no length, whose round ends are a point.
    path += fmt::format("{}{:.1f} {:.1f}{}", drawn ? "L" : "M", scale.x(k), scale.y(values[k]), drawn ? "" : "h0");
    drawn = true;
  }
  return path;
}

// The areas between two lines, interrupted at NaN.
std::string band_of(const std::vector<double>& above, const std::vector<double>& below, const Scale& scale) {
  std::string path;
  for (size_t begin = 0, end = 0; begin < above.size(); begin = end + 1) {
    for (end = begin; end < above.size() && !std::isnan(above[end]) && !std::isnan(below[end]);) ++end;
    for (size_t k = begin; k < end; ++k)
      path += fmt::format("{}{:.1f} {:.1f}", k == begin ? "M" : "L", scale.x(k), scale.y(above[k]));
    for (size_t k = end; k > begin; --k) path += fmt::format("L{:.1f} {:.1f}", scale.x(k - 1), scale.y(below[k - 1]));
    if (end > begin) path += 'Z';
  }
  return path;
}

std::vector<double> samples_of(const Ensemble& e, Index n, Index c) {
  std::vector<double> values;
  for (Index k = 0; k < e.steps(); ++k) values.push_back(e.samples()(n, k * e.channels() + c));
  return values;
}

// The share of each step is at most that of a pixel; more steps than that are averaged.
std::string drawing(const Ensemble& e, Index c, const std::vector<Odd>& odd) {
  const Course course = course_of(e, c);
  const size_t cells = std::min(size_t(e.steps()), size_t(drawing_width));
  const std::vector<double> mean = in_cells(course.mean, cells, false), spread = in_cells(course.spread, cells, false);
  std::vector<double> above = mean, below = mean;
  for (size_t i = 0; i < cells; ++i)
    if (!std::isnan(spread[i])) above[i] += spread[i], below[i] -= spread[i];
  std::vector<std::vector<double>> lines;
  for (const Odd& one : odd) lines.push_back(in_cells(samples_of(e, one.experiment, c), cells, false));
  Range range = range_of(above);
  range.low = range_of(below).low;
  for (const auto& line : lines) {
    const Range own = range_of(line);
    range.low = std::fmin(range.low, own.low), range.high = std::fmax(range.high, own.high);
  }
  const Scale scale{double(cells), range.low, range.high};
  std::string svg = fmt::format("<svg viewBox=\"0 -4 {} {}\" role=\"img\" aria-label=\"{} over time\">", drawing_width,
                                drawing_height + 14, escaped(label_of(e, c)));
  svg += fmt::format("<path class=\"band\" d=\"{}\"/>", band_of(above, below, scale));
  for (const auto& line : lines) svg += fmt::format("<path class=\"odd\" d=\"{}\"/>", path_of(line, scale));
  svg += fmt::format("<path class=\"mean\" d=\"{}\"/>", path_of(mean, scale));
  const std::vector<double> missing = in_cells(course.missing, cells, true);
  const double wide = std::max(1.0, drawing_width / double(cells));
  for (size_t i = 0; i < cells; ++i)
    if (missing[i] > 0)
      svg += fmt::format("<rect class=\"gap\" x=\"{:.1f}\" y=\"{}\" width=\"{:.1f}\" height=\"6\" opacity=\"{:.2f}\"/>",
                         std::clamp(scale.x(i) - 0.5 * wide, 0.0, drawing_width - wide), drawing_height + 4, wide,
                         std::max(0.25, missing[i]));
  svg += "</svg>";
  return fmt::format(
      "<section><h2>{}</h2><p>mean from {} to {}; spread over the experiments up to {}{}</p>{}</section>\n",
      escaped(label_of(e, c)), short_number(range_of(course.mean).low), short_number(range_of(course.mean).high),
      short_number(range_of(course.spread).high),
      course.missing_samples > 0 ? fmt::format("; {} missing", plural(course.missing_samples, "sample")) : "", svg);
}

constexpr std::string_view style = R"(
:root{color-scheme:light dark;--ink:#1b1f24;--soft:#5b6470;--paper:#fff;--mean:#1f5fa8;--band:#9cc3ec;--odd:#c4531a;--gap:#a0352c}
@media(prefers-color-scheme:dark){:root{--ink:#e6e9ee;--soft:#a2acb8;--paper:#14171b;--mean:#7db8f5;--band:#2d5580;--odd:#f0955c;--gap:#ef7b70}}
body{font:16px/1.5 system-ui,sans-serif;margin:0 auto;max-width:960px;padding:1rem;color:var(--ink);background:var(--paper)}
h1{font-size:1.4rem}h2{font-size:1rem;margin:1.2rem 0 0}p{margin:.1rem 0 .3rem;color:var(--soft)}
svg{width:100%;height:auto;display:block}path{fill:none;stroke-width:1.6;stroke-linecap:round;vector-effect:non-scaling-stroke}
.mean{stroke:var(--mean)}.odd{stroke:var(--odd);stroke-width:1}.band{fill:var(--band);opacity:.6}.gap{fill:var(--gap)}
)";

}  // namespace

std::string picture_page(const Ensemble& e, const std::string& name) {
  constexpr size_t most_odd = 5;
  std::vector<Odd> odd = odd_experiments(e);
  std::string page = fmt::format(
      "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width, initial-scale=1\"><title>{0}</title><style>{1}</style></head><body>\n<h1>{0}</h1>\n<p>{2}</p>\n"
      "<p>Each drawing shows the mean over the experiments (line) and one standard deviation around it (band), from step "
      "0 to step {3}. Red marks below it show missing samples.</p>\n",
      escaped(name), style, escaped(describe(e)), e.steps() - 1);
  if (!odd.empty()) {
    page += "<p>Odd experiments, drawn as thin lines:</p><ul>";
    for (size_t i = 0; i < std::min(most_odd, odd.size()); ++i)
      page += fmt::format("<li>experiment {}: {}</li>", escaped(e.experiment(odd[i].experiment)), escaped(odd[i].why));
    if (odd.size() > most_odd) page += fmt::format("<li>{} more, which are not drawn</li>", odd.size() - most_odd);
    page += "</ul>\n";
    odd.resize(std::min(most_odd, odd.size()));
  }
  for (Index c = 0; c < e.channels(); ++c) page += drawing(e, c, odd);
  return page + "</body></html>\n";
}

}  // namespace tokid::app
