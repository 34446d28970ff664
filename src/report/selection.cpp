// SPDX-License-Identifier: BSD-3-Clause
#include "report/selection.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "base/words.hpp"
#include "report/page.hpp"

namespace tokid::report {

namespace {

using words::figure;

// A relative error from its logarithm.
std::string relative(double log_error) { return figure(100 * std::exp(log_error), 3) + " %"; }
std::string strength(double smoothing) { return std::isinf(smoothing) ? "∞" : figure(smoothing, 3); }
std::string choice_text(bool chosen) { return chosen ? "chosen" : ""; }
const char* choice_class(bool chosen) { return chosen ? "chosen" : ""; }

// A table that is folded up below a line that states the choice.
std::string folded(const std::string& summary, const std::string& about, const Table& table) {
  return fmt::format("<details><summary>{}</summary>\n{}{}</details>\n", escape(summary), element("p", about, "note"),
                     table.html());
}

std::string lag_orders(const LagOrderErrors& errors) {
  if (errors.mean.size() == 0) return "";
  Table table({{"Lag order p"}, {"Error"}, {"Choice", Table::Align::text}}, "Candidates of the lag order", false);
  for (Index p = 1; p <= errors.mean.size(); ++p)
    table.row({fmt::format("{}", p), relative(errors.mean(p - 1) / 2), choice_text(p == errors.best)},
              choice_class(p == errors.best));
  return folded(
      fmt::format("Lag order: {} candidates, p = {} chosen", errors.mean.size(), errors.best),
      fmt::format("One-step errors of the regressions of {} without the predicted experiment, relative to the "
                  "outputs. The smallest order within one standard error of the smallest error is chosen.",
                  words::plural(Index(errors.steps.size()), "step")),
      table);
}

std::string smoothing(const SmoothingChoice& choice) {
  if (choice.trials.empty()) return "";
  std::vector<SmoothingTrial> trials = choice.trials;
  std::stable_sort(trials.begin(), trials.end(), [](const auto& a, const auto& b) { return a.error < b.error; });
  Table table({{"Lag order p"}, {"λ"}, {"Error"}, {"Choice", Table::Align::text}}, "Candidates of lag order and λ",
              false);
  for (const SmoothingTrial& t : trials) {
    const bool chosen = t.lags == choice.lags && t.smoothing == choice.smoothing;
    table.row({fmt::format("{}", t.lags), strength(t.smoothing), figure(100 * t.error, 4) + " %", choice_text(chosen)},
              choice_class(chosen));
  }
  return folded(
      fmt::format("Lag order and λ: {} candidates, p = {} and λ = {} chosen", trials.size(), choice.lags,
                  strength(choice.smoothing)),
      "One-step errors in cross-validation over the experiments, relative to the outputs, with the smallest "
      "first. λ weights the variation of the matrices over time; 0 means that every step has its own data only.",
      table);
}

// `refined`: EM was tried afterwards, and may have chosen another number.
std::string orders(const OrderScores& scores, bool refined) {
  if (scores.states.empty()) return "";
  std::vector<Table::Column> columns{{"States n"}};
  for (const Index h : scores.horizons) columns.push_back({words::plural(h, "step")});
  for (const char* title : {"Together", "Above the smallest"}) columns.push_back({title});
  columns.push_back({"Choice", Table::Align::text});
  Table table(columns, "Candidates of the number of states", false);
  for (size_t i = 0; i < scores.states.size(); ++i) {
    const bool chosen = scores.states[i] == scores.best;
    std::vector<std::string> row{fmt::format("{}", scores.states[i])};
    for (const double error : scores.errors.row(Index(i))) row.push_back(relative(error));
    row.push_back(relative(scores.mean(i)));
    row.push_back(figure(100 * std::expm1(scores.mean(i) - scores.smallest), 2) + " %");
    row.push_back(choice_text(chosen));
    table.row(row, choice_class(chosen));
  }
  return folded(
      fmt::format("Number of states: {} candidates, n = {} chosen{}", scores.states.size(), scores.best,
                  refined ? " before the refinement" : ""),
      fmt::format(
          "{} of predictions so many steps ahead, relative to the outputs. “Together” is their geometric mean{}. The "
          "smallest number of states that is at most a margin of 0.5 to 2 % above the smallest mean is chosen.",
          scores.cross_validated ? "Errors in cross-validation over the experiments" : "Errors on the training data",
          scores.cross_validated ? "" : " and a price for each state"),
      table);
}

std::string refinements(const RefinementChoice& choice) {
  if (choice.trials.empty()) return "";
  const auto is_chosen = [&](const RefinementTrial& t) {
    if (t.states != choice.states || t.iterations != choice.iterations) return false;
    return t.iterations == 0 || t.smoothing == choice.smoothing;
  };
  Table table(
      {{"States n"}, {"λ of EM"}, {"Iterations"}, {"Error"}, {"Log-likelihood"}, {"Choice", Table::Align::text}},
      "Candidates of the refinement by EM", false);
  for (const RefinementTrial& t : choice.trials) {
    const bool chosen = is_chosen(t);
    table.row({fmt::format("{}", t.states), t.iterations == 0 ? "without EM" : strength(t.smoothing),
               fmt::format("{}", t.iterations), relative(t.error),
               std::isfinite(t.log_likelihood) ? figure(t.log_likelihood, 6) : "–", choice_text(chosen)},
              choice_class(chosen));
  }
  const std::string outcome =
      choice.iterations == 0 ? std::string("no refinement chosen")
                             : fmt::format("n = {} and λ = {} with {} chosen", choice.states,
                                           strength(choice.smoothing), words::plural(choice.iterations, "iteration"));
  return folded(
      fmt::format("Refinement by EM: {} candidates, {}", choice.trials.size(), outcome),
      "Errors and log-likelihoods of held-out experiments in cross-validation. The log-likelihood decides, or the "
      "error if steps share their matrices.",
      table);
}

}  // namespace

std::string selection_tables(const Identification& identified) {
  return lag_orders(identified.lag_order_errors) + smoothing(identified.smoothing_choice) +
         orders(identified.order_scores, !identified.refinement.trials.empty()) + refinements(identified.refinement);
}

}  // namespace tokid::report
