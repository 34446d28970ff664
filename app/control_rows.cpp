// SPDX-License-Identifier: BSD-3-Clause
#include "control_rows.hpp"

#include <cmath>

namespace tokid::app {

namespace {

std::string in_words(const std::vector<Matrix>& weights) {
  if (weights.empty()) return "none";
  if (weights.size() > 1) return "one matrix for each step";
  const Vector diagonal = weights[0].diagonal();
  if (!weights[0].isDiagonal(0)) return "a matrix that is not diagonal";
  if ((diagonal.array() == diagonal(0)).all()) return number(diagonal(0));
  std::string text;
  for (const double value : diagonal) text += (text.empty() ? "" : ", ") + number(value);
  return text;
}

}  // namespace

void add_weights_rows(Page& page, const CostWeights& weights) {
  page.row("Weights", fmt::format("outputs {}, inputs {}", in_words(weights.output), in_words(weights.input)));
  if (!weights.input_rate.empty()) page.row("", fmt::format("input rates {}", in_words(weights.input_rate)));
  if (weights.terminal.size() > 0)
    page.row("", fmt::format("last step: outputs {} in addition", in_words({weights.terminal})));
}

void add_cost_rows(Page& page, const ExpectedCost& cost, bool rates, const std::optional<ExpectedCost>& nominal) {
  if (std::isfinite(cost.total()))
    page.row("Cost", fmt::format("{} expected with the observer: outputs {}, inputs {}{}", number(cost.total()),
                                 number(cost.outputs), number(cost.inputs),
                                 rates ? fmt::format(", input rates {}", number(cost.input_rates)) : ""));
  else
    page.row("Cost",
             "not finite with the observer: the expected motion of the closed loop exceeds the range of numbers. The "
             "controller is written without its cost.");
  // An overflow in the observer leaves the cost with the nominal inputs unknown.
  if (nominal && std::isfinite(nominal->total()))
    page.row("", fmt::format("{} with the nominal inputs alone", number(nominal->total())));
  else if (nominal && std::isfinite(cost.total()))
    page.row("", "not finite with the nominal inputs alone");
  if (cost.presumes_zero_state)
    page.row(
        "",
        "This cost presumes that the observer begins with the state zero. Until the observer has estimated the state, the inputs are nominal.");
}

Json json_of(const ExpectedCost& cost) {
  return {{"outputs", cost.outputs},
          {"inputs", cost.inputs},
          {"input_rates", cost.input_rates},
          {"measurement_noise", cost.measurement_noise},
          {"total", cost.total()}};
}

}  // namespace tokid::app
