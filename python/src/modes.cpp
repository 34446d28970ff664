// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/modes.hpp"

#include <complex>
#include <memory>
#include <optional>

#include "arrays.hpp"
#include "call.hpp"
#include "model/continuation.hpp"
#include "results.hpp"

namespace tokid::python {

namespace {

using Complex = std::complex<double>;

// An array of the given shape whose entry i is value(i), in the order of C.
template <class Number, class Value>
nb::object complex_or_real(const std::vector<size_t>& shape, Value&& value) {
  size_t size = 1;
  for (const size_t length : shape) size *= length;
  auto held = std::make_unique<Number[]>(size);
  for (size_t i = 0; i < size; ++i) held[i] = value(Index(i));
  Number* first = held.get();
  const nb::capsule owner(held.release(), [](void* p) noexcept { delete[] static_cast<Number*>(p); });
  return nb::cast(nb::ndarray<nb::numpy, Number>(first, shape.size(), shape.data(), owner));
}

template <class Table>
nb::object table(const Table& values) {
  using Number = std::remove_const_t<typename Table::Scalar>;
  const Index cols = values.cols();
  return complex_or_real<Number>({size_t(values.rows()), size_t(cols)},
                                 [&](Index i) { return values(i / cols, i % cols); });
}

nb::any interval_of(const Interval& interval) {
  return make("Interval", {{"estimate", table(interval.estimate)},
                           {"deviation", table(interval.deviation)},
                           {"lower", table(interval.lower)},
                           {"upper", table(interval.upper)}});
}

// (list of m × n) as (S, m, n)
nb::object shapes_of(const Modes& modes, Index outputs) {
  const Index n = modes.count();
  return complex_or_real<Complex>({size_t(modes.steps()), size_t(outputs), size_t(n)}, [&](Index i) {
    return modes.shapes[size_t(i / (outputs * n))](i / n % outputs, i % n);
  });
}

nb::any object_of(const Modes& m, const Model& model, const std::optional<ModeBounds>& bounds) {
  const Matrix valid = m.valid.matrix().cast<double>();
  const nb::object none = nb::none();
  const auto list = [](const Eigen::VectorXcd& values) {
    return nb::object(table(Eigen::MatrixXcd(values.transpose())).attr("ravel")());
  };
  const auto column = [](const Interval& all) {
    const auto flat = [](const Matrix& values) { return nb::object(table(values).attr("ravel")()); };
    return make("Interval", {{"estimate", flat(all.estimate)},
                             {"deviation", flat(all.deviation)},
                             {"lower", flat(all.lower)},
                             {"upper", flat(all.upper)}});
  };
  const bool repeats = goes_on(model);
  const Floquet of_period = repeats ? floquet(model) : Floquet();
  return make("Modes",
              {{"begin", m.begin},
               {"dt", m.dt},
               {"window", m.window},
               {"slow", m.slow},
               {"poles", table(m.poles)},
               {"frequency", table(natural_frequencies(m))},
               {"damping", table(damping_ratios(m))},
               {"shapes", shapes_of(m, model.outputs)},
               {"variation", table(m.variation)},
               {"window_change", table(m.window_change)},
               {"valid", nb::object(table(valid).attr("astype")("bool"))},
               {"multipliers", repeats ? list(of_period.multipliers) : none},
               {"multipliers_error", repeats ? nb::object(list(of_period.error.cast<Complex>()).attr("real")) : none},
               {"exponents", repeats ? list(of_period.exponents) : none},
               {"level", bounds ? nb::cast(bounds->level) : none},
               {"frequency_bounds", bounds ? nb::object(interval_of(bounds->frequency)) : none},
               {"damping_bounds", bounds ? nb::object(interval_of(bounds->damping)) : none},
               {"exponents_real_bounds", bounds && repeats ? nb::object(column(bounds->exponents_real)) : none},
               {"exponents_imag_bounds", bounds && repeats ? nb::object(column(bounds->exponents_imag)) : none},
               {"findings", nb::object(list_of(bounds ? bounds->findings : Findings()))}});
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
    call.ask([&] { result = vector_of(nb::cast<AnyArray>(function(nb::cast(other)))); });
    return result;
  };
  const FunctionBounds found = call.run([&] { return function_bounds(model, data, values, options); });
  return make("FunctionBounds", {{"interval", nb::object(interval_of(found.interval))},
                                 {"level", level},
                                 {"replicates", found.replicates},
                                 {"freedom", found.freedom},
                                 {"smoothing", found.smoothing},
                                 {"findings", nb::object(list_of(found.findings))}});
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
        nb::list result;
        for (Model& frozen : frozen_systems(model, steps, {window, 0.1, {}})) result.append(std::move(frozen));
        return result;
      },
      nb::arg("model"), nb::arg("steps"), nb::arg("window"));
  module.def(
      "frequency_response",
      [](const Model& model, Index step, const AnyArray& frequencies) -> nb::any {
        const std::vector<Eigen::MatrixXcd> found =
            frequency_response(model.at(step), model.dt, vector_of(frequencies));
        const Index m = model.outputs, r = model.inputs;
        return any(complex_or_real<Complex>({found.size(), size_t(m), size_t(r)},
                                            [&](Index i) { return found[size_t(i / (m * r))](i / r % m, i % r); }));
      },
      nb::arg("model"), nb::arg("step"), nb::arg("frequencies"));
}

}  // namespace tokid::python
