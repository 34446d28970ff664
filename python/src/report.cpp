// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/report.hpp"

#include "call.hpp"
#include "results.hpp"
#include "tokid/io.hpp"

namespace tokid::python {

RESULT(PrintedNumber, "PrintedNumber", FIELD(equation), FIELD(quantity), FIELD(printed), FIELD(computed),
       FIELD(tolerance))

namespace {

using Path = std::filesystem::path;

// `identified`: the ensemble of the identification, for bands of the responses; null: no bands.
Verdict reported(const Model& model, const Ensemble& data, const std::optional<Path>& path, ReportOptions options,
                 const Ensemble* identified, int threads) {
  Call call{nb::none()};
  return call.run([&] {
    if (identified) {
      ConfidenceOptions bounds;
      bounds.execution = call.execution(threads);
      options.bands = response_bands(model, *identified, bounds, options.at);
    }
    const ReportPage page = report_page(model, data, options);
    if (path) save_text(page.html, *path);
    return page.verdict;
  });
}

// Writes the page and its data into a directory, if one is given. Returns the printed numbers and the data.
nb::tuple paper(const std::optional<Path>& directory, std::uint64_t seed, int threads, nb::object listener) {
  Call call(std::move(listener));
  const auto [numbers, data] = call.run([&] {
    const Execution execution = call.execution(threads);
    const Paper example = paper_example({.seed = seed, .execution = share(execution, 0.0, 0.2)});
    const KalmanStudy study = kalman_study({.seed = seed, .execution = share(execution, 0.2, 1.0)});
    std::string json = paper_json(example, study);
    if (directory) {
      std::filesystem::create_directories(*directory);
      save_text(paper_page(example, study), *directory / "paper.html");
      save_text(json, *directory / "paper.json");
    }
    return std::pair(example.printed, std::move(json));
  });
  return nb::make_tuple(numbers, data);
}

}  // namespace

void bind_report(nb::module_& module) {
  nb::class_<NamedModel>(module, "NamedModel", "A model with its name on a page.")
      .def(
          "__init__",
          [](NamedModel* self, std::string name, const Model& model) {
            new (self) NamedModel{std::move(name), model};
          },
          nb::arg("name"), nb::arg("model"));
  nb::class_<ReportOptions>(module, "ReportOptions", "The options of a page, as the library has them.")
      .def(nb::init<>())
      .def_rw("model_name", &ReportOptions::model_name)
      .def_rw("data_name", &ReportOptions::data_name)
      .def_rw("horizon", &ReportOptions::horizon)
      .def_rw("first_step", &ReportOptions::first_step)
      .def_rw("initial_state", &ReportOptions::initial_state, nb::for_setter(nb::arg().none()))
      .def_rw("experiments", &ReportOptions::experiments)
      .def_rw("compare", &ReportOptions::compare)
      .def_rw("at", &ReportOptions::at);
  module.def("report", &reported, nb::arg("model"), nb::arg("data"), nb::arg("path").none(), nb::arg("options"),
             nb::arg("identified").none(), nb::arg("threads"));
  module.def("paper", &paper, nb::arg("directory").none(), nb::arg("seed"), nb::arg("threads"),
             nb::arg("listener").none());
}

}  // namespace tokid::python
