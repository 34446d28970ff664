// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/update.hpp"

#include "call.hpp"
#include "results.hpp"

namespace tokid::python {

RESULT(Additions, "Additions", FIELD(experiments), FIELD(known), FIELD(simulation), FIELD(one_step), FIELD(findings))

namespace {

using Path = std::filesystem::path;

// (model, experiments, condition_max, rank_deficient_steps, findings)
nb::tuple identified(const UpdateState& state, int threads, nb::object listener) {
  Call call(std::move(listener));
  const Execution execution = call.execution(threads);
  Updated now = call.run([&] { return identify(state, execution); });
  return nb::make_tuple(std::move(now.model), now.experiments, now.condition_max, now.rank_deficient_steps,
                        now.findings);
}

}  // namespace

void bind_update(nb::module_& module) {
  nb::class_<UpdateState>(module, "UpdateState", "The state of the library; tokid.UpdateState is what users see of it.")
      .def(
          "copy", [](const UpdateState& state) { return UpdateState(state); }, no_gil)
      .def("identify", &identified, nb::kw_only(), nb::arg("threads"), nb::arg("listener").none())
      // Adds experiments, and evaluates the model before the update on them. If it throws, the state must not be used
      // any more.
      .def(
          "add",
          [](UpdateState& state, const Model& before, const Ensemble& more, int threads, nb::object listener) {
            Call call(std::move(listener));
            const Execution execution = call.execution(threads);
            return call.run([&] { return update(state, before, more, execution); });
          },
          nb::arg("before"), nb::arg("more"), nb::kw_only(), nb::arg("threads"), nb::arg("listener").none())
      .def(
          "add_files",
          [](UpdateState& state, const Model& before, const std::vector<Path>& files, std::vector<std::string> inputs,
             std::vector<std::string> outputs, int threads, nb::object listener) {
            Call call(std::move(listener));
            UpdateOptions options;
            options.read.inputs = std::move(inputs);
            options.read.outputs = std::move(outputs);
            options.execution = call.execution(threads);
            return call.run([&] { return update(state, before, files, options); });
          },
          nb::arg("before"), nb::arg("files"), nb::kw_only(), nb::arg("inputs"), nb::arg("outputs"), nb::arg("threads"),
          nb::arg("listener").none())
      .def(
          "save", [](const UpdateState& state, const Path& path) { save_update_state(state, path); }, no_gil)
      .def(
          "save_held", [](const UpdateState& state, FileLock& held) { save_update_state(state, held); }, no_gil)
      .def_prop_ro("experiments", [](const UpdateState& s) { return s.factors.experiments; })
      .def_prop_ro("steps", [](const UpdateState& s) { return s.factors.steps(); })
      .def_prop_ro("inputs", [](const UpdateState& s) { return s.factors.inputs; })
      .def_prop_ro("outputs", [](const UpdateState& s) { return s.factors.outputs; })
      .def_prop_ro("lags", [](const UpdateState& s) { return s.factors.lags; })
      .def_prop_ro("states", [](const UpdateState& s) { return s.plan.states; })
      .def_prop_ro("dt", [](const UpdateState& s) { return s.factors.dt; });
  nb::class_<FileLock>(module, "FileLock", "The lock of the library; tokid.FileLock is what users see of it.")
      .def_static(
          "take",
          [](const Path& file, double limit, nb::object waits) {
            Call call{nb::none()};
            const LockOptions options{limit, [&waits](const std::string& text) {
                                        const nb::gil_scoped_acquire acquire;
                                        waits(text);
                                      }};
            return call.run([&] { return FileLock(file, options); });
          },
          nb::arg("file"), nb::kw_only(), nb::arg("limit"), nb::arg("waits"));
  module.def("load_update_state", &load_update_state, nb::arg("path"), no_gil);
}

}  // namespace tokid::python
