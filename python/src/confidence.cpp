// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <complex>
#include <cstdint>
#include <limits>
#include <optional>

#include "arrays.hpp"
#include "call.hpp"
#include "results.hpp"
#include "tokid/uncertainty.hpp"

namespace tokid::python {

namespace {

using Complex = std::complex<double>;
constexpr double nan = std::numeric_limits<double>::quiet_NaN();

using Part = Matrix Interval::*;

// The intervals of all steps as arrays of these sizes. entry(part, i, j, …) is a number of one of their four parts.
template <class Entry, class... Sizes>
nb::object intervals(const Entry& entry, Sizes... sizes) {
  const auto array = [&](Part part) {
    return nb::cast(array_of_entries([&](auto... at) { return entry(part, at...); }, sizes...));
  };
  return make("Interval", {{"estimate", array(&Interval::estimate)},
                           {"deviation", array(&Interval::deviation)},
                           {"lower", array(&Interval::lower)},
                           {"upper", array(&Interval::upper)}});
}

// (T, band+1, m, r)
nb::object object_of(const MarkovBounds& s) {
  const RelativeError error = relative_error(s);
  const auto entry = [&](Part part, Index k, Index g, Index j, Index i) {
    return (s.step[size_t(k)].*part)(j, g * s.inputs + i);
  };
  return make("MarkovBounds", {FIELD(band), FIELD(k_begin),
                               Field("interval", intervals(entry, s.step.size(), s.band + 1, s.outputs, s.inputs)),
                               Field("relative_error", error.expected), Field("relative_error_limit", error.limit)});
}

// (N, T, m); None without bounds
nb::object object_of(const OutputBounds& b) {
  if (b.step.empty()) return nb::none();
  const Matrix& first = b.step.front().estimate;
  const auto entry = [&](Part part, Index n, Index k, Index j) { return (b.step[size_t(k)].*part)(n, j); };
  return intervals(entry, first.rows(), b.step.size(), first.cols());
}

// The largest number of eigenvalues of a step.
template <class Steps, class Size>
Index largest(const Steps& steps, const Size& size) {
  Index n = 0;
  for (const auto& step : steps) n = std::max(n, size(step));
  return n;
}

// (S, n); steps with fewer eigenvalues are padded
nb::object object_of(const SpectrumBounds& b) {
  using Step = SpectrumBounds::Step;
  if (b.step.empty()) return nb::none();
  const size_t S = b.step.size();
  const Index n = largest(b.step, [](const Step& step) { return step.eigenvalues.size(); });
  const auto padded = [&](auto none, const auto& entry) {
    return [&b, none, entry](Index s, Index e) {
      const Step& step = b.step[size_t(s)];
      return e < step.eigenvalues.size() ? decltype(none)(entry(step, e)) : none;
    };
  };
  const auto table = [&](auto none, const auto& entry) {
    return nb::cast(array_of_entries(padded(none, entry), S, n));
  };
  const auto bounds = [&](Interval Step::*interval) {
    const auto entry = [&](Part part, Index s, Index e) {
      return padded(nan, [&](const Step& step, Index i) { return (step.*interval.*part)(i, 0); })(s, e);
    };
    return intervals(entry, S, n);
  };
  return make("SpectrumBounds",
              {{"begin", b.begin},
               {"eigenvalues", table(Complex(nan, nan), [](const Step& s, Index e) { return s.eigenvalues(e); })},
               {"real", bounds(&Step::real)},
               {"imaginary", bounds(&Step::imaginary)},
               {"covariance", table(nan, [](const Step& s, Index e) { return s.covariance(e); })},
               {"simple", table(false, [](const Step& s, Index e) { return s.simple(e); })}});
}

nb::any bounds_of(const Model& model, const Ensemble& data, double level, Index replicates, std::uint64_t seed,
                  Index band, Index reference_step, int threads, nb::object listener) {
  Call call(std::move(listener));
  ConfidenceOptions options{.level = level,
                            .replicates = replicates,
                            .seed = seed,
                            .band = band,
                            .reference_step = reference_step,
                            .execution = call.execution(threads)};
  Confidence s = call.run([&] { return confidence(model, data, options); });
  append(s.findings, differences(model, data));
  return make("Confidence",
              {FIELD(level), FIELD(dt), FIELD(experiments), FIELD(lags), FIELD(replicates), FIELD(freedom),
               FIELD(smoothing), Field("bias", s.bias.size() > 0 ? std::optional(s.bias) : std::nullopt),
               Field("markov", object_of(s.markov)), Field("simulated", object_of(s.simulated)),
               Field("spectrum", object_of(s.spectrum)), FIELD(findings), Field("_core", nb::cast(std::move(s)))});
}

}  // namespace

void bind_confidence(nb::module_& module) {
  nb::class_<Confidence>(module, "Confidence", "The bounds as the library has them, to be written to a file.")
      .def(
          "save",
          [](const Confidence& bounds, const std::filesystem::path& path, bool mat73) {
            save_confidence(bounds, path, {mat73});
          },
          nb::arg("path"), nb::arg("mat73"), no_gil);
  module.def("confidence", &bounds_of, nb::arg("model"), nb::arg("data"), nb::kw_only(), nb::arg("level"),
             nb::arg("replicates"), nb::arg("seed"), nb::arg("band"), nb::arg("reference_step"), nb::arg("threads"),
             nb::arg("listener").none());
  module.def(
      "closed_loop_spectrum",
      [](const Model& model, Index reference_step) {
        const Spectrum found =
            without_gil([&] { return closed_loop_spectrum(model, {.reference_step = reference_step}); });
        const auto& steps = found.eigenvalues;
        const Index n = largest(steps, [](const Eigen::VectorXcd& step) { return step.size(); });
        const auto entry = [&](Index s, Index e) {
          const Eigen::VectorXcd& step = steps[size_t(s)];
          return e < step.size() ? step(e) : Complex(nan, nan);
        };
        return std::pair(found.begin, array_of_entries(entry, steps.size(), n));
      },
      nb::arg("model"), nb::arg("reference_step"));
}

}  // namespace tokid::python
