// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <complex>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>

#include "arrays.hpp"
#include "call.hpp"
#include "results.hpp"
#include "tokid/uncertainty.hpp"

namespace tokid::python {

namespace {

constexpr double nan = std::numeric_limits<double>::quiet_NaN();

using Part = Matrix Interval::*;

// The intervals of all steps as a Python object. array(part) makes the array of one of its four parts.
template <class Layout>
nb::any intervals(Layout&& array) {
  return make("Interval", {{"estimate", nb::cast(array(&Interval::estimate))},
                           {"deviation", nb::cast(array(&Interval::deviation))},
                           {"lower", nb::cast(array(&Interval::lower))},
                           {"upper", nb::cast(array(&Interval::upper))}});
}

// (T, band+1, m, r)
nb::any object_of(const MarkovBounds& b) {
  const size_t T = b.step.size(), blocks = size_t(b.band + 1), m = size_t(b.outputs), r = size_t(b.inputs);
  const nb::object interval = intervals([&](Part part) {
    std::vector<double> values;
    values.reserve(T * blocks * m * r);
    for (const Interval& step : b.step)
      for (size_t g = 0; g < blocks; ++g)
        for (size_t j = 0; j < m; ++j)
          for (size_t i = 0; i < r; ++i) values.push_back((step.*part)(Index(j), Index(g * r + i)));
    return array_of(std::move(values), {T, blocks, m, r});
  });
  const RelativeError error = relative_error(b);
  return make("MarkovBounds", {{"band", b.band},
                               {"k_begin", b.k_begin},
                               {"interval", interval},
                               {"relative_error", error.expected},
                               {"relative_error_limit", error.limit}});
}

// (N, T, m); None without bounds
nb::any object_of(const OutputBounds& b) {
  if (b.step.empty()) return any(nb::none());
  const size_t T = b.step.size(), N = size_t(b.step.front().estimate.rows()),
               m = size_t(b.step.front().estimate.cols());
  return intervals([&](Part part) {
    std::vector<double> values(N * T * m);
    for (size_t k = 0; k < T; ++k)
      for (size_t j = 0; j < m; ++j)
        for (size_t n = 0; n < N; ++n) values[(n * T + k) * m + j] = (b.step[k].*part)(Index(n), Index(j));
    return array_of(std::move(values), {N, T, m});
  });
}

using Complex = std::complex<double>;

template <class Number>
nb::any table_of(std::vector<Number> values, size_t rows, size_t cols) {
  auto held = std::make_unique<Number[]>(values.size());
  std::copy(values.begin(), values.end(), held.get());
  Number* first = held.get();
  const nb::capsule owner(held.release(), [](void* p) noexcept { delete[] static_cast<Number*>(p); });
  return any(nb::cast(nb::ndarray<nb::numpy, Number, nb::ndim<2>>(first, {rows, cols}, owner)));
}

// (S, n); steps with fewer eigenvalues are padded
nb::any object_of(const SpectrumBounds& b) {
  using Step = SpectrumBounds::Step;
  if (b.step.empty()) return any(nb::none());
  Index n = 0;
  for (const Step& step : b.step) n = std::max(n, step.eigenvalues.size());
  const auto table = [&](auto none, auto&& entry) {
    using Number = decltype(none);
    std::vector<Number> values;
    for (const Step& step : b.step)
      for (Index e = 0; e < n; ++e) values.push_back(e < step.eigenvalues.size() ? Number(entry(step, e)) : none);
    return table_of(std::move(values), b.step.size(), size_t(n));
  };
  const auto bounds = [&](Interval Step::*interval) {
    return intervals(
        [&](Part part) { return table(nan, [&](const Step& step, Index e) { return (step.*interval.*part)(e, 0); }); });
  };
  return make(
      "SpectrumBounds",
      {{"begin", b.begin},
       {"eigenvalues", table(Complex(nan, nan), [](const Step& s, Index e) { return s.eigenvalues(e); })},
       {"real", bounds(&Step::real)},
       {"imaginary", bounds(&Step::imaginary)},
       {"covariance", table(nan, [](const Step& s, Index e) { return s.covariance(e); })},
       {"simple", table(std::uint8_t{0}, [](const Step& s, Index e) { return s.simple(e); }).attr("astype")("bool")}});
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
  Confidence c = call.run([&] { return confidence(model, data, options); });
  append(c.findings, differences(model, data));
  const nb::object markov = object_of(c.markov), simulated = object_of(c.simulated), spectrum = object_of(c.spectrum);
  const nb::list findings = list_of(c.findings);
  const Index experiments = c.experiments, lags = c.lags, found = c.replicates;
  const double freedom = c.freedom, dt = c.dt, smoothing = c.smoothing;
  const nb::object bias = c.bias.size() > 0 ? nb::cast(array_of(c.bias)) : nb::none();
  return make("Confidence", {{"level", level},
                             {"dt", dt},
                             {"experiments", experiments},
                             {"lags", lags},
                             {"replicates", found},
                             {"freedom", freedom},
                             {"smoothing", smoothing},
                             {"bias", bias},
                             {"markov", markov},
                             {"simulated", simulated},
                             {"spectrum", spectrum},
                             {"findings", nb::object(findings)},
                             {"_core", nb::cast(std::move(c))}});
}

}  // namespace

void bind_confidence(nb::module_& module) {
  nb::class_<Confidence>(module, "Confidence", "The bounds as the library has them, to be written to a file.")
      .def(
          "save",
          [](const Confidence& bounds, const std::filesystem::path& path, bool mat73) {
            save_confidence(bounds, path, {mat73});
          },
          nb::arg("path"), nb::arg("mat73"), nb::call_guard<nb::gil_scoped_release>());
  module.def("confidence", &bounds_of, nb::arg("model"), nb::arg("data"), nb::kw_only(), nb::arg("level"),
             nb::arg("replicates"), nb::arg("seed"), nb::arg("band"), nb::arg("reference_step"), nb::arg("threads"),
             nb::arg("listener").none());
  module.def(
      "closed_loop_spectrum",
      [](const Model& model, Index reference_step) {
        const Spectrum found =
            without_gil([&] { return closed_loop_spectrum(model, {.reference_step = reference_step}); });
        Index n = 0;
        for (const Eigen::VectorXcd& step : found.eigenvalues) n = std::max(n, step.size());
        std::vector<Complex> values;
        for (const Eigen::VectorXcd& step : found.eigenvalues)
          for (Index e = 0; e < n; ++e) values.push_back(e < step.size() ? step(e) : Complex(nan, nan));
        return std::pair(found.begin, table_of(std::move(values), found.eigenvalues.size(), size_t(n)));
      },
      nb::arg("model"), nb::arg("reference_step"));
}

}  // namespace tokid::python
