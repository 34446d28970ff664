// Makes the page with the results of the paper's example.
// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "report/assets.hpp"
#include "report/page.hpp"
#include "report/paper_figures.hpp"
#include "tokid/report.hpp"

namespace tokid {

namespace report {

namespace {

std::string figure_html(const Figure& figure) {
  std::string panels;
  for (size_t i = 0; i < figure.panels.size(); ++i)
    panels += plot_place(fmt::format("{}-{}", figure.id, i + 1),
                         fmt::format("{}: {}", figure.title, figure.panels[i].y.label));
  return fmt::format(
      "<figure id=\"{}\">\n{}<figcaption><b>{}</b> {}</figcaption>\n</figure>\n", figure.id, panels,
      escape(figure.id.starts_with("figure-") ? fmt::format("Figure {}. {}.", figure.id.substr(7), figure.title)
                                              : figure.title + "."),
      escape(figure.caption));
}

// Columns of figures. They are side by side if the page is wide enough.
std::string figure_columns(const std::vector<std::vector<Figure>>& figures) {
  std::string html = "<div class=\"two\">\n";
  for (const std::vector<Figure>& column : figures) {
    html += "<div class=\"stack\">\n";
    for (const Figure& figure : column) html += figure_html(figure);
    html += "</div>\n";
  }
  return html + "</div>\n";
}

bool is_zero(const PrintedNumber& n) { return std::abs(n.printed) < 1e-9; }

std::string number(std::complex<double> value, const char* format) {
  std::string text = fmt::format(fmt::runtime(format), value.real());
  if (value.imag() != 0)
    text += fmt::format("{}{}i", value.imag() < 0 ? " - " : " + ",
                        fmt::format(fmt::runtime(format), std::abs(value.imag())));
  return text;
}

// A table of all numbers of Appendix B. Numbers that are zero up to rounding errors have another format.
std::string printed_table(const Paper& paper) {
  Table table(
      {{"equation", Table::Align::text}, {"quantity", Table::Align::text}, {"printed"}, {"computed"}, {"difference"}},
      "Every number of Appendix B");
  for (const PrintedNumber& n : paper.printed) {
    const bool zero = is_zero(n);
    table.row({n.equation, n.quantity, number(n.printed, zero ? "{:.2e}" : "{:.5g}"),
               number(n.computed, zero ? "{:.2e}" : "{:.7f}"), fmt::format("{:.1e}", std::abs(n.computed - n.printed))},
              n.agrees() ? "" : "mark");
  }
  return table.html();
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

std::string summary(const Paper& paper) {
  const auto count = [&](auto&& what) { return std::count_if(paper.printed.begin(), paper.printed.end(), what); };
  const auto wrong = count([](const PrintedNumber& n) { return !n.agrees(); });
  const auto known = count([](const PrintedNumber& n) { return n.equation == "(74)" || n.equation == "(75)"; });
  const auto zero = count(is_zero);
  const Index all = Index(paper.printed.size());
  return wrong > 0
             ? fmt::format("{} of the {} numbers printed in Appendix B are not reproduced.", wrong, all)
             : fmt::format(
                   "All {} numbers printed in Appendix B are reproduced. {} come from experiments alone: six "
                   "eigenvalues to "
                   "five digits, and 48 matrix entries within {:.1e} by one similarity. {} are zero but for rounding "
                   "errors, and {} belong to the time-invariant example, whose matrices are known.",
                   all, all - known - zero, largest_entry_difference(paper), zero, known);
}

std::string verdict_section(const Paper& paper) {
  const bool met = std::all_of(paper.printed.begin(), paper.printed.end(), [](const auto& n) { return n.agrees(); });
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
  return fmt::format(
      "<section id=\"verdict\" class=\"verdict {}\">\n{}{}{}</section>\n", met ? "good" : "bad",
      element("p", summary(paper), "summary"),
      note("The numerical example of M. Majji, J.-N. Juang and J. L. Junkins, Observer/Kalman Filter Time Varying "
           "System Identification: an oscillator of four states, two inputs and two outputs, whose stiffness varies by "
           "3/4 and 3/7 of its mean with a period of 0.63 s. tokid simulates repeated experiments on it, identifies A, "
           "B, C, D and the observer gain G of every step from them with p = 2 lags, and compares with the true system "
           "and with the paper."),
      facts.html());
}

std::string appendix_section(const Paper& paper) {
  return section(
      "appendix-b", "Appendix B",
      note(fmt::format(
          "The coordinates of the paper are known up to one similarity, which is fitted to the 48 entries of "
          "(79)-(81) at once; its equations leave one singular value {:.1e} times the next. Eigenvalues do not "
          "depend on the coordinates. "
          "Products of two closed-loop matrices, and half of the eigenvalues, are zero up to rounding errors, here "
          "as there.",
          paper.similarity)) +
          printed_table(paper));
}

std::string kalman_section(const KalmanStudy& study, const std::string& figures) {
  const KalmanStudyOptions& o = study.options;
  return section(
      "kalman", "The observer and the Kalman filter",
      note(fmt::format(
          "Section V argues that with noise the identified observer tends to the Kalman filter. Here it does: the "
          "same oscillator over {} steps with process noise {:g} on each state and measurement noise {:g} on each "
          "output; observers identified from N experiments with p lags predict {} fresh experiments, steps {} to {}. "
          "The Kalman filter of the true system, which none can beat, has a root mean square error of {:.4f}. N → ∞ "
          "stands for the exact second moments of infinitely many experiments.",
          o.steps, o.process_noise, o.measurement_noise, o.fresh, o.begin, o.end - 1, study.kalman_error)) +
          kalman_table(study) + figures);
}

}  // namespace

}  // namespace report

std::string paper_page(const Paper& paper, const KalmanStudy& study) {
  using namespace report;
  const std::vector<Figure> f = paper_figures(paper, study);
  return document(
      {.title = "The paper, recomputed",
       .kind = "Observer/Kalman filter time varying system identification",
       .links = {{"observer", "The observer"},
                 {"errors", "Errors"},
                 {"appendix-b", "Appendix B"},
                 {"kalman", "Kalman filter"}},
       .body = verdict_section(paper) + section("observer", "The observer", figure_columns({{f[0], f[6]}, {f[5]}})) +
               section("errors", "Markov parameters and outputs", figure_columns({{f[1], f[3]}, {f[2], f[4]}})) +
               appendix_section(paper) + kalman_section(study, figure_columns({{f[7]}, {f[8]}})),
       .data = paper_json(paper, study),
       .script = assets::paper_js()});
}

}  // namespace tokid
