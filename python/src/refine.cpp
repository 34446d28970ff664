// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/refine_model.hpp"

#include "arrays.hpp"
#include "call.hpp"
#include "results.hpp"

namespace tokid::python {

namespace {

nb::any object_of(const RefinementFigures& f) {
  return make("RefinementFigures", {{"simulation", python::object_of(f.simulation)},
                                    {"one_step", python::object_of(f.one_step)},
                                    {"whiteness_p", f.whiteness_p}});
}

nb::any object_of(const RefinedModel& refined) {
  const Refinement& r = refined.refinement;
  return make(
      "Refinement",
      {{"smoothing", refined.smoothing},
       {"reason", refined.reason},
       {"choice", refined.choice.smoothing.empty() ? nb::none() : nb::object(python::object_of(refined.choice))},
       {"start_log_likelihood", r.start_log_likelihood},
       {"log_likelihood", r.log_likelihood},
       {"penalised", r.penalised},
       {"iterations", r.iterations},
       {"converged", r.converged},
       {"noise_segments", r.noise_segments},
       {"before", object_of(refined.before)},
       {"after", object_of(refined.after)},
       {"findings", list_of(refined.findings)}});
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
        return array_of(call.run([&] { return log_likelihoods(model, data, execution); }));
      },
      nb::arg("model"), nb::arg("data"), nb::kw_only(), nb::arg("threads"), nb::arg("listener").none());
}

}  // namespace tokid::python
