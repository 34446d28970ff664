// SPDX-License-Identifier: BSD-3-Clause
#include "report/chart.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include "base/words.hpp"
#include "report/assets.hpp"
#include "report/page.hpp"

namespace tokid::report {

namespace {

// Lengths in units of the view box.
constexpr double width = 560, panel_height = 290, square_height = 400;
constexpr double left = 66, right = 14, top = 12, bottom = 46, legend_line = 20, between = 10;
constexpr double letter = 6.6;  // width of a letter of the legend, on average or a little more

struct Range {
  double least = std::numeric_limits<double>::infinity(), most = -least;
  void add(double value) {
    if (!std::isfinite(value)) return;
    least = std::min(least, value);
    most = std::max(most, value);
  }
  bool empty() const { return !(least <= most); }
};

// Value → position along one axis.
struct Scale {
  bool log = false;
  double least = 0, most = 1, from = 0, to = 1;

  std::optional<double> operator()(double value) const {
    if (log && !(value > 0)) return std::nullopt;
    const double position = log ? std::log10(value) : value;
    if (!std::isfinite(position)) return std::nullopt;
    return from + (to - from) * (position - least) / (most - least);
  }
};

// Room around the values; an axis of one value gets a width of its own.
Scale scale(const Axis& axis, Range range, double from, double to) {
  Scale s{axis.log, 0, 1, from, to};
  if (range.empty()) return s;
  if (axis.log) {
    s.least = std::floor(std::log10(range.least));
    s.most = std::max(s.least + 1, std::ceil(std::log10(range.most)));
    return s;
  }
  const double room = range.most > range.least ? 0.04 * (range.most - range.least)
                      : range.most != 0        ? 0.5 * std::abs(range.most)
                                               : 1.0;
  s.least = range.least - room;
  s.most = range.most + room;
  return s;
}

struct Tick {
  double position;
  std::string label;
};

std::vector<Tick> ticks(const Scale& s, int count) {
  std::vector<Tick> result;
  const auto at = [&](double value) { return s.from + (s.to - s.from) * (value - s.least) / (s.most - s.least); };
  if (s.log) {
    for (const int exponent : decade_ticks(std::pow(10.0, s.least), std::pow(10.0, s.most), count))
      result.push_back({at(exponent), exponent == 0   ? "1"
                                      : exponent == 1 ? "10"
                                                      : "10" + words::superscript(exponent)});
  } else {
    for (const double value : linear_ticks(s.least, s.most, count))
      result.push_back({at(value), fmt::format("{:.6g}", value == 0 ? 0.0 : value)});
  }
  return result;
}

// Names of the series, in as many lines as they need.
struct Legend {
  std::string items;
  double height = 0;
};

Legend legend(const Panel& panel, double y) {
  Legend result;
  if (panel.series.size() < 2) return result;  // the axis names a single one
  double x = left, line = y + 13;
  for (const Series& s : panel.series) {
    if (s.name.empty()) continue;
    // The number of letters counts, not of bytes.
    const auto letters = std::count_if(s.name.begin(), s.name.end(), [](char c) { return (c & 0xC0) != 0x80; });
    const double size = 26 + letter * double(letters) + 14;
    if (x > left && x + size > width - right) x = left, line += legend_line;
    const double middle = line - 4;
    const std::string colour = fmt::format("c{}", s.colour % 8);
    switch (s.mark) {
      case Mark::line:
      case Mark::dashed:
        result.items += fmt::format("<path class=\"{}{}\" d=\"M{:.0f} {:.0f}h18\"/>", colour,
                                    s.mark == Mark::dashed ? " dashed" : "", x, middle);
        break;
      case Mark::dot:
        result.items += fmt::format("<path class=\"{} dot\" d=\"M{:.0f} {:.0f}h0\"/>", colour, x + 9, middle);
        break;
      case Mark::cross:
        result.items +=
            fmt::format("<path class=\"{} cross\" d=\"M{:.0f} {:.0f}l6 6m0 -6l-6 6\"/>", colour, x + 6, middle - 3);
        break;
    }
    result.items += fmt::format("<text x=\"{:.0f}\" y=\"{:.0f}\">{}</text>\n", x + 24, line, escape(s.name));
    x += size;
  }
  result.height = line - y + 9;
  return result;
}

// One path for all points of a series, with a gap at each value that cannot be drawn.
std::string path(const Series& s, const Scale& x, const Scale& y) {
  std::string d;
  bool pen_down = false;
  for (size_t i = 0; i < s.x.size(); ++i) {
    const std::optional<double> px = x(s.x[i]), py = y(s.y[i]);
    if (!px || !py) {
      pen_down = false;
      continue;
    }
    switch (s.mark) {
      case Mark::line:
      case Mark::dashed:
        // A value between two gaps is a line of no length, which round caps make a point.
        d += pen_down ? fmt::format("L{:.1f} {:.1f}", *px, *py) : fmt::format("M{:.1f} {:.1f}h0", *px, *py);
        break;
      case Mark::dot:
        d += fmt::format("M{:.1f} {:.1f}h0", *px, *py);
        break;
      case Mark::cross:
        d += fmt::format("M{:.1f} {:.1f}l5 5m0 -5l-5 5", *px - 2.5, *py - 2.5);
        break;
    }
    pen_down = true;
  }
  return d;
}

// Draws one panel from y downwards and returns the height that it took.
double draw(const Panel& panel, double y, std::string& out) {
  Range xs, ys;
  const auto visible = [](const Axis& axis, double value) { return std::isfinite(value) && (!axis.log || value > 0); };
  for (const Series& s : panel.series)
    for (size_t i = 0; i < s.x.size(); ++i)
      if (visible(panel.x, s.x[i]) && visible(panel.y, s.y[i])) xs.add(s.x[i]), ys.add(s.y[i]);
  for (const double value : panel.x.cover)
    if (visible(panel.x, value)) xs.add(value);
  for (const double value : panel.y.cover)
    if (visible(panel.y, value)) ys.add(value);
  const Legend names = legend(panel, y);
  const double begin = y + top + names.height;
  const double end = begin + (panel.complex_plane ? square_height : panel_height) - top - bottom;
  if (panel.complex_plane)
    for (const double one : {-1.0, 1.0}) xs.add(one), ys.add(one);
  Scale sx = scale(panel.x, xs, left, width - right), sy = scale(panel.y, ys, end, begin);
  if (panel.complex_plane) {
    // Equal values have equal lengths on both axes. The axis with more room extends to both sides.
    const double unit = std::max((sx.most - sx.least) / (sx.to - sx.from), (sy.most - sy.least) / (sy.from - sy.to));
    for (Scale* s : {&sx, &sy}) {
      const double middle = (s->least + s->most) / 2, half = unit * std::abs(s->to - s->from) / 2;
      s->least = middle - half;
      s->most = middle + half;
    }
  }

  out += names.items;
  out += "<g class=\"axis\">\n";
  for (const Tick& tick : ticks(sx, 8))
    out += fmt::format("<path d=\"M{0:.1f} {1:.1f}V{2:.1f}\"/><text x=\"{0:.1f}\" y=\"{3:.1f}\">{4}</text>\n",
                       tick.position, begin, end, end + 17, tick.label);
  for (const Tick& tick : ticks(sy, 6))
    out += fmt::format("<path d=\"M{:.1f} {:.1f}H{:.1f}\"/><text class=\"y\" x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n",
                       left, tick.position, width - right, left - 7, tick.position + 4, tick.label);
  out += fmt::format("<text class=\"label\" x=\"{:.1f}\" y=\"{:.1f}\">{}</text>\n", (left + width - right) / 2,
                     end + 36, escape(panel.x.label));
  out += fmt::format("<text class=\"label\" transform=\"translate(15 {:.1f}) rotate(-90)\">{}</text>\n</g>\n",
                     (begin + end) / 2, escape(panel.y.label));
  if (panel.complex_plane)
    out += fmt::format("<ellipse class=\"unit\" cx=\"{:.1f}\" cy=\"{:.1f}\" rx=\"{:.1f}\" ry=\"{:.1f}\"/>\n", *sx(0),
                       *sy(0), *sx(1) - *sx(0), *sy(0) - *sy(1));
  for (const Series& s : panel.series) {
    const char* kind = s.mark == Mark::dashed  ? " dashed"
                       : s.mark == Mark::dot   ? " dot"
                       : s.mark == Mark::cross ? " cross"
                                               : "";
    if (const std::string d = path(s, sx, sy); !d.empty())
      out += fmt::format("<path class=\"c{}{}\" d=\"{}\"/>\n", s.colour % 8, kind, d);
  }
  return end + bottom - y;
}

}  // namespace

std::vector<double> linear_ticks(double least, double most, int count) {
  std::vector<double> result;
  const double rough = (most - least) / std::max(1, count);
  if (!(rough > 0) || !std::isfinite(rough)) return result;
  const double decade = std::pow(10.0, std::floor(std::log10(rough))), share = rough / decade;
  const double step = decade * (share < 1.5 ? 1 : share < 3.5 ? 2 : share < 7.5 ? 5 : 10);
  if (!(step > 0)) return result;    // a range of numbers that underflow
  const double slack = 1e-9 * step;  // ends that miss a tick by rounding only
  const double first = std::ceil((least - slack) / step), last = std::floor((most + slack) / step);
  // Far from zero, neighbours may round to the same number.
  for (int i = 0; i <= int(last - first); ++i)
    if (const double tick = (first + i) * step; result.empty() || tick > result.back()) result.push_back(tick);
  return result;
}

std::vector<int> decade_ticks(double least, double most, int count) {
  std::vector<int> result;
  if (!(least > 0) || !(most >= least) || !std::isfinite(most)) return result;
  const int first = int(std::ceil(std::log10(least) - 1e-9)), last = int(std::floor(std::log10(most) + 1e-9));
  const int stride = std::max(1, (last - first + count) / std::max(1, count));
  for (int exponent = first; exponent <= last; ++exponent)
    if (exponent % stride == 0) result.push_back(exponent);
  return result;
}

std::string svg(const Figure& figure, Setting setting) {
  std::string panels;
  double y = 0;
  for (const Panel& panel : figure.panels) y += draw(panel, y, panels) + between;
  const double height = y - between;
  std::string result = fmt::format(
      "<svg{} class=\"tokid-chart\" viewBox=\"0 0 {:.0f} {:.0f}\" role=\"img\" aria-labelledby=\"{}-title\">\n"
      "<title id=\"{}-title\">{}</title>\n",
      setting == Setting::file ? fmt::format(" xmlns=\"http://www.w3.org/2000/svg\" width=\"{:.0f}\" height=\"{:.0f}\"",
                                             1.5 * width, 1.5 * height)
                               : "",
      width, height, figure.id, figure.id, escape(figure.title));
  if (setting == Setting::file)
    result +=
        fmt::format("<desc>{}</desc>\n<style>\n{}{}</style>\n<rect class=\"ground\" width=\"100%\" height=\"100%\"/>\n",
                    escape(figure.caption), assets::chart_colours_css(), assets::chart_css());
  result += panels + "</svg>\n";
  return result;
}

}  // namespace tokid::report
