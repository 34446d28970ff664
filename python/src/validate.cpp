// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include "call.hpp"
#include "results.hpp"

namespace tokid::python {

void bind_validate(nb::module_& module) {
  module.def(
      "validate",
      [](const Model& model, const Ensemble& data, Index horizon, Index whiteness_lags,
         std::optional<InitialState> initial_state, Index first_step) {
        const ValidateOptions options{horizon, whiteness_lags, initial_state, {}, first_step};
        Validation result = without_gil([&] { return validate_distinct(model, data, options); });
        append(result.findings, differences(model, data));
        return NamedValidation(result, model.names);
      },
      nb::arg("model"), nb::arg("data"), nb::arg("horizon"), nb::arg("whiteness_lags"), nb::arg("initial_state").none(),
      nb::arg("first_step"));
  module.def(
      "experiment_fits",
      [](const Model& model, const Ensemble& data, std::optional<InitialState> initial_state, Index first_step) {
        ValidateOptions options;
        options.initial_state = initial_state;
        options.first_step = first_step;
        return without_gil([&] { return experiment_fits(model, data, options); });
      },
      nb::arg("model"), nb::arg("data"), nb::arg("initial_state").none(), nb::arg("first_step"));
}

}  // namespace tokid::python
