// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/refine_model.hpp"

#include "call.hpp"
#include "results.hpp"

namespace tokid::python {

RESULT(RefinementFigures, "RefinementFigures", FIELD(simulation), FIELD(one_step), FIELD(whiteness_p))

namespace {

nb::object object_of(const RefinedModel& refined) {
  const Refinement& s = refined.refinement;
  return make("Refinement",
              {Field("smoothing", refined.smoothing), Field("reason", refined.reason),
               Field("choice", refined.choice.smoothing.empty() ? std::nullopt : std::optional(refined.choice)),
               FIELD(start_log_likelihood), FIELD(log_likelihood), FIELD(penalised), FIELD(iterations),
               FIELD(converged), FIELD(noise_segments), Field("before", refined.before), Field("after", refined.after),
               Field("findings", refined.findings)});
}

nb::tuple refined(const Model& model, const Ensemble& data, std::optional<double> smoothing,
                  std::optional<Index> period, std::optional<bool> feedthrough, Index iterations, double tolerance,
                  std::optional<InitialState> initial_state, bool accelerate, bool warm_up, int threads,
                  nb::object listener) {
  Call call(std::move(listener));
  RefineModelOptions options;
  options.smoothing = smoothing;
  options.refine.period = period;
  options.feedthrough = feedthrough;
  options.refine.iterations = iterations;
  options.refine.tolerance = tolerance;
  options.refine.initial_state = initial_state;
  options.refine.accelerate = accelerate;
  options.refine.warm_up = warm_up;
  options.refine.execution = call.execution(threads);
  RefinedModel result = call.run([&] { return refine_model(model, data, options); });
  nb::object evidence = object_of(result);
  return nb::make_tuple(std::move(result.refinement.model), evidence);
}

}  // namespace

void bind_refine(nb::module_& module) {
  module.def("refine", &refined, nb::arg("model"), nb::arg("data"), nb::kw_only(), nb::arg("smoothing").none(),
             nb::arg("period").none(), nb::arg("feedthrough").none(), nb::arg("iterations"), nb::arg("tolerance"),
             nb::arg("initial_state").none(), nb::arg("accelerate"), nb::arg("warm_up"), nb::arg("threads"),
             nb::arg("listener").none());
  module.def(
      "log_likelihoods",
      [](const Model& model, const Ensemble& data, int threads, nb::object listener) {
        Call call(std::move(listener));
        const Execution execution = call.execution(threads);
        return call.run([&] { return log_likelihoods(model, data, execution); });
      },
      nb::arg("model"), nb::arg("data"), nb::kw_only(), nb::arg("threads"), nb::arg("listener").none());
}

}  // namespace tokid::python
