// The page, the files and the data of the paper's example.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <cmath>

#include "base/json.hpp"
#include "report/assets.hpp"
#include "report/page.hpp"
#include "report/paper_figures.hpp"
#include "tokid/report.hpp"
#include "tokid/version.hpp"

namespace tokid {

namespace report {

namespace {

std::string figure_html(const Figure& figure) {
  return fmt::format(
      "<figure id=\"{}\">\n{}<figcaption><b>{}</b> {}</figcaption>\n</figure>\n", figure.id, svg(figure, Setting::page),
      escape(figure.id.starts_with("figure-") ? fmt::format("Figure {}. {}.", figure.id.substr(7), figure.title)
                                              : figure.title + "."),
      escape(figure.caption));
}

// Figures side by side if there is room. The figures of an inner list stand below each other.
std::string figures_html(const std::vector<Figure>& figures, const std::vector<std::vector<size_t>>& columns) {
  std::string html = "<div class=\"two\">\n";
  for (const std::vector<size_t>& column : columns) {
    html += "<div class=\"stack\">\n";
    for (const size_t i : column) html += figure_html(figures[i]);
    html += "</div>\n";
  }
  return html + "</div>\n";
}

std::string number(std::complex<double> value, const char* format) {
  std::string text = fmt::format(fmt::runtime(format), value.real());
  if (value.imag() != 0)
    text += fmt::format("{}{}i", value.imag() < 0 ? " - " : " + ",
                        fmt::format(fmt::runtime(format), std::abs(value.imag())));
  return text;
}

// All numbers of Appendix B. Those that are zero up to rounding errors are in a separate list.
std::string printed_table(const Paper& paper) {
  Table table(
      {{"equation", Table::Align::text}, {"quantity", Table::Align::text}, {"printed"}, {"computed"}, {"difference"}},
      "Every number of Appendix B");
  for (const PrintedNumber& n : paper.printed) {
    const bool zero = std::abs(n.printed) < 1e-9;
    table.row({n.equation, n.quantity, number(n.printed, zero ? "{:.2e}" : "{:.5g}"),
               number(n.computed, zero ? "{:.2e}" : "{:.7f}"), fmt::format("{:.1e}", std::abs(n.computed - n.printed))},
              n.agrees() ? "" : "mark");
  }
  return table.html();
}

size_t disagreements(const Paper& paper) {
  return size_t(std::count_if(paper.printed.begin(), paper.printed.end(), [](const auto& n) { return !n.agrees(); }));
}

double largest_entry_difference(const Paper& paper) {
  double largest = 0;
  for (const PrintedNumber& n : paper.printed)
    if (n.tolerance >= 1e-4) largest = std::max(largest, std::abs(n.computed - n.printed));
  return largest;
}

std::string kalman_table(const KalmanStudy& study) {
  std::vector<Table::Column> columns{{"p", Table::Align::text}};
  for (const Index count : study.options.experiments) columns.push_back({experiments_name(count)});
  Table table(columns, "One-step prediction error over that of the Kalman filter, and in brackets ‖G + A K‖ / ‖A K‖");
  for (const Index p : study.options.lags) {
    std::vector<std::string> row{fmt::format("{}", p)};
    for (const Index count : study.options.experiments) {
      row.emplace_back("–");
      for (const KalmanStudyCell& cell : study.cells)
        if (cell.lags == p && cell.experiments == count)
          row.back() = fmt::format("{:.3f} ({:.2f})", cell.error, cell.gain);
    }
    table.row(row);
  }
  return table.html();
}

std::string note(std::string_view text) { return element("p", text, "note"); }

std::string page(const Paper& paper, const KalmanStudy& study) {
  const std::vector<Figure> figures = paper_figures(paper), kalman = kalman_figures(study);
  const size_t wrong = disagreements(paper);
  const auto count = [&](auto&& what) { return std::count_if(paper.printed.begin(), paper.printed.end(), what); };
  const auto known = count([](const PrintedNumber& n) { return n.equation == "(74)" || n.equation == "(75)"; });
  const auto zero = count([](const PrintedNumber& n) { return std::abs(n.printed) < 1e-9; });

  std::string verdict = element(
      "p",
      wrong == 0
          ? fmt::format(
                "All {} numbers printed in Appendix B are met. {} come out of experiments alone: six eigenvalues to "
                "five digits, and 48 matrix entries within {:.1e} by one similarity. {} are zero but for rounding "
                "errors, and {} belong to the time-invariant example, whose matrices are known.",
                paper.printed.size(), Index(paper.printed.size()) - known - zero, largest_entry_difference(paper), zero,
                known)
          : fmt::format("{} of the {} numbers printed in Appendix B are not met.", wrong, paper.printed.size()),
      "summary");
  verdict += note(
      "The numerical example of M. Majji, J.-N. Juang and J. L. Junkins, Observer/Kalman Filter Time Varying System "
      "Identification: an oscillator of four states, two inputs and two outputs, whose stiffness varies by 3/4 and "
      "3/7 of its mean with a period of 0.63 s. tokid simulates repeated experiments on it, identifies A, B, C, D "
      "and the observer gain G of every step from them with p = 2 lags, and compares with the true system and with "
      "the paper.");
  Facts facts;
  facts.row("System",
            "(77), (78) with Δt = 0.05 s, stiffness with off-diagonal entries -1; the paper's step k is k - 1 here");
  for (const PaperCase* one : {&paper.minimum, &paper.more})
    facts.row(
        one == &paper.minimum ? "Case 1" : "Case 2",
        fmt::format("{} experiments of {} steps from rest with unit Gaussian inputs{}; windows up to condition {:.2g}",
                    one->experiments, paper.system.steps(), one == &paper.minimum ? ", the minimum r + p(r + m)" : "",
                    one->condition_max));
  facts.row("Frame",
            "reference frame of step 0 with 3 block rows, where free responses show all states from step 0 on");

  std::string body = fmt::format("<section id=\"verdict\" class=\"verdict {}\">\n{}{}</section>\n",
                                 wrong == 0 ? "good" : "bad", verdict, facts.html());
  body += section("observer", "The observer", figures_html(figures, {{0, 6}, {5}}));
  body += section("errors", "Markov parameters and outputs", figures_html(figures, {{1, 3}, {2, 4}}));
  body += section(
      "appendix-b", "Appendix B",
      note(fmt::format(
          "The coordinates of the paper are known up to one similarity, which is fitted to the 48 entries of "
          "(79)-(81) at once; its equations leave one singular value {:.1e} times the next. Eigenvalues need none. "
          "Products of two closed-loop matrices, and half of the eigenvalues, are zero but for rounding errors, here "
          "as there.",
          paper.similarity)) +
          printed_table(paper));
  const KalmanStudyOptions& o = study.options;
  body += section(
      "kalman", "The observer and the Kalman filter",
      note(fmt::format(
          "Section V argues that with noise the identified observer tends to the Kalman filter. Here it does: the "
          "same oscillator over {} steps with process noise {:g} on each state and measurement noise {:g} on each "
          "output; observers identified from N experiments with p lags predict {} fresh experiments, steps {} to {}. "
          "The Kalman filter of the true system, which none can beat, has a root mean square error of {:.4f}. N → ∞ "
          "stands for the exact second moments of infinitely many experiments.",
          o.steps, o.process_noise, o.measurement_noise, o.fresh, o.begin, o.end - 1, study.kalman_error)) +
          kalman_table(study) + figures_html(kalman, {{0}, {1}}));
  return document({.title = "The paper, recomputed",
                   .kind = "Observer/Kalman filter time varying system identification",
                   .links = {{"observer", "The observer"},
                             {"errors", "Errors"},
                             {"appendix-b", "Appendix B"},
                             {"kalman", "Kalman filter"}},
                   .body = body,
                   .plots = false,
                   .style = std::string(assets::chart_css()),
                   .scripts = ""});
}

}  // namespace

}  // namespace report

std::string paper_page(const Paper& paper, const KalmanStudy& study) { return report::page(paper, study); }

std::vector<PaperFile> paper_figure_files(const Paper& paper, const KalmanStudy& study) {
  std::vector<PaperFile> files;
  for (const auto& list : {report::paper_figures(paper), report::kalman_figures(study)})
    for (const report::Figure& figure : list)
      files.push_back({figure.id + ".svg", report::svg(figure, report::Setting::file)});
  return files;
}

std::string paper_json(const Paper& paper, const KalmanStudy& study) {
  const auto figure_json = [](const report::Figure& figure) {
    Json panels = Json::array();
    for (const report::Panel& panel : figure.panels) {
      Json series = Json::array();
      for (const report::Series& s : panel.series) series.push_back({{"name", s.name}, {"x", s.x}, {"y", s.y}});
      panels.push_back({{"x_label", panel.x.label}, {"y_label", panel.y.label}, {"series", std::move(series)}});
    }
    return Json{{"id", figure.id}, {"title", figure.title}, {"caption", figure.caption}, {"panels", std::move(panels)}};
  };
  const auto complex = [](std::complex<double> value) { return Json{value.real(), value.imag()}; };
  const auto case_json = [](const PaperCase& one) {
    return Json{{"experiments", one.experiments}, {"condition_max", one.condition_max}};
  };

  Json json;
  json["version"] = version;
  json["dt"] = paper.system.dt;
  json["steps"] = paper.system.steps();
  json["lags"] = paper.lags;
  json["case_1"] = case_json(paper.minimum);
  json["case_2"] = case_json(paper.more);
  json["figures"] = Json::array();
  for (const report::Figure& figure : report::paper_figures(paper)) json["figures"].push_back(figure_json(figure));
  json["similarity"] = paper.similarity;
  json["appendix_b"] = Json::array();
  for (const PrintedNumber& n : paper.printed)
    json["appendix_b"].push_back({{"equation", n.equation},
                                  {"quantity", n.quantity},
                                  {"printed", complex(n.printed)},
                                  {"computed", complex(n.computed)},
                                  {"tolerance", n.tolerance},
                                  {"agrees", n.agrees()}});
  Json products = paper.products;
  json["closed_loop_products"] = std::move(products);
  Json& kalman = json["kalman_study"];
  const KalmanStudyOptions& o = study.options;
  kalman = {{"process_noise", o.process_noise},
            {"measurement_noise", o.measurement_noise},
            {"steps", o.steps},
            {"begin", o.begin},
            {"end", o.end},
            {"fresh", o.fresh},
            {"kalman_error", study.kalman_error},
            {"cells", Json::array()}};
  for (const KalmanStudyCell& cell : study.cells)
    kalman["cells"].push_back({{"lags", cell.lags},
                               {"experiments", cell.experiments > 0 ? Json(cell.experiments) : Json(nullptr)},
                               {"error", cell.error},
                               {"gain", cell.gain}});
  return text_of(json, 1) + "\n";
}

}  // namespace tokid
