// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/control.hpp"

#include "call.hpp"
#include "results.hpp"
#include "tokid/controller_file.hpp"
#include "tokid/deploy.hpp"
#include "tokid/learning.hpp"
#include "tokid/online_observer.hpp"

namespace tokid::python {

RESULT(Observation, "Observation", FIELD(prediction), FIELD(innovation), FIELD(normalised_square), FIELD(outputs))
RESULT(ExpectedCost, "ExpectedCost", FIELD(outputs), FIELD(inputs), FIELD(input_rates), FIELD(measurement_noise),
       FIELD(presumes_zero_state))
RESULT(Operations, "Operations", FIELD(multiplications), FIELD(additions), FIELD(divisions))
RESULT(DeployedCode, "ExportedCode", FIELD(name), FIELD(table_bytes), FIELD(state_bytes), FIELD(stored_steps),
       FIELD(step), FIELD(step_missing), FIELD(control))
RESULT(LearnedRun, "LearnedRun", FIELD(u), FIELD(predicted), FIELD(error), FIELD(predicted_error))

namespace {

using Matrices = std::vector<Matrix>;

// (S × r); zero without references
Matrix feedforward_of(const Controller& controller) {
  if (controller.feedforward.size() > 0) return controller.feedforward;
  return Matrix::Zero(controller.u_nominal.rows(), controller.u_nominal.cols());
}

void bind_observer(nb::module_& module) {
  nb::class_<OnlineObserver>(module, "OnlineObserver", "The observer of the library; tokid.Observer is what users see.")
      .def("__init__",
           [](OnlineObserver* self, const Model& model, std::optional<InitialState> initial_state,
              bool initial_estimate, bool samples_missing, const std::optional<Vector>& input_square) {
             new (self) OnlineObserver(
                 model, {initial_state, initial_estimate, samples_missing, input_square.value_or(Vector())});
           })
      .def("step", [](OnlineObserver& observer, const Vector& u, const Vector& y) { return observer.step(u, y); })
      .def_prop_ro("k", &OnlineObserver::k)
      .def_prop_ro("knows_state", &OnlineObserver::knows_state)
      .def_prop_ro("state", &OnlineObserver::state)
      .def("predict", [](const OnlineObserver& observer, const Matrix& u) { return observer.predict(u); })
      .def("reset", &OnlineObserver::reset)
      .def("saved",
           [](const OnlineObserver& observer) {
             const std::string bytes = observer.saved();
             return nb::bytes(bytes.data(), bytes.size());
           })
      .def("restore", [](OnlineObserver& observer, const nb::bytes& bytes) {
        observer.restore({static_cast<const char*>(bytes.data()), bytes.size()});
      });
}

// The expected cost with the observer and the noise of this model, which may differ from those of the file that the
// controller came from. Empty if the model has no noise, or if the controller does not belong to it.
std::optional<ExpectedCost> cost_to_store(const Controller& controller, const Model& model) {
  try {
    return predicted_cost(controller, model);
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
}

void bind_controller(nb::module_& module) {
  nb::class_<Lqr>(module, "Lqr", "A controller of the library; tokid.Controller is what users see of it.")
      .def_prop_ro("begin", [](const Lqr& lqr) { return lqr.controller.begin; })
      .def_prop_ro("end", [](const Lqr& lqr) { return lqr.controller.end(); })
      .def_prop_ro("dt", [](const Lqr& lqr) { return lqr.controller.dt; })
      .def_prop_ro("K", [](const Lqr& lqr) { return lqr.controller.K; })
      .def_prop_ro("L", [](const Lqr& lqr) { return lqr.controller.L; })
      .def_prop_ro("feedforward", [](const Lqr& lqr) { return feedforward_of(lqr.controller); })
      .def_prop_ro("u_nominal", [](const Lqr& lqr) { return lqr.controller.u_nominal; })
      .def_prop_ro("y_nominal", [](const Lqr& lqr) { return lqr.controller.y_nominal; })
      .def("input", [](const Lqr& lqr, Index k, const Vector& x,
                       const Vector& u_last) { return lqr.controller.input(k, x, u_last); })
      .def_prop_ro("cost_to_go", [](const Lqr& lqr) { return lqr.cost_to_go.P; })
      .def("set_cost_to_go", [](Lqr& lqr, std::vector<Matrix> P) { lqr.cost_to_go.P = std::move(P); })
      .def("save",
           [](const Lqr& lqr, const Model& model, const std::filesystem::path& path, bool mat73) {
             without_gil([&] {
               Controller saved = lqr.controller;
               saved.predicted = cost_to_store(saved, model);
               save_controller(saved, path, {mat73});
               return 0;
             });
           })
      .def("expected_cost",
           [](const Lqr& lqr, const Model& model, const Model& truth) {
             return without_gil([&] { return expected_cost(lqr.controller, model, truth); });
           })
      .def("simulate",
           [](const Lqr& lqr, const Model& model, const Model& truth, Index experiments, std::uint64_t seed, bool noise,
              const std::optional<Vector>& u_min, const std::optional<Vector>& u_max, const std::optional<Matrix>& x0) {
             const SimulateControlOptions options{
                 experiments, seed, noise, u_min.value_or(Vector()), u_max.value_or(Vector()), x0.value_or(Matrix())};
             ClosedLoopSimulation found =
                 without_gil([&] { return simulate_control(lqr.controller, model, truth, options); });
             return std::pair(std::move(found.data), std::move(found.cost));
           });
  module.def("load_controller", [](const std::filesystem::path& path) {
    return without_gil([&] { return Lqr{load_controller(path), {}}; });
  });
  module.def("lqr", [](const Model& model, const Matrices& output, const Matrices& input, const Matrices& input_rate,
                       const std::optional<Matrix>& terminal, Index begin, Index end,
                       const std::optional<Matrix>& y_reference, const std::optional<Matrix>& u_reference) {
    const CostWeights weights{output, input, input_rate, terminal.value_or(Matrix())};
    const ControlOptions options{begin, end, y_reference.value_or(Matrix()), u_reference.value_or(Matrix())};
    return without_gil([&] { return lqr(model, weights, options); });
  });
}

void bind_export(nb::module_& module) {
  module.def(
      "export_c",
      [](const Model& model, const std::filesystem::path& path, const Lqr* controller, const std::string& name,
         bool single_precision, bool start_from_zero) {
        const DeployOptions options{name, {}, single_precision, start_from_zero};
        return without_gil(
            [&] { return save_deployed(model, path, options, controller ? &controller->controller : nullptr); });
      },
      nb::arg("model"), nb::arg("path"), nb::arg("controller").none(), nb::arg("name"), nb::arg("single_precision"),
      nb::arg("start_from_zero"));
}

void bind_learning(nb::module_& module) {
  nb::class_<LiftedMap>(module, "LiftedMap", "The lifted map of the library; tokid.LiftedMap is what users see of it.")
      .def(nb::init<const Model&, Index, Index>())
      .def_prop_ro("begin", &LiftedMap::begin)
      .def_prop_ro("steps", &LiftedMap::steps)
      .def_prop_ro("inputs", &LiftedMap::inputs)
      .def_prop_ro("outputs", &LiftedMap::outputs)
      .def("product", [](const LiftedMap& map, const Matrix& u) { return map.product(u); })
      .def("transposed_product", [](const LiftedMap& map, const Matrix& y) { return map.transposed_product(y); })
      .def("dense", [](const LiftedMap& map) { return without_gil([&] { return map.dense(); }); });
  module.def(
      "learn", [](const Model& model, const Matrix& reference, const Matrix& u, const Matrix& y, const Matrices& error,
                  const Matrices& input, const Matrices& input_change, const Matrices& input_rate) {
        return without_gil([&] { return learn(model, reference, u, y, {error, input, input_change, input_rate}); });
      });
}

}  // namespace

void bind_control(nb::module_& module) {
  bind_observer(module);
  bind_controller(module);
  bind_export(module);
  bind_learning(module);
}

}  // namespace tokid::python
