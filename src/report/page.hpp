// HTML pages in a single file: text, tables, data, and the parts that all pages share.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace tokid::report {

// Escapes a text for use between tags or in a quoted attribute. Bytes that are not UTF-8 become U+FFFD, and control
// characters become spaces.
std::string escape(std::string_view text);

// <tag class="…">text</tag>; the text is escaped.
std::string element(std::string_view tag, std::string_view text, std::string_view css_class = {});

// A table of texts, which are escaped. A table that is wider than the page can be scrolled.
class Table {
 public:
  // Columns of text are aligned to the left, columns of numbers to the right.
  enum class Align { text, number };
  struct Column {
    std::string title;
    Align align = Align::number;
    size_t longest = 80;  // characters of a cell; of a longer text, only the mouse pointer shows all
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

// A list of facts, each with a label and a value.
class Facts {
 public:
  void row(std::string_view label, std::string_view value);
  std::string html() const;

 private:
  std::string rows_;
};

// A <section> with a heading and an id for links. The heading is escaped; the body is HTML.
std::string section(std::string_view id, std::string_view heading, std::string_view body);

// The place for the plot `name` and its legend, below a heading, if there is one. A script draws both. Without a
// script, they take no space. `label` describes the plot to screen readers.
std::string plot_place(std::string_view name, std::string_view label, std::string_view heading = {});

// A <script type="application/json" id="…"> with JSON text, changed so that it cannot end the element or begin a
// comment.
std::string script_json(std::string_view id, std::string_view json);
// A <script> with code that is part of tokid and not of the data. \throws std::invalid_argument if the code could end
// the element
std::string script(std::string_view code);

struct Link {
  std::string id, text;
};

// The parts of a page. `body` is HTML; the texts before it are escaped.
struct Document {
  std::string title;        // of the window and the first heading
  std::string kind;         // small text above the heading, such as "Identification report"
  std::vector<Link> links;  // sections, for the navigation
  std::string body;
  std::string data;         // JSON, in the element `report-data`
  std::string_view script;  // draws the plots from the data
};

// Makes the whole page. It has the style of all pages. It is light or dark, as the reader's system or a button sets it.
// It loads nothing.
std::string document(const Document& parts);

}  // namespace tokid::report
