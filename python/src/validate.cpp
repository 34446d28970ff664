// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/validate.hpp"

#include "call.hpp"
#include "results.hpp"

namespace tokid::python {

void bind_validate(nb::module_& module) {
  module.def(
      "validate",
      [](const Model& model, const Ensemble& data, Index horizon, Index whiteness_lags,
         std::optional<InitialState> initial_state) {
        Validation result = without_gil([&] {
          return validate_distinct(model, data, {horizon, whiteness_lags, initial_state});
        });
        append(result.findings, differences(model, data));
        return object_of(result, model.names);
      },
      nb::arg("model"), nb::arg("data"), nb::arg("horizon"), nb::arg("whiteness_lags"),
      nb::arg("initial_state").none());
}

}  // namespace tokid::python
