// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/identify.hpp"

#include "call.hpp"
#include "results.hpp"
#include "tokid/report.hpp"
#include "tokid/update.hpp"

namespace tokid::python {

namespace {

// (model, evidence, state or None); the page goes to its file, after everything else has worked.
nb::tuple identified(const Ensemble& data, IdentifyOptions options, int threads, nb::object listener, bool keep_state,
                     const std::optional<std::filesystem::path>& page, const ReportOptions& page_options) {
  Call call(std::move(listener));
  options.execution = call.execution(threads);
  auto [result, state] = call.run([&] {
    Identification found = identify(data, options);
    std::optional<UpdateState> kept;
    if (keep_state) kept = update_state(data, found, options);
    if (page) save_text(identification_page(found, data, options, page_options).html, *page);
    return std::pair(std::move(found), std::move(kept));
  });
  nb::object evidence = object_of(result);
  return nb::make_tuple(std::move(result.model), evidence, std::move(state));
}

// What an earlier identification has chosen, of its dataclass.
NoisyChoices choices_of(nb::handle choices) {
  const auto number = [](nb::handle object, const char* name) { return nb::cast<double>(object.attr(name)); };
  const nb::object variation = choices.attr("variation");
  NoisyChoices result;
  result.variation = {number(variation, "smoothing"), nb::cast<Index>(variation.attr("period"))};
  result.state_smoothing = number(choices, "state_smoothing");
  const std::string weighting = nb::cast<std::string>(choices.attr("weighting"));
  result.weighting = weighting == "projection"   ? Weighting::projection
                     : weighting == "many-steps" ? Weighting::many_steps
                                                 : Weighting::one_step;
  result.refinement_smoothing = number(choices, "refinement_smoothing");
  result.refinement_iterations = nb::cast<Index>(choices.attr("refinement_iterations"));
  return result;
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
      .def_rw("cols", &IdentifyOptions::cols)
      .def("follow", [](IdentifyOptions& o, nb::handle choices) { o.choices = choices_of(choices); });

  module.def("identify", &identified, nb::arg("data"), nb::arg("options"), nb::arg("threads"),
             nb::arg("listener").none(), nb::arg("keep_state") = false, nb::arg("page").none() = nb::none(),
             nb::arg("page_options") = ReportOptions());
}

}  // namespace tokid::python
