// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include "call.hpp"
#include "results.hpp"
#include "tokid/cross_validate.hpp"

namespace tokid::python {

RESULT(Fold, "Fold", FIELD(experiments),
       Field("experiment_names", s.experiment_names.empty() ? std::nullopt : std::optional(s.experiment_names)),
       FIELD(states), FIELD(lags), FIELD(simulation), FIELD(one_step), FIELD(horizon), FIELD(findings))
RESULT(CrossValidation, "CrossValidation", FIELD(folds), FIELD(simulation), FIELD(one_step), FIELD(horizon),
       FIELD(simulation_spread), FIELD(one_step_spread), FIELD(horizon_spread), Field("findings", remarks(s)))

void bind_validate(nb::module_& module) {
  module.def("validate", [](const Model& model, const Ensemble& data, Index horizon, Index whiteness_lags,
                            std::optional<InitialState> initial_state, Index first_step) {
    const ValidateOptions options{horizon, whiteness_lags, initial_state, {}, first_step};
    Validation result = without_gil([&] { return validate_distinct(model, data, options); });
    append(result.findings, differences(model, data));
    return NamedValidation(result, model.names);
  });
  module.def("experiment_fits",
             [](const Model& model, const Ensemble& data, std::optional<InitialState> initial_state, Index first_step) {
               ValidateOptions options;
               options.initial_state = initial_state;
               options.first_step = first_step;
               return without_gil([&] { return experiment_fits(model, data, options); });
             });
  module.def(
      "cross_validate",
      [](const Ensemble& data, IdentifyOptions identify, Index folds, Index horizon, std::optional<std::uint64_t> seed,
         Index first_step, int threads, nb::object listener) {
        Call call(std::move(listener));
        identify.execution = call.execution(threads);
        const CrossValidateOptions options{folds, horizon, seed, first_step};
        return call.run([&] { return cross_validate(data, identify, options); });
      },
      nb::arg("data"), nb::arg("options"), nb::kw_only(), nb::arg("folds"), nb::arg("horizon"), nb::arg("seed").none(),
      nb::arg("first_step"), nb::arg("threads"), nb::arg("listener").none());
}

}  // namespace tokid::python
