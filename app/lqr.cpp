// tokid lqr: a model and weights → a controller of the departures from the nominal trajectory, and its closed loop.
// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <optional>

#include "command.hpp"
#include "common.hpp"
#include "control_rows.hpp"
#include "model/continuation.hpp"
#include "tokid/controller_file.hpp"
#include "weights.hpp"

namespace tokid::app {

namespace {

struct LqrCall {
  fs::path model, output, reference, simulated, truth;
  Weights outputs = {1.0}, inputs = {1.0}, rates, terminal, lower, upper;
  Index begin = -1, end = -1;
  SimulateControlOptions simulation = {.experiments = 100};
  bool json = false;
};

CostWeights cost_of(const LqrCall& call, const Model& model) {
  CostWeights cost;
  cost.output = {diagonal("--output-weight", call.outputs, model.outputs)};
  cost.input = {diagonal("--input-weight", call.inputs, model.inputs)};
  if (!call.rates.empty()) cost.input_rate = {diagonal("--input-rate-weight", call.rates, model.inputs)};
  if (!call.terminal.empty()) cost.terminal = diagonal("--terminal-weight", call.terminal, model.outputs);
  return cost;
}

// The wanted outputs of the steps begin … end-1 as departures from the nominal trajectory.
Matrix reference_of(const LqrCall& call, const Model& model, const Ensemble& wanted, Index begin, Index end) {
  if (wanted.steps() < end)
    throw std::invalid_argument(fmt::format("{}: {} found, {} needed, the end of the controller",
                                            call.reference.string(), plural(wanted.steps(), "step"), end));
  Matrix y = wanted.outputs_of(0).middleRows(begin, end - begin);
  for (Index k = begin; k < end; ++k) {
    if (!y.row(k - begin).allFinite())
      throw std::invalid_argument(
          fmt::format("{}: a missing output found at step {}, all outputs of the steps {} to {} needed",
                      call.reference.string(), k, begin, end - 1));
    subtract_nominal(model.y_nominal, nominal_row(model, model.y_nominal, k), y.row(k - begin));
  }
  return y;
}

Controller design(const LqrCall& call, const Model& model, const CostWeights& weights,
                  const std::optional<Ensemble>& wanted) {
  ControlOptions options{call.begin, call.end};
  const Index begin = call.begin < 0 ? model.k_begin : call.begin, end = call.end < 0 ? model.k_end() : call.end;
  const bool has_steps = begin < end && begin >= model.k_begin && has_step(model, end - 1);  // or lqr() refuses them
  if (wanted && has_steps) options.y_reference = reference_of(call, model, *wanted, begin, end);
  Controller controller = about(call.model, [&] { return lqr(model, weights, options).controller; });
  controller.model_name = call.model.filename().string();
  controller.predicted = about(call.model, [&] { return predicted_cost(controller, model); });
  return controller;
}

// The cost with the nominal inputs alone. Empty if the model has no noise.
std::optional<ExpectedCost> nominal_cost(const Controller& controller, const Model& model) {
  Controller idle = controller;
  for (std::vector<Matrix>* gains : {&idle.K, &idle.L})
    for (Matrix& gain : *gains) gain.setZero();
  idle.feedforward.resize(0, 0);
  return predicted_cost(idle, model);
}

Vector limits_of(const char* option, const Weights& limits, Index inputs) {
  return limits.empty() ? Vector() : Vector(diagonal(option, limits, inputs).diagonal());
}

// Differences of sample time, names and units between the model and the simulated system.
Findings differences_of_truth(const Model& model, const Model& truth) {
  Ensemble channels(1, 1, truth.inputs, truth.outputs, truth.dt);
  channels.dt_stated = truth.provenance.dt_stated;
  channels.names = truth.names;
  Findings found = differences(model, channels);
  for (Finding& finding : found) finding.detail = "truth";
  return found;
}

ClosedLoopSimulation simulate(const LqrCall& call, const Controller& controller, const Model& model,
                              const std::optional<Model>& truth) {
  SimulateControlOptions options = call.simulation;
  options.u_min = limits_of("--u-min", call.lower, model.inputs);
  options.u_max = limits_of("--u-max", call.upper, model.inputs);
  if (!truth) return about(call.model, [&] { return simulate_control(controller, model, model, options); });
  return about(call.truth, [&] { return simulate_control(controller, model, *truth, options); });
}

struct MeanCost {
  double mean, error;  // error: standard error of the mean; NaN for one experiment
};

MeanCost mean_of(const Vector& cost) {
  const double count = double(cost.size()), mean = cost.mean();
  return {mean, std::sqrt((cost.array() - mean).square().sum() / (count - 1) / count)};
}

std::string report(const LqrCall& call, const Model& model, const Controller& controller,
                   const std::optional<ExpectedCost>& nominal, const std::optional<ClosedLoopSimulation>& loop) {
  Page page;
  page.row("Model", describe(model));
  page.row("Steps", fmt::format("{} to {}", controller.begin, controller.end() - 1));
  add_weights_rows(page, controller.weights);
  if (!call.reference.empty()) page.row("Reference", call.reference.string());
  if (controller.predicted) {
    add_cost_rows(page, *controller.predicted, !call.rates.empty(), nominal);
  } else {
    page.row("Cost", "not known, because the model has no noise");
  }
  if (loop) {
    const MeanCost cost = mean_of(loop->cost);
    const std::string error = std::isnan(cost.error) ? "" : fmt::format(" ± {}", number(cost.error));
    page.row("Simulated",
             fmt::format("{} on {}: mean cost {}{}", plural(loop->cost.size(), "experiment"),
                         call.truth.empty() ? "the model" : call.truth.string(), number(cost.mean), error));
    page.row("", call.simulated.string());
  }
  page.row("Written", call.output.string());
  return page.text();
}

Json json(const LqrCall& call, const Controller& controller, const std::optional<ExpectedCost>& nominal,
          const std::optional<ClosedLoopSimulation>& loop, const Findings& findings) {
  const std::optional<ExpectedCost>& predicted = controller.predicted;
  Json j;
  j["model"] = call.model.string();
  j["controller"] = call.output.string();
  j["begin"] = controller.begin;
  j["end"] = controller.end();
  j["output_weight"] = call.outputs;
  j["input_weight"] = call.inputs;
  j["input_rate_weight"] = call.rates;
  j["terminal_weight"] = call.terminal;
  j["reference"] = call.reference.empty() ? Json() : Json(call.reference.string());
  j["expected_cost"] = predicted ? json_of(*predicted) : Json();
  j["presumes_zero_state"] = predicted ? Json(predicted->presumes_zero_state) : Json();
  j["nominal_cost"] = nominal ? json_of(*nominal) : Json();
  if (loop) {
    const MeanCost cost = mean_of(loop->cost);
    j["simulation"] = {{"data", call.simulated.string()},
                       {"truth", call.truth.empty() ? Json() : Json(call.truth.string())},
                       {"cost", numbers(loop->cost)},
                       {"mean_cost", cost.mean},
                       {"standard_error", cost.error}};
  } else {
    j["simulation"] = nullptr;
  }
  add_findings(j, findings);
  j["version"] = version;
  return j;
}

void run_lqr(const LqrCall& call) {
  check_output(call.output, Content::controller, {call.model, call.reference, call.truth});
  if (!call.simulated.empty())
    check_output(call.simulated, Content::ensemble, {call.model, call.reference, call.truth, call.output});
  const Model model = load_model(call.model);
  const CostWeights weights = cost_of(call, model);
  std::optional<Ensemble> wanted;
  if (!call.reference.empty()) wanted = load_reference(model, call.reference, {});
  const Controller controller = design(call, model, weights, wanted);
  const std::optional<ExpectedCost> nominal = about(call.model, [&] { return nominal_cost(controller, model); });
  std::optional<Model> truth;
  if (!call.truth.empty()) truth = load_model(call.truth);
  std::optional<ClosedLoopSimulation> loop;
  if (!call.simulated.empty()) {
    loop = simulate(call, controller, model, truth);
    save_ensemble(loop->data, call.simulated);
  }
  save_controller(controller, call.output);
  Findings findings = wanted ? differences(model, *wanted) : Findings();
  if (truth) append(findings, differences_of_truth(model, *truth));
  if (call.json)
    print(json(call, controller, nominal, loop, findings));
  else
    print(report(call, model, controller, nominal, loop));
  warn(findings);
}

}  // namespace

void add_lqr(CLI::App& tool) {
  const auto call = std::make_shared<LqrCall>();
  constexpr Index most = 1'000'000'000;
  Command command(tool, "lqr", "Design an LQR controller of the departures from the nominal trajectory",
                  "tokid lqr model.npz --output-weight 100,1 --input-weight 0.1 -o controller.h5");
  command.argument("MODEL", call->model, "Model: .npz, .h5 or .mat");
  command.output(call->output, "Controller to write: .npz, .h5 or .mat");
  add_weights(command, "--output-weight", call->outputs,
              "Weights of squared outputs, one for all outputs, or one for each (default 1)");
  add_weights(command, "--input-weight", call->inputs,
              "Weights of squared inputs, one for all inputs, or one for each (default 1)");
  add_weights(command, "--input-rate-weight", call->rates,
              "Weights of squared changes of the inputs from step to step (default none)");
  add_weights(command, "--terminal-weight", call->terminal,
              "Weights that are added to the weights of the outputs at the last step (default none)");
  command.number<Index>("--begin", call->begin, "K",
                        "First step of the controller (default: the first step of the model)", 0, most);
  command.number<Index>(
      "--end", call->end, "K",
      "Step after the last step of the controller (default: after the last step of the model; periodic models go on)",
      1, most);
  command.file("--reference", call->reference,
               "Ensemble of one experiment with the wanted outputs; its inputs do not matter");
  command.file("--simulate", call->simulated, "Ensemble to write: simulated experiments of the closed loop");
  command.file("--truth", call->truth, "Model of the system that is simulated (default MODEL)");
  command.number<Index>("--experiments", call->simulation.experiments, "N",
                        "Number of simulated experiments (default 100)", 1, 1'000'000);
  command.number<std::uint64_t>("--seed", call->simulation.seed, "S", "Seed of the simulated noise (default 1)", 0);
  command.flag(
      "--no-noise", [call] { call->simulation.noise = false; }, "Simulate without noise, from the mean initial state");
  add_limits(command, "--u-min", call->lower,
             "Smallest simulated inputs, one for all inputs, or one for each (default none)");
  add_limits(command, "--u-max", call->upper,
             "Largest simulated inputs, one for all inputs, or one for each (default none)");
  for (const char* option : {"--truth", "--experiments", "--seed", "--no-noise", "--u-min", "--u-max"})
    command.needs(option, "--simulate");
  command.flag("--json", call->json, "Print one JSON object");
  command.runs([call] { run_lqr(*call); });
}

}  // namespace tokid::app
