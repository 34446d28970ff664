// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/cross_validate.hpp"

#include "call.hpp"
#include "results.hpp"

namespace tokid::python {

RESULT(Fold, "Fold", FIELD(experiments),
       Field("experiment_names", s.experiment_names.empty() ? std::nullopt : std::optional(s.experiment_names)),
       FIELD(states), FIELD(lags), FIELD(simulation), FIELD(one_step), FIELD(horizon), FIELD(findings))
RESULT(CrossValidation, "CrossValidation", FIELD(folds), FIELD(simulation), FIELD(one_step), FIELD(horizon),
       FIELD(simulation_spread), FIELD(one_step_spread), FIELD(horizon_spread), Field("findings", remarks(s)))

void bind_cross_validate(nb::module_& module) {
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
