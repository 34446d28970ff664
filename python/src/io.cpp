// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/io.hpp"

#include "call.hpp"
#include "io/formats/column_remarks.hpp"
#include "io/formats/time_unit.hpp"

namespace tokid::python {

namespace {

using Path = std::filesystem::path;

void bind_read_options(nb::module_& module) {
  nb::enum_<ResampleMethod>(module, "ResampleMethod")
      .value("linear", ResampleMethod::linear)
      .value("previous", ResampleMethod::previous)
      .value("mean", ResampleMethod::mean);
  nb::enum_<DateOrder>(module, "DateOrder")
      .value("automatic", DateOrder::automatic)
      .value("day_first", DateOrder::day_first)
      .value("month_first", DateOrder::month_first);
  using Options = ReadOptions;
  nb::class_<Options>(module, "ReadOptions")
      .def(nb::init<>())
      .def_rw("inputs", &Options::inputs)
      .def_rw("outputs", &Options::outputs)
      .def_rw("outputs_required", &Options::outputs_required)
      .def_rw("time", &Options::time)
      .def_rw("experiment_column", &Options::experiment)
      .def_rw("missing", &Options::missing)
      .def_rw("trigger", &Options::trigger)
      .def_rw("before", &Options::before)
      .def_rw("resample", &Options::resample, nb::arg().none())
      .def_rw("held", &Options::held)
      .def_rw("longest_gap", &Options::longest_gap, nb::arg().none())
      .def_rw("dt", &Options::dt, nb::arg().none())
      .def_rw("dates", &Options::dates)
      .def_rw("resample_method", &Options::resample_method);
}

}  // namespace

void bind_io(nb::module_& module) {
  module.def("is_model",
             [](const Path& path) { return without_gil([&] { return file_kind(path) == FileKind::model; }); });
  bind_read_options(module);
  module.def("load_ensemble", [](const std::vector<Path>& paths, const ReadOptions& options) {
    return without_gil([&] { return load_ensemble(paths, options); });
  });
  module.def("time_unit", [](const std::string& column) -> std::optional<std::pair<double, double>> {
    const auto unit = io::time_unit(column);
    return unit ? std::optional(std::pair(unit->seconds, unit->over)) : std::nullopt;
  });
  module.def("is_step_number", [](const std::string& column) { return io::is_step_number(column); });
  module.def("remark_on_unused", [](const io::Names& columns) { return io::remark_on_unused(columns); });
  module.attr("rows_as_steps") = std::string(io::rows_as_steps);
  module.def("load_model", [](const Path& path) { return without_gil([&] { return load_model(path); }); });
  module.def("save_ensemble", [](const Ensemble& data, const Path& path, bool mat73) {
    without_gil([&] { save_ensemble(data, path, {mat73}); });
  });
  module.def("save_model", [](const Model& model, const Path& path, bool mat73) {
    without_gil([&] { save_model(model, path, {mat73}); });
  });
}

}  // namespace tokid::python
