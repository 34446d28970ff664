// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/modes.hpp"

#include <optional>

#include "arrays.hpp"
#include "call.hpp"
#include "model/continuation.hpp"
#include "results.hpp"

namespace tokid::python {

RESULT(Interval, "Interval", FIELD(estimate), FIELD(deviation), FIELD(lower), FIELD(upper))

namespace {

nb::object columns(const Interval& all) {
  const auto column = [](const Matrix& values) { return Vector(values.reshaped()); };
  return make("Interval", {{"estimate", column(all.estimate)},
                           {"deviation", column(all.deviation)},
                           {"lower", column(all.lower)},
                           {"upper", column(all.upper)}});
}

nb::any object_of(const Modes& s, const Model& model, const std::optional<ModeBounds>& bounds) {
  const nb::object none = nb::none();
  const auto shape = [&](Index k, Index j, Index i) { return s.shapes[size_t(k)](j, i); };
  const std::optional<Floquet> period = goes_on(model) ? std::optional(floquet(model)) : std::nullopt;
  const auto of_period = [&](auto member) { return period ? python::object_of((*period).*member) : none; };
  const auto bound = [&](Interval ModeBounds::*member) { return bounds ? python::object_of((*bounds).*member) : none; };
  const auto bound_of_period = [&](Interval ModeBounds::*member) {
    return bounds && period ? columns((*bounds).*member) : none;
  };
  return make("Modes", {FIELD(begin),
                        FIELD(dt),
                        FIELD(window),
                        FIELD(slow),
                        FIELD(poles),
                        Field("frequency", natural_frequencies(s)),
                        Field("damping", damping_ratios(s)),
                        Field("shapes", nb::cast(array_of_entries(shape, s.steps(), model.outputs, s.count()))),
                        FIELD(variation),
                        FIELD(window_change),
                        FIELD(valid),
                        Field("multipliers", of_period(&Floquet::multipliers)),
                        Field("multipliers_error", of_period(&Floquet::error)),
                        Field("exponents", of_period(&Floquet::exponents)),
                        Field("level", bounds ? nb::cast(bounds->level) : none),
                        Field("frequency_bounds", bound(&ModeBounds::frequency)),
                        Field("damping_bounds", bound(&ModeBounds::damping)),
                        Field("exponents_real_bounds", bound_of_period(&ModeBounds::exponents_real)),
                        Field("exponents_imag_bounds", bound_of_period(&ModeBounds::exponents_imag)),
                        Field("findings", bounds ? bounds->findings : Findings())});
}

nb::any modes_of_model(const Model& model, const Ensemble* data, Index window, double slow, double level,
                       Index replicates, std::uint64_t seed, int threads, nb::object listener) {
  Call call(std::move(listener));
  const ModesOptions options{window, slow, {threads, {}}};
  ConfidenceOptions confidence{.level = level, .execution = call.execution(threads)};
  confidence.replicates = replicates;
  confidence.seed = seed;
  std::optional<ModeBounds> bounds;
  Modes found;
  call.run([&] {
    if (data != nullptr)
      bounds = mode_bounds(model, *data, options, confidence);
    else
      found = modes(model, options);
  });
  return object_of(bounds ? bounds->modes : found, model, bounds);
}

// `function` maps a model to a list of numbers. Its exceptions reach the caller.
nb::any function_bounds_of(const Model& model, const Ensemble& data, const nb::object& function, double level,
                           Index replicates, std::uint64_t seed, int threads, nb::object listener) {
  Call call(std::move(listener));
  ConfidenceOptions options{.level = level, .execution = call.execution(threads)};
  options.replicates = replicates;
  options.seed = seed;
  const Functional values = [&](const Model& other) {
    Vector result;
    call.ask([&] { result = nb::cast<Vector>(function(nb::cast(other))); });
    return result;
  };
  const FunctionBounds s = call.run([&] { return function_bounds(model, data, values, options); });
  return make("FunctionBounds", {FIELD(interval), Field("level", level), FIELD(replicates), FIELD(freedom),
                                 FIELD(smoothing), FIELD(findings)});
}

}  // namespace

void bind_modes(nb::module_& module) {
  module.def("modes", &modes_of_model, nb::arg("model"), nb::arg("data").none(), nb::kw_only(), nb::arg("window"),
             nb::arg("slow"), nb::arg("level"), nb::arg("replicates"), nb::arg("seed"), nb::arg("threads"),
             nb::arg("listener").none());
  module.def("function_bounds", &function_bounds_of, nb::arg("model"), nb::arg("data"), nb::arg("function"),
             nb::kw_only(), nb::arg("level"), nb::arg("replicates"), nb::arg("seed"), nb::arg("threads"),
             nb::arg("listener").none());
  module.def(
      "frozen_systems",
      [](const Model& model, const std::vector<Index>& steps, Index window) {
        return frozen_systems(model, steps, {window, 0.1, {}});
      },
      nb::arg("model"), nb::arg("steps"), nb::arg("window"));
  module.def(
      "frequency_response",
      [](const Model& model, Index step, const Vector& frequencies) {
        const auto found = frequency_response(model.at(step), model.dt, frequencies);
        const auto entry = [&](Index f, Index j, Index i) { return found[size_t(f)](j, i); };
        return array_of_entries(entry, found.size(), model.outputs, model.inputs);
      },
      nb::arg("model"), nb::arg("step"), nb::arg("frequencies"));
}

}  // namespace tokid::python
