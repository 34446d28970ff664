// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/identify.hpp"

#include "call.hpp"
#include "results.hpp"

namespace tokid::python {

namespace {

// (model, evidence)
nb::tuple identified(const Ensemble& data, IdentifyOptions options, int threads, nb::object listener) {
  Call call(std::move(listener));
  options.execution = call.execution(threads);
  Identification result = call.run([&] { return identify(data, options); });
  nb::object evidence = object_of(result);
  return nb::make_tuple(std::move(result.model), evidence);
}

}  // namespace

void bind_identify(nb::module_& module) {
  nb::enum_<Method>(module, "Method")
      .value("auto", Method::automatic)
      .value("tvera", Method::tvera)
      .value("subspace", Method::subspace);
  nb::enum_<NominalChoice>(module, "NominalChoice")
      .value("auto", NominalChoice::automatic)
      .value("none", NominalChoice::none)
      .value("mean", NominalChoice::mean);
  nb::enum_<Frame>(module, "Frame")
      .value("raw", Frame::raw)
      .value("reference", Frame::reference)
      .value("smooth", Frame::smooth);
  nb::enum_<Weighting>(module, "Weighting")
      .value("one_step", Weighting::one_step)
      .value("many_steps", Weighting::many_steps)
      .value("projection", Weighting::projection);

  nb::class_<IdentifyOptions>(module, "IdentifyOptions", "The options of an identification, as the library has them.")
      .def(nb::init<>())
      .def_rw("states", &IdentifyOptions::states)
      .def_rw("lags", &IdentifyOptions::lags)
      .def_rw("method", &IdentifyOptions::method)
      .def_rw("smoothing", &IdentifyOptions::smoothing)
      .def_rw("period", &IdentifyOptions::period)
      .def_rw("weighting", &IdentifyOptions::weighting, nb::for_setter(nb::arg().none()))
      .def_rw("refine", &IdentifyOptions::refine, nb::for_setter(nb::arg().none()))
      .def_rw("initial_state", &IdentifyOptions::initial_state, nb::for_setter(nb::arg().none()))
      .def_rw("nominal", &IdentifyOptions::nominal)
      .def_rw("frame", &IdentifyOptions::frame)
      .def_rw("reference_step", &IdentifyOptions::reference_step)
      .def_rw("hold_out", &IdentifyOptions::hold_out)
      .def_rw("rows", &IdentifyOptions::rows)
      .def_rw("cols", &IdentifyOptions::cols);

  module.def("identify", &identified, nb::arg("data"), nb::arg("options"), nb::arg("threads"),
             nb::arg("listener").none());
}

}  // namespace tokid::python
