// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/io.hpp"

#include "call.hpp"
#include "io/formats/column_remarks.hpp"
#include "io/formats/time_unit.hpp"

namespace tokid::python {

namespace {

using Path = std::filesystem::path;

}  // namespace

void bind_io(nb::module_& module) {
  module.def("is_model",
             [](const Path& path) { return without_gil([&] { return file_kind(path) == FileKind::model; }); });
  module.def(
      "load_ensemble",
      [](const Path& path, std::vector<std::string> inputs, std::vector<std::string> outputs, bool outputs_required) {
        const ReadOptions options{std::move(inputs), std::move(outputs), outputs_required};
        return without_gil([&] { return load_ensemble(path, options); });
      },
      nb::arg("path"), nb::arg("inputs"), nb::arg("outputs"), nb::arg("outputs_required"));
  module.def(
      "time_unit",
      [](const std::string& column) -> std::optional<std::pair<double, double>> {
        const auto unit = io::time_unit(column);
        return unit ? std::optional(std::pair(unit->seconds, unit->over)) : std::nullopt;
      },
      nb::arg("column"));
  module.def(
      "is_step_number", [](const std::string& column) { return io::is_step_number(column); }, nb::arg("column"));
  module.def(
      "remark_on_unused", [](const io::Names& columns) { return io::remark_on_unused(columns); }, nb::arg("columns"));
  module.attr("rows_as_steps") = std::string(io::rows_as_steps);
  module.def(
      "load_model", [](const Path& path) { return without_gil([&] { return load_model(path); }); }, nb::arg("path"));
  module.def(
      "save_ensemble",
      [](const Ensemble& data, const Path& path, bool mat73) {
        without_gil([&] { save_ensemble(data, path, {mat73}); });
      },
      nb::arg("data"), nb::arg("path"), nb::arg("mat73"));
  module.def(
      "save_model",
      [](const Model& model, const Path& path, bool mat73) { without_gil([&] { save_model(model, path, {mat73}); }); },
      nb::arg("model"), nb::arg("path"), nb::arg("mat73"));
}

}  // namespace tokid::python
