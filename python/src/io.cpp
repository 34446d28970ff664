// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/io.hpp"

#include "call.hpp"

namespace tokid::python {

namespace {

using Path = std::filesystem::path;

Ensemble read_ensemble(const Path& path, std::vector<std::string> inputs, std::vector<std::string> outputs,
                       bool outputs_required) {
  return load_ensemble(path, {std::move(inputs), std::move(outputs), outputs_required});
}

}  // namespace

void bind_io(nb::module_& module) {
  module.def(
      "is_model", [](const Path& path) { return file_kind(path) == FileKind::model; },
      nb::call_guard<nb::gil_scoped_release>());
  module.def("load_ensemble", &read_ensemble, nb::arg("path"), nb::arg("inputs"), nb::arg("outputs"),
             nb::arg("outputs_required"), nb::call_guard<nb::gil_scoped_release>());
  module.def("load_model", &load_model, nb::arg("path"), nb::call_guard<nb::gil_scoped_release>());
  module.def(
      "save_ensemble", [](const Ensemble& data, const Path& path, bool mat73) { save_ensemble(data, path, {mat73}); },
      nb::arg("data"), nb::arg("path"), nb::arg("mat73"), nb::call_guard<nb::gil_scoped_release>());
  module.def(
      "save_model", [](const Model& model, const Path& path, bool mat73) { save_model(model, path, {mat73}); },
      nb::arg("model"), nb::arg("path"), nb::arg("mat73"), nb::call_guard<nb::gil_scoped_release>());
}

}  // namespace tokid::python
