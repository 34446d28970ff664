// SPDX-License-Identifier: BSD-3-Clause
#include "report/chart.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <functional>

#include "testing.hpp"

namespace tokid::testing {
namespace {

using namespace report;

Figure one_series(Series series, Axis y = {"y"}) { return {"id", "Title", "Caption", {{{"x"}, y, {series}}}}; }

// What stands between `open` and `close`, wherever that is.
std::vector<std::string> between(const std::string& text, const std::string& open, const std::string& close) {
  std::vector<std::string> result;
  for (size_t at = text.find(open); at != std::string::npos; at = text.find(open, at)) {
    at += open.size();
    result.push_back(text.substr(at, text.find(close, at) - at));
  }
  return result;
}

// The numbers in the path data of the given class.
std::vector<double> numbers(const std::string& svg, const std::string& css_class) {
  std::vector<double> result;
  for (const std::string& d : between(svg, "<path class=\"" + css_class + "\" d=\"", "\"")) {
    const char* at = d.c_str();
    while (*at != '\0') {
      if (!std::isdigit(static_cast<unsigned char>(*at)) && *at != '-') {
        ++at;
        continue;
      }
      char* end = nullptr;
      result.push_back(std::strtod(at, &end));
      at = end;
    }
  }
  return result;
}

size_t count(const std::string& text, const std::string& part) {
  size_t found = 0;
  for (size_t at = text.find(part); at != std::string::npos; at = text.find(part, at + 1)) ++found;
  return found;
}

TEST(Ticks, LinearOnesAreRoundAndCoverTheRange) {
  EXPECT_EQ(linear_ticks(0, 1, 5), (std::vector<double>{0, 0.2, 0.4, 0.6000000000000001, 0.8, 1.0}));
  EXPECT_EQ(linear_ticks(-3, 4, 4), (std::vector<double>{-2, 0, 2, 4}));
  Random random(1);
  for (int i = 0; i < 200; ++i) {
    const double least = random.normal() * std::pow(10, random.uniform(-12, 12));
    const double most = least + std::pow(10, random.uniform(-3, 3)) * std::max(1e-300, std::abs(least));
    for (const int wanted : {4, 6, 8}) {
      const std::vector<double> ticks = linear_ticks(least, most, wanted);
      EXPECT_GE(ticks.size(), 2u) << least << " " << most;
      EXPECT_LE(ticks.size(), size_t(2 * wanted)) << least << " " << most;
      const double step = ticks[1] - ticks[0];
      EXPECT_GE(ticks.front(), least - 1e-6 * step);
      EXPECT_LE(ticks.back(), most + 1e-6 * step);
      EXPECT_LT(ticks.front() - least, step * (1 + 1e-6));  // no room for another one
      EXPECT_LT(most - ticks.back(), step * (1 + 1e-6));
    }
  }
  EXPECT_TRUE(linear_ticks(1, 1, 5).empty());
  EXPECT_TRUE(linear_ticks(0, std::numeric_limits<double>::infinity(), 5).empty());
  // Where not even a tick can be told from the next one, and where a step underflows.
  const std::vector<double> ticks = linear_ticks(1e20, 1e20 + 65536, 5);
  EXPECT_LE(ticks.size(), 8u);
  EXPECT_EQ(std::adjacent_find(ticks.begin(), ticks.end(), std::greater_equal<>()), ticks.end());
  EXPECT_TRUE(linear_ticks(0, 4e-323, 5).empty());
}

TEST(Ticks, DecadesAreThinnedToTheNumberWanted) {
  EXPECT_EQ(decade_ticks(1e-2, 1e2, 6), (std::vector<int>{-2, -1, 0, 1, 2}));
  EXPECT_EQ(decade_ticks(2e-3, 5e1, 6), (std::vector<int>{-2, -1, 0, 1}));
  EXPECT_LE(decade_ticks(1e-18, 1e3, 6).size(), 6u);
  EXPECT_GE(decade_ticks(1e-18, 1e3, 6).size(), 3u);
  EXPECT_TRUE(decade_ticks(0, 1, 6).empty());
}

TEST(Chart, PointsLieWhereTheirValuesAre) {
  // Equal steps in x, and equal ratios in y on a logarithmic axis, are equal lengths.
  const std::string drawn = svg(one_series({"", {0, 1, 2, 3}, {1e-3, 1e-2, 1e-1, 1}}, {"y", true}), Setting::page);
  const std::vector<double> p = numbers(drawn, "c0");  // M x y h0 L x y L x y L x y
  ASSERT_EQ(p.size(), 9u);
  const std::vector<double> x{p[0], p[3], p[5], p[7]}, y{p[1], p[4], p[6], p[8]};
  for (size_t i = 1; i + 1 < 4; ++i) {
    EXPECT_NEAR(x[i + 1] - x[i], x[1] - x[0], 0.2);  // rounded to a tenth
    EXPECT_NEAR(y[i + 1] - y[i], y[1] - y[0], 0.2);
  }
  EXPECT_GT(x[1], x[0] + 50);
  EXPECT_LT(y[1], y[0] - 30);  // upwards
}

TEST(Chart, FiguresToBeComparedShareTheirScale) {
  const auto labels = [](const Series& series, std::vector<double> cover) {
    const std::string drawn = svg(one_series(series, {"y", true, std::move(cover)}), Setting::page);
    std::vector<std::string> found;
    for (const std::string& tick : between(drawn, "<text class=\"y\"", "</text>"))
      found.push_back(tick.substr(tick.find('>') + 1));
    return found;
  };
  const Series small{"", {0, 1}, {1e-9, 1e-8}}, large{"", {0, 1}, {1e-3, 1e-2}};
  EXPECT_NE(labels(small, {}), labels(large, {}));
  EXPECT_EQ(labels(small, {1e-3, 1e-2}), labels(large, {1e-9, 1e-8}));
}

TEST(Chart, TheUnitCircleIsRoundAndPolesLieOnIt) {
  Figure figure = one_series({"poles", {1, 0, -1, 0, 5}, {0, 1, 0, -1, 0}, Mark::dot});
  figure.panels[0].complex_plane = true;
  const std::string drawn = svg(figure, Setting::page);
  const std::vector<std::string> circle = between(drawn, "<ellipse", "/>");
  ASSERT_EQ(circle.size(), 1u);
  const auto value = [&](const char* name) {
    return std::stod(between(circle[0], std::string(" ") + name + "=\"", "\"").at(0));
  };
  const double cx = value("cx"), cy = value("cy"), rx = value("rx"), ry = value("ry");
  EXPECT_NEAR(rx, ry, 0.2);
  const std::vector<double> p = numbers(drawn, "c0 dot");  // M x y h0, five times
  ASSERT_EQ(p.size(), 15u);
  for (size_t i = 0; i < 4; ++i) EXPECT_NEAR(std::hypot(p[3 * i] - cx, p[3 * i + 1] - cy), rx, 0.3) << i;
}

TEST(Chart, WhatCannotBeDrawnLeavesGapsAndNothingElse) {
  const double infinity = std::numeric_limits<double>::infinity();
  const std::string drawn =
      svg(one_series({"", {0, 1, 2, 3, 4, 5}, {1, nan, 2, 0, infinity, 3}}, {"y", true}), Setting::page);
  EXPECT_EQ(drawn.find("nan"), std::string::npos);
  EXPECT_EQ(drawn.find("inf"), std::string::npos);
  EXPECT_EQ(count(drawn, "h0"), 3u);  // three pieces of one point each
  // Nothing at all, one value, equal values: axes all the same.
  for (const Series& s : {Series{"", {}, {}}, Series{"", {1}, {2}}, Series{"", {0, 1}, {0, 0}}, Series{"", {0}, {nan}}})
    for (const bool log : {false, true}) {
      const std::string text = svg(one_series(s, {"y", log}), Setting::page);
      EXPECT_NE(text.find("class=\"axis\""), std::string::npos);
      EXPECT_EQ(text.find("nan"), std::string::npos);
      EXPECT_EQ(text.find("inf"), std::string::npos);
    }
}

TEST(Chart, NamesAreTextAndNotMarkup) {
  Figure figure = one_series({"<script>alert(1)</script>", {0, 1}, {0, 1}}, {"<b>&\""});
  figure.panels[0].series.push_back({"\"'>", {0, 1}, {1, 0}});
  figure.title = "</title><img src=x>";
  for (const Setting setting : {Setting::page, Setting::file}) {
    const std::string drawn = svg(figure, setting);
    EXPECT_EQ(drawn.find("<script"), std::string::npos);
    EXPECT_EQ(drawn.find("<img"), std::string::npos);
    EXPECT_EQ(drawn.find("<b>"), std::string::npos);
    EXPECT_NE(drawn.find("&lt;script&gt;"), std::string::npos);
  }
}

TEST(Chart, AFileCarriesItsStyleAndAPageDoesNot) {
  const Figure figure = one_series({"", {0, 1}, {0, 1}});
  EXPECT_NE(svg(figure, Setting::file).find("<style>"), std::string::npos);
  EXPECT_NE(svg(figure, Setting::file).find("xmlns"), std::string::npos);
  EXPECT_EQ(svg(figure, Setting::page).find("<style>"), std::string::npos);
}

TEST(Chart, LegendsHaveNoEmptyEntriesAndBreakIntoLines) {
  Figure figure = one_series({"first", {0, 1}, {0, 1}});
  EXPECT_EQ(svg(figure, Setting::page).find("first"), std::string::npos);  // a single one needs no legend
  for (int i = 0; i < 12; ++i) figure.panels[0].series.push_back({i % 2 ? "another name" : "", {0, 1}, {0, 1}});
  const std::string drawn = svg(figure, Setting::page);
  EXPECT_EQ(count(drawn, ">another name<"), 6u);
  std::vector<double> x;
  for (const std::string& entry : between(drawn, "<text x=\"", "</text>"))
    if (entry.find("another name") != std::string::npos) x.push_back(std::stod(entry));
  ASSERT_EQ(x.size(), 6u);
  for (const double left : x) EXPECT_LE(left + 12 * 6, 560);
}

}  // namespace
}  // namespace tokid::testing
