// SPDX-License-Identifier: BSD-3-Clause
#include "report/page.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "io/text.hpp"
#include "report/assets.hpp"
#include "tokid/version.hpp"

namespace tokid::report {

namespace {

using io::character_length;

constexpr std::string_view replacement = "\xEF\xBF\xBD";  // U+FFFD

void append_escaped(std::string_view character, std::string& result) {
  switch (character[0]) {
    case '&':
      result += "&amp;";
      return;
    case '<':
      result += "&lt;";
      return;
    case '>':
      result += "&gt;";
      return;
    case '"':
      result += "&quot;";
      return;
    case '\'':
      result += "&#39;";
      return;
    default:
      break;
  }
  if (io::is_control(character))
    result += ' ';
  else
    result += character;
}

}  // namespace

std::string escape(std::string_view text) {
  std::string result;
  result.reserve(text.size());
  while (!text.empty()) {
    const size_t length = character_length(text);
    if (length == 0)
      result += replacement;
    else
      append_escaped(text.substr(0, length), result);
    text.remove_prefix(std::max<size_t>(1, length));
  }
  return result;
}

std::string element(std::string_view tag, std::string_view text, std::string_view css_class) {
  const std::string attribute = css_class.empty() ? "" : fmt::format(" class=\"{}\"", escape(css_class));
  return fmt::format("<{}{}>{}</{}>\n", tag, attribute, escape(text), tag);
}

namespace {

// A name of hundreds of characters would make a table unreadable. The cell shows its beginning; the mouse pointer on
// the cell shows the whole name.
std::string cell(std::string_view tag, std::string_view attributes, std::string_view text, size_t longest) {
  size_t end = 0;
  for (size_t characters = 0; end < text.size() && characters < longest; ++characters)
    end += std::max<size_t>(1, character_length(text.substr(end)));
  const bool whole = end >= text.size();
  return fmt::format("<{0}{1}{2}>{3}{4}</{0}>", tag, attributes,
                     whole ? "" : fmt::format(" title=\"{}\"", escape(text)), escape(text.substr(0, end)),
                     whole ? "" : "…");
}

}  // namespace

Table::Table(std::vector<Column> columns, std::string_view caption, bool caption_shown)
    : columns_(std::move(columns)), caption_(caption), caption_shown_(caption_shown) {}

void Table::row(const std::vector<std::string>& cells, std::string_view css_class) {
  if (cells.size() != columns_.size())
    throw std::invalid_argument(fmt::format("table: row of {} cells found, {} needed", cells.size(), columns_.size()));
  rows_ += css_class.empty() ? "<tr>" : fmt::format("<tr class=\"{}\">", escape(css_class));
  for (size_t c = 0; c < cells.size(); ++c) {
    const std::string align = columns_[c].align == Align::number ? " class=\"n\"" : "";
    rows_ += c == 0 ? cell("th", " scope=\"row\"" + align, cells[c], columns_[c].longest)
                    : cell("td", align, cells[c], columns_[c].longest);
  }
  rows_ += "</tr>\n";
}

std::string Table::html() const {
  std::string head;
  for (const Column& column : columns_)
    head += cell("th", column.align == Align::number ? " scope=\"col\" class=\"n\"" : " scope=\"col\"", column.title,
                 column.longest);
  return fmt::format(
      "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{}\"><table>\n{}<thead><tr>{}</tr></thead>\n"
      "<tbody>\n{}</tbody></table></div>\n",
      escape(caption_), element("caption", caption_, caption_shown_ ? "" : "unseen"), head, rows_);
}

void Facts::row(std::string_view label, std::string_view value) {
  rows_ += fmt::format("<div><dt>{}</dt><dd>{}</dd></div>\n", escape(label), escape(value));
}

std::string Facts::html() const { return fmt::format("<dl class=\"facts\">\n{}</dl>\n", rows_); }

std::string section(std::string_view id, std::string_view heading, std::string_view body) {
  return fmt::format(
      "<section id=\"{0}\" aria-labelledby=\"{0}-heading\">\n<h2 id=\"{0}-heading\">{1}</h2>\n{2}</section>\n",
      escape(id), escape(heading), body);
}

std::string plot_place(std::string_view name, std::string_view label, std::string_view heading) {
  return (heading.empty() ? "" : element("h3", heading, "scripted-only")) +
         fmt::format(
             "<div class=\"legend\" id=\"legend-{0}\" aria-live=\"off\"></div>\n"
             "<div class=\"plot\" id=\"plot-{0}\" role=\"img\" aria-label=\"{1}\"></div>\n",
             escape(name), escape(label));
}

std::string script_json(std::string_view id, std::string_view json) {
  std::string safe;
  safe.reserve(json.size());
  for (size_t i = 0; i < json.size(); ++i) {
    const std::string_view rest = json.substr(i, 3);
    if (json[i] == '<')
      safe += "\\u003c";
    else if (json[i] == '>')
      safe += "\\u003e";
    else if (json[i] == '&')
      safe += "\\u0026";
    else if (rest == "\xE2\x80\xA8" || rest == "\xE2\x80\xA9")
      safe += rest[2] == '\xA8' ? "\\u2028" : "\\u2029", i += 2;
    else
      safe += json[i];
  }
  return fmt::format("<script type=\"application/json\" id=\"{}\">{}</script>\n", escape(id), safe);
}

std::string script(std::string_view code) {
  for (const char* forbidden : {"</script", "<!--"})
    if (code.find(forbidden) != std::string_view::npos)
      throw std::invalid_argument(fmt::format("script: {} found in the code", forbidden));
  return fmt::format("<script>\n{}\n</script>\n", code);
}

namespace {

// Escapes a text, but keeps its line breaks.
std::string escape_lines(std::string_view text) {
  std::string result;
  while (!text.empty()) {
    const size_t end = std::min(text.find('\n'), text.size());
    result += escape(text.substr(0, end)) + '\n';
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return result;
}

std::string navigation(const std::vector<Link>& links) {
  if (links.empty()) return "";
  std::string items;
  for (const Link& link : links) items += fmt::format("<a href=\"#{}\">{}</a>\n", escape(link.id), escape(link.text));
  return fmt::format("<nav aria-label=\"Sections\"><div>\n{}</div></nav>\n", items);
}

}  // namespace

std::string document(const Document& parts) {
  const std::string title = escape(parts.title);
  std::string page = fmt::format(
      "<!doctype html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n"
      "<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n"
      "<meta name=\"color-scheme\" content=\"light dark\">\n<meta name=\"generator\" content=\"tokid {}\">\n"
      // The browser must load nothing, even if a name contains HTML.
      "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'unsafe-inline'; "
      "style-src 'unsafe-inline'; img-src data:; base-uri 'none'; form-action 'none'\">\n"
      "<link rel=\"icon\" href=\"data:,\">\n<title>{}</title>\n<style>\n",
      escape(version), title);
  page += assets::uplot_css();
  page += assets::page_css();
  page += "</style>\n</head>\n<body>\n";
  page += script("document.documentElement.classList.add('scripted');");
  page += fmt::format(
      "<header class=\"top\"><div class=\"kind\">{}</div><h1>{}</h1>\n"
      "<button type=\"button\" id=\"theme\" class=\"quiet\" aria-label=\"Light or dark\" "
      "hidden>Dark</button></header>\n",
      escape(parts.kind), title);
  page += navigation(parts.links);
  page +=
      "<p class=\"note unscripted\">JavaScript is off: the tables are all here, the plots are not drawn.</p>\n"
      "<main>\n";
  page += parts.body;
  page += "</main>\n<footer>\n";
  page += fmt::format("<p>Made by tokid {}. This file is complete in itself and loads nothing.</p>\n", escape(version));
  page += fmt::format(
      "<details><summary>Plots by uPlot 1.6.32, MIT licence</summary><pre>https://github.com/leeoniya/uPlot\n\n"
      "{}</pre></details>\n</footer>\n",
      escape_lines(assets::uplot_license()));
  page += script(assets::uplot_js()) + script(assets::page_js()) + script_json("report-data", parts.data) +
          script(assets::plots_js()) + script(parts.script);
  return page + "</body>\n</html>\n";
}

}  // namespace tokid::report
