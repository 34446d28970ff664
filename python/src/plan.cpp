// SPDX-License-Identifier: BSD-3-Clause
#include "arrays.hpp"
#include "call.hpp"
#include "results.hpp"
#include "tokid/design.hpp"

namespace tokid::python {

namespace {

nb::tuple planned(const Model* model, PlanOptions options, int threads, nb::object listener) {
  Call call(std::move(listener));
  options.execution = call.execution(threads);
  ExperimentPlan s = call.run([&] { return model ? plan(*model, options) : plan(options); });
  const nb::dict fields =
      dict_of({FIELD(lags), FIELD(unknowns), FIELD(minimum), FIELD(recommended), FIELD(reasons), FIELD(kind),
               FIELD(peak), FIELD(rms), FIELD(first_step), FIELD(excess), FIELD(input_condition), FIELD(first_forecast),
               FIELD(condition), FIELD(rank), FIELD(start_condition), FIELD(output_peak), FIELD(noise_floor),
               FIELD(markov_error), FIELD(findings)});
  return nb::make_tuple(std::move(s.inputs), fields);
}

}  // namespace

void bind_plan(nb::module_& module) {
  nb::enum_<InputKind>(module, "InputKind")
      .value("orthogonal", InputKind::orthogonal)
      .value("gaussian", InputKind::gaussian)
      .value("binary", InputKind::binary)
      .value("multisine", InputKind::multisine)
      .value("optimised", InputKind::optimised);
  nb::class_<PlanOptions> options(module, "PlanOptions", "The options of a plan, as the library has them.");
  def_channels(options);
  options.def(nb::init<>())
      .def_rw("states", &PlanOptions::states)
      .def_rw("inputs", &PlanOptions::inputs)
      .def_rw("outputs", &PlanOptions::outputs)
      .def_rw("steps", &PlanOptions::steps)
      .def_rw("lags", &PlanOptions::lags)
      .def_rw("experiments", &PlanOptions::experiments)
      .def_rw("kind", &PlanOptions::kind, nb::for_setter(nb::arg().none()))
      .def_rw("amplitude", &PlanOptions::amplitude)
      .def_prop_rw(
          "noise",
          [](const PlanOptions& o) {
            return o.noise ? std::optional(std::pair(o.noise->input, o.noise->output)) : std::nullopt;
          },
          [](PlanOptions& o, std::optional<std::pair<double, double>> noise) {
            o.noise = noise ? std::optional(NoiseLevel{noise->first, noise->second}) : std::nullopt;
          },
          nb::for_setter(nb::arg().none()))
      .def_rw("initial_state", &PlanOptions::initial_state, nb::for_setter(nb::arg().none()))
      .def_rw("nominal", &PlanOptions::nominal)
      .def_rw("excess", &PlanOptions::excess)
      .def_rw("markov_error", &PlanOptions::markov_error)
      .def_rw("white_condition", &PlanOptions::white_condition)
      .def_rw("hold", &PlanOptions::hold)
      .def_rw("iterations", &PlanOptions::iterations)
      .def_rw("dt", &PlanOptions::dt)
      .def_rw("seed", &PlanOptions::seed);
  module.def("plan", &planned, nb::arg("model").none(), nb::arg("options"), nb::arg("threads"),
             nb::arg("listener").none());
}

}  // namespace tokid::python
