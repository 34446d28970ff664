// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/cross_validate.hpp"

#include "call.hpp"
#include "results.hpp"

namespace tokid::python {

namespace {

nb::any object_of(const Fold& f) {
  return make("Fold", {{"experiments", f.experiments},
                       {"experiment_names",
                        f.experiment_names.empty() ? nb::object(nb::none()) : nb::object(texts(f.experiment_names))},
                       {"states", f.states},
                       {"lags", f.lags},
                       {"simulation", python::object_of(f.simulation)},
                       {"one_step", python::object_of(f.one_step)},
                       {"horizon", python::object_of(f.horizon)},
                       {"findings", list_of(f.findings)}});
}

nb::any object_of(const CrossValidation& c) {
  nb::list folds;
  for (const Fold& fold : c.folds) folds.append(object_of(fold));
  return make("CrossValidation", {{"folds", nb::object(folds)},
                                  {"simulation", python::object_of(c.simulation)},
                                  {"one_step", python::object_of(c.one_step)},
                                  {"horizon", python::object_of(c.horizon)},
                                  {"simulation_spread", c.simulation_spread},
                                  {"one_step_spread", c.one_step_spread},
                                  {"horizon_spread", c.horizon_spread},
                                  {"findings", list_of(remarks(c))}});
}

}  // namespace

void bind_cross_validate(nb::module_& module) {
  module.def(
      "cross_validate",
      [](const Ensemble& data, IdentifyOptions identify, Index folds, Index horizon, std::optional<std::uint64_t> seed,
         Index first_step, int threads, nb::object listener) {
        Call call(std::move(listener));
        identify.execution = call.execution(threads);
        const CrossValidateOptions options{folds, horizon, seed, first_step};
        return object_of(call.run([&] { return cross_validate(data, identify, options); }));
      },
      nb::arg("data"), nb::arg("options"), nb::kw_only(), nb::arg("folds"), nb::arg("horizon"), nb::arg("seed").none(),
      nb::arg("first_step"), nb::arg("threads"), nb::arg("listener").none());
}

}  // namespace tokid::python
