// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/control.hpp"

#include "arrays.hpp"
#include "call.hpp"
#include "tokid/controller_file.hpp"
#include "tokid/deploy.hpp"
#include "tokid/learning.hpp"
#include "tokid/online_observer.hpp"

namespace tokid::python {

namespace {

std::vector<Matrix> matrices_of(const std::vector<AnyArray>& arrays) {
  std::vector<Matrix> matrices;
  matrices.reserve(arrays.size());
  for (const AnyArray& array : arrays) matrices.push_back(matrix_of(array));
  return matrices;
}

Matrix matrix_or_empty(const std::optional<AnyArray>& array) { return array ? matrix_of(*array) : Matrix(); }
Vector vector_or_empty(const std::optional<AnyArray>& array) { return array ? vector_of(*array) : Vector(); }

nb::list arrays_of(const std::vector<Matrix>& matrices) {
  nb::list list;
  for (const Matrix& matrix : matrices) list.append(array_of(Matrix(matrix)));
  return list;
}

// (S × r); zero without references
Matrix feedforward_of(const Controller& controller) {
  if (controller.feedforward.size() > 0) return controller.feedforward;
  return Matrix::Zero(controller.u_nominal.rows(), controller.u_nominal.cols());
}

void bind_observer(nb::module_& module) {
  nb::class_<OnlineObserver>(module, "OnlineObserver", "The observer of the library; tokid.Observer is what users see.")
      .def(
          "__init__",
          [](OnlineObserver* self, const Model& model, std::optional<InitialState> initial_state, bool initial_estimate,
             bool samples_missing, const std::optional<AnyArray>& input_square) {
            new (self) OnlineObserver(
                model, {initial_state, initial_estimate, samples_missing, vector_or_empty(input_square)});
          },
          nb::arg("model"), nb::arg("initial_state").none(), nb::arg("initial_estimate"), nb::arg("samples_missing"),
          nb::arg("input_square").none())
      .def("step",
           [](OnlineObserver& observer, const AnyArray& u, const AnyArray& y) {
             const Observation& shown = observer.step(vector_of(u), vector_of(y));
             return nb::make_tuple(array_of(Vector(shown.prediction)), array_of(Vector(shown.innovation)),
                                   shown.normalised_square, shown.outputs);
           })
      .def_prop_ro("k", &OnlineObserver::k)
      .def_prop_ro("knows_state", &OnlineObserver::knows_state)
      .def_prop_ro(
          "state", [](const OnlineObserver& observer) { return array_of(observer.state()); }, nb::rv_policy::move)
      .def("predict",
           [](const OnlineObserver& observer, const AnyArray& u) { return array_of(observer.predict(matrix_of(u))); })
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
  nb::class_<ExpectedCost>(module, "ExpectedCost", "The parts of an expected cost.")
      .def_ro("outputs", &ExpectedCost::outputs)
      .def_ro("inputs", &ExpectedCost::inputs)
      .def_ro("input_rates", &ExpectedCost::input_rates)
      .def_ro("measurement_noise", &ExpectedCost::measurement_noise)
      .def_ro("presumes_zero_state", &ExpectedCost::presumes_zero_state);

  nb::class_<Lqr>(module, "Lqr", "A controller of the library; tokid.Controller is what users see of it.")
      .def_prop_ro("begin", [](const Lqr& lqr) { return lqr.controller.begin; })
      .def_prop_ro("end", [](const Lqr& lqr) { return lqr.controller.end(); })
      .def_prop_ro("dt", [](const Lqr& lqr) { return lqr.controller.dt; })
      .def_prop_ro("K", [](const Lqr& lqr) { return arrays_of(lqr.controller.K); })
      .def_prop_ro("L", [](const Lqr& lqr) { return arrays_of(lqr.controller.L); })
      .def_prop_ro(
          "feedforward", [](const Lqr& lqr) { return array_of(feedforward_of(lqr.controller)); }, nb::rv_policy::move)
      .def_prop_ro(
          "u_nominal", [](const Lqr& lqr) { return array_of(Matrix(lqr.controller.u_nominal)); }, nb::rv_policy::move)
      .def_prop_ro(
          "y_nominal", [](const Lqr& lqr) { return array_of(Matrix(lqr.controller.y_nominal)); }, nb::rv_policy::move)
      .def("input",
           [](const Lqr& lqr, Index k, const AnyArray& x, const AnyArray& u_last) {
             return array_of(lqr.controller.input(k, vector_of(x), vector_of(u_last)));
           })
      .def_prop_ro("cost_to_go", [](const Lqr& lqr) { return arrays_of(lqr.cost_to_go.P); })
      .def("set_cost_to_go", [](Lqr& lqr, const std::vector<AnyArray>& P) { lqr.cost_to_go.P = matrices_of(P); })
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
      .def(
          "simulate",
          [](const Lqr& lqr, const Model& model, const Model& truth, Index experiments, std::uint64_t seed, bool noise,
             const std::optional<AnyArray>& u_min, const std::optional<AnyArray>& u_max,
             const std::optional<AnyArray>& x0) {
            const SimulateControlOptions options{
                experiments, seed, noise, vector_or_empty(u_min), vector_or_empty(u_max), matrix_or_empty(x0)};
            ClosedLoopSimulation found =
                without_gil([&] { return simulate_control(lqr.controller, model, truth, options); });
            return nb::make_tuple(std::move(found.data), array_of(std::move(found.cost)));
          },
          nb::arg("model"), nb::arg("truth"), nb::arg("experiments"), nb::arg("seed"), nb::arg("noise"),
          nb::arg("u_min").none(), nb::arg("u_max").none(), nb::arg("x0").none());
  module.def("load_controller", [](const std::filesystem::path& path) {
    return without_gil([&] { return Lqr{load_controller(path), {}}; });
  });
  module.def(
      "lqr",
      [](const Model& model, const std::vector<AnyArray>& output, const std::vector<AnyArray>& input,
         const std::vector<AnyArray>& input_rate, const std::optional<AnyArray>& terminal, Index begin, Index end,
         const std::optional<AnyArray>& y_reference, const std::optional<AnyArray>& u_reference) {
        const CostWeights weights{matrices_of(output), matrices_of(input), matrices_of(input_rate),
                                  matrix_or_empty(terminal)};
        const ControlOptions options{begin, end, matrix_or_empty(y_reference), matrix_or_empty(u_reference)};
        return without_gil([&] { return lqr(model, weights, options); });
      },
      nb::arg("model"), nb::arg("output"), nb::arg("input"), nb::arg("input_rate"), nb::arg("terminal").none(),
      nb::arg("begin"), nb::arg("end"), nb::arg("y_reference").none(), nb::arg("u_reference").none());
}

nb::tuple counts(const Operations& operations) {
  return nb::make_tuple(operations.multiplications, operations.additions, operations.divisions);
}

void bind_export(nb::module_& module) {
  module.def(
      "export_c",
      [](const Model& model, const std::filesystem::path& path, const Lqr* controller, const std::string& name,
         bool single_precision, bool start_from_zero) {
        const DeployOptions options{name, {}, single_precision, start_from_zero};
        const DeployedCode code = without_gil(
            [&] { return save_deployed(model, path, options, controller ? &controller->controller : nullptr); });
        return nb::make_tuple(code.name, code.table_bytes, code.state_bytes, code.stored_steps, counts(code.step),
                              counts(code.step_missing), counts(code.control));
      },
      nb::arg("model"), nb::arg("path"), nb::arg("controller").none(), nb::arg("name"), nb::arg("single_precision"),
      nb::arg("start_from_zero"));
}

void bind_learning(nb::module_& module) {
  nb::class_<LiftedMap>(module, "LiftedMap", "The lifted map of the library; tokid.LiftedMap is what users see of it.")
      .def(nb::init<const Model&, Index, Index>(), nb::arg("model"), nb::arg("begin"), nb::arg("end"))
      .def_prop_ro("begin", &LiftedMap::begin)
      .def_prop_ro("steps", &LiftedMap::steps)
      .def_prop_ro("inputs", &LiftedMap::inputs)
      .def_prop_ro("outputs", &LiftedMap::outputs)
      .def("product", [](const LiftedMap& map, const AnyArray& u) { return array_of(map.product(matrix_of(u))); })
      .def("transposed_product",
           [](const LiftedMap& map, const AnyArray& y) { return array_of(map.transposed_product(matrix_of(y))); })
      .def("dense", [](const LiftedMap& map) { return array_of(without_gil([&] { return map.dense(); })); });
  module.def(
      "learn",
      [](const Model& model, const AnyArray& reference, const AnyArray& u, const AnyArray& y,
         const std::vector<AnyArray>& error, const std::vector<AnyArray>& input,
         const std::vector<AnyArray>& input_change, const std::vector<AnyArray>& input_rate) {
        const LearningWeights weights{matrices_of(error), matrices_of(input), matrices_of(input_change),
                                      matrices_of(input_rate)};
        const Matrix wanted = matrix_of(reference), last_u = matrix_of(u), last_y = matrix_of(y);
        LearnedRun found = without_gil([&] { return learn(model, wanted, last_u, last_y, weights); });
        return nb::make_tuple(array_of(std::move(found.u)), array_of(std::move(found.predicted)),
                              array_of(std::move(found.error)), array_of(std::move(found.predicted_error)));
      },
      nb::arg("model"), nb::arg("reference"), nb::arg("u"), nb::arg("y"), nb::arg("error"), nb::arg("input"),
      nb::arg("input_change"), nb::arg("input_rate"));
}

}  // namespace

void bind_control(nb::module_& module) {
  bind_observer(module);
  bind_controller(module);
  bind_export(module);
  bind_learning(module);
}

}  // namespace tokid::python
