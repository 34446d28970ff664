// tokid lqr: a model and weights → a controller of the departures from the nominal trajectory.
// SPDX-License-Identifier: BSD-3-Clause
#include "command.hpp"
#include "common.hpp"
#include "tokid/controller_file.hpp"
#include "weights.hpp"

namespace tokid::app {

namespace {

struct Call {
  fs::path model, output;
  Weights outputs = {1.0}, inputs = {1.0}, rates, terminal;
  Index begin = -1, end = -1;
  bool json = false;
};

CostWeights cost_of(const Call& call, const Model& model) {
  CostWeights cost;
  cost.output = {diagonal("--output-weight", call.outputs, model.outputs)};
  cost.input = {diagonal("--input-weight", call.inputs, model.inputs)};
  if (!call.rates.empty()) cost.input_rate = {diagonal("--input-rate-weight", call.rates, model.inputs)};
  if (!call.terminal.empty()) cost.terminal = diagonal("--terminal-weight", call.terminal, model.outputs);
  return cost;
}

struct Costs {
  ExpectedCost controlled, nominal;  // with the controller, and with the nominal inputs alone
};

// Empty if the model has no noise.
std::optional<Costs> costs_of(const Controller& controller, const Model& model) {
  if (!model.has(&Step::has_innovation_cov) && !(model.has(&Step::has_Q) && model.has(&Step::has_R)))
    return std::nullopt;
  Controller idle = controller;
  for (std::vector<Matrix>* gains : {&idle.K, &idle.L})
    for (Matrix& gain : *gains) gain.setZero();
  return Costs{expected_cost(controller, model, model), expected_cost(idle, model, model)};
}

std::string report(const Call& call, const Model& model, const Controller& controller,
                   const std::optional<Costs>& costs) {
  Page page;
  page.row("Model", describe(model));
  page.row("Steps", fmt::format("{} to {}", controller.begin, controller.end() - 1));
  page.row("Weights", fmt::format("outputs {}, inputs {}", list(call.outputs), list(call.inputs)));
  if (!call.rates.empty()) page.row("", fmt::format("input rates {}", list(call.rates)));
  if (!call.terminal.empty()) page.row("", fmt::format("outputs of the last step {} more", list(call.terminal)));
  if (costs) {
    const ExpectedCost& c = costs->controlled;
    page.row("Cost", fmt::format("{} expected with the observer: outputs {}, inputs {}{}", number(c.total()),
                                 number(c.outputs), number(c.inputs),
                                 call.rates.empty() ? "" : fmt::format(", input rates {}", number(c.input_rates))));
    page.row("", fmt::format("{} with the nominal inputs alone", number(costs->nominal.total())));
    if (c.presumes_zero_state)
      page.row(
          "",
          "This presumes that the observer begins with the state zero. Until it has estimated the state, the inputs are nominal.");
  } else {
    page.row("Cost", "not known, because the model has no noise");
  }
  page.row("Written", call.output.string());
  return page.text();
}

Json json_of(const ExpectedCost& cost) {
  return {{"outputs", cost.outputs},
          {"inputs", cost.inputs},
          {"input_rates", cost.input_rates},
          {"measurement_noise", cost.measurement_noise},
          {"total", cost.total()}};
}

Json json(const Call& call, const Controller& controller, const std::optional<Costs>& costs) {
  Json j;
  j["model"] = call.model.string();
  j["controller"] = call.output.string();
  j["begin"] = controller.begin;
  j["end"] = controller.end();
  j["output_weight"] = call.outputs;
  j["input_weight"] = call.inputs;
  j["input_rate_weight"] = call.rates;
  j["terminal_weight"] = call.terminal;
  j["expected_cost"] = costs ? json_of(costs->controlled) : Json();
  j["presumes_zero_state"] = costs ? Json(costs->controlled.presumes_zero_state) : Json();
  j["nominal_cost"] = costs ? json_of(costs->nominal) : Json();
  j["version"] = version;
  return j;
}

void run(const Call& call) {
  check_output(call.output, Content::controller, {call.model});
  const Model model = load_model(call.model);
  const CostWeights weights = cost_of(call, model);
  const Controller controller = about(call.model, [&] {
    return lqr(model, weights, {call.begin, call.end}).controller;
  });
  const std::optional<Costs> costs = about(call.model, [&] { return costs_of(controller, model); });
  save_controller(controller, call.output);
  if (call.json)
    print(json(call, controller, costs));
  else
    print(report(call, model, controller, costs));
}

}  // namespace

void add_lqr(CLI::App& tool) {
  const auto call = std::make_shared<Call>();
  constexpr Index most = 1'000'000'000;
  Command command(tool, "lqr", "Controller of the departures from the nominal trajectory",
                  "tokid lqr model.npz --output-weight 100,1 --input-weight 0.1 -o controller.h5");
  command.argument("MODEL", call->model, "Model: .npz, .h5 or .mat");
  command.output(call->output, "Controller to write: .npz, .h5 or .mat");
  add_weights(command, "--output-weight", call->outputs, "Weights of squared outputs, one or one for each (default 1)");
  add_weights(command, "--input-weight", call->inputs, "Weights of squared inputs, one or one for each (default 1)");
  add_weights(command, "--input-rate-weight", call->rates,
              "Weights of squared changes of the inputs from step to step (default none)");
  add_weights(command, "--terminal-weight", call->terminal,
              "Weights that are added to those of the outputs at the last step (default none)");
  command.number<Index>("--begin", call->begin, "K", "First step (default that of the model)", 0, most);
  command.number<Index>("--end", call->end, "K",
                        "Step after the last one (default that of the model; periodic models go on)", 1, most);
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] { run(*call); });
}

}  // namespace tokid::app
