// HTML pages that stand alone: text, tables, data, and the common frame of all pages.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tokid::report {

// Text for use between tags or in a quoted attribute. Text that is not UTF-8 becomes U+FFFD, and control characters
// become spaces.
std::string escape(std::string_view text);

// <tag class="…">text</tag>, the text escaped.
std::string element(std::string_view tag, std::string_view text, std::string_view css_class = {});

// A table of texts, all of them escaped. A table that is wider than the page scrolls.
class Table {
 public:
  // Columns of text are aligned to the left, columns of numbers to the right.
  enum class Align { text, number };
  struct Column {
    std::string title;
    Align align = Align::number;
  };
  explicit Table(std::vector<Column> columns, std::string_view caption, bool caption_shown = true);
  void row(const std::vector<std::string>& cells, std::string_view css_class = {});
  bool empty() const { return rows_.empty(); }
  std::string html() const;

 private:
  std::vector<Column> columns_;
  std::string caption_, rows_;
  bool caption_shown_;
};

// Label and value side by side, for facts.
class Facts {
 public:
  void row(std::string_view label, std::string_view value);
  std::string html() const;

 private:
  std::string rows_;
};

// <section> with a heading that links can reach. The heading is escaped, the body is HTML.
std::string section(std::string_view id, std::string_view heading, std::string_view body);

// The place of the plot `name` below its heading, if any, and its legend. A script fills both; without scripts they
// take no room. The label tells screen readers what the plot shows.
std::string plot_place(std::string_view name, std::string_view label, std::string_view heading = {});

// <script type="application/json" id="…"> with JSON text that cannot end the element or begin a comment.
std::string script_json(std::string_view id, std::string_view json);
// <script> of code that is part of tokid, never of data. \throws std::invalid_argument if it could end the element
std::string script(std::string_view code);

struct Link {
  std::string id, text;
};

// The parts of a page. `body` is HTML, the texts before it are escaped.
struct Document {
  std::string title;        // of the window and the first heading
  std::string kind;         // small words above the heading, as "identification report"
  std::vector<Link> links;  // sections, for the navigation
  std::string body;
  std::string data;         // JSON, in the element `report-data`
  std::string_view script;  // draws the plots from the data
};

// Makes the whole page. It has the shared style, is light or dark by the reader's system or a button, and loads
// nothing.
std::string document(const Document& parts);

}  // namespace tokid::report
