// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/io.hpp"

#include "call.hpp"

namespace tokid::python {

namespace {

using Path = std::filesystem::path;

void bind_read_options(nb::module_& module) {
  using Options = ReadOptions;
  nb::class_<Options>(module, "ReadOptions")
      .def(nb::init<>())
      .def_rw("inputs", &Options::inputs)
      .def_rw("outputs", &Options::outputs)
      .def_rw("outputs_required", &Options::outputs_required);
}

}  // namespace

void bind_io(nb::module_& module) {
  module.def("is_model",
             [](const Path& path) { return without_gil([&] { return file_kind(path) == FileKind::model; }); });
  bind_read_options(module);
  module.def("load_ensemble", [](const std::vector<Path>& paths, const ReadOptions& options) {
    return without_gil([&] { return load_ensemble(paths, options); });
  });
  module.def("load_model", [](const Path& path) { return without_gil([&] { return load_model(path); }); });
  module.def("save_ensemble", [](const Ensemble& data, const Path& path, bool mat73) {
    without_gil([&] { save_ensemble(data, path, {mat73}); });
  });
  module.def("save_model", [](const Model& model, const Path& path, bool mat73) {
    without_gil([&] { save_model(model, path, {mat73}); });
  });
}

}  // namespace tokid::python
