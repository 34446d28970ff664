// Figures as SVG text, for pages and files. Unlike the plotting library of the report page, they need no browser. They
// use the page's colours, so that light, dark and print need no second drawing.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

namespace tokid::report {

enum class Mark { line, dashed, dot, cross };

struct Series {
  std::string name;          // in the legend; empty: not listed
  std::vector<double> x, y;  // same number; NaN leaves a gap
  Mark mark = Mark::line;
  int colour = 0;  // 0 … 7, distinct for readers of any colour vision
};

struct Axis {
  std::string label;
  bool log = false;                // values that are not positive lie below the axis and are not drawn
  std::vector<double> cover = {};  // values within the axis, drawn or not: figures to be compared share their scale
};

// One pair of axes.
struct Panel {
  Axis x, y;
  std::vector<Series> series;
  bool complex_plane = false;  // both axes to the same scale, with the unit circle
};

struct Figure {
  std::string id;             // of the file and the element: letters, digits, hyphens
  std::string title;          // its subject
  std::string caption;        // its content, and how it was made
  std::vector<Panel> panels;  // one below the other
};

// <svg> element. In a file it has its own style and name space; in a page it uses the page's style.
enum class Setting { page, file };
std::string svg(const Figure& figure, Setting setting);

// Ticks of a linear axis that cover [least, most] in steps of 1, 2 or 5 times a power of ten, about `count` of them.
std::vector<double> linear_ticks(double least, double most, int count);
// Exponents of the decades within [least, most], thinned to at most `count`; both ends positive.
std::vector<int> decade_ticks(double least, double most, int count);

}  // namespace tokid::report
