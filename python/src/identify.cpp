// SPDX-License-Identifier: BSD-3-Clause
#include "tokid/identify.hpp"

#include <fmt/format.h>

#include <cstdint>
#include <limits>
#include <optional>
#include <stdexcept>
#include <tuple>

#include "call.hpp"
#include "model/options.hpp"
#include "results.hpp"
#include "tokid/refine_model.hpp"
#include "tokid/report.hpp"
#include "tokid/stream.hpp"
#include "tokid/update.hpp"

namespace tokid::python {

RESULT(Streamed, "Streamed", FIELD(identification), Field("states", s.identification.model.states()), FIELD(block),
       FIELD(blocks), FIELD(overlap), FIELD(missing))

RESULT(RefinementFigures, "RefinementFigures", FIELD(simulation), FIELD(one_step), FIELD(whiteness_p))

namespace {

// The verdict of the page, which is written if the call asks for one. Null if nothing could be compared; a page is an
// error then.
std::optional<Verdict> judged(const Identification& found, const Ensemble& data, const IdentifyOptions& options,
                              const std::optional<std::filesystem::path>& page, const ReportOptions& page_options) {
  if (page) {
    ReportPage written = identification_page(found, data, options, page_options);
    save_text(written.html, *page);
    return std::move(written.verdict);
  }
  try {
    return verdict(found, data, options, page_options);
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
}

// Returns (model, evidence, verdict or None, state or None). The page is written last, so that no page is written if
// something fails before.
nb::tuple identified(const Ensemble& data, IdentifyOptions options, int threads, nb::object listener, bool keep_state,
                     const std::optional<std::filesystem::path>& page, const nb::object& on_model) {
  Call call(std::move(listener));
  options.execution = call.execution(threads);
  if (keep_state && !options.delays) options.delays.emplace();  // a state can't contain dead times
  ReportOptions page_options;
  page_options.model_name = "model";
  page_options.data_name = "data";
  OnModel first;
  if (!on_model.is_none()) first = [&](Model model) { call.ask([&] { on_model(nb::cast(std::move(model))); }); };
  auto [result, judged_as, state] = call.run([&] {
    Identification found = identify(data, options, first);
    std::optional<UpdateState> kept;
    if (keep_state) kept = update_state(data, found, options);
    std::optional<Verdict> judgement = judged(found, data, options, page, page_options);
    return std::tuple(std::move(found), std::move(judgement), std::move(kept));
  });
  const nb::object evidence = object_of(result);
  return nb::make_tuple(std::move(result.model), evidence, judged_as, std::move(state));
}

// Is it one of NumPy's truth values? NumPy 1 calls their type bool_, NumPy 2 calls it bool.
bool is_numpy_bool(nb::handle value) {
  const auto name = nb::cast<std::string>(value.type().attr("__name__"));
  return name == "bool_" || name == "bool";
}

// Converts a value of Python: a truth value, a number (also of NumPy), a word, a sequence of these, or None for "auto".
// Any other value becomes null.
Json json_of(nb::handle value) {
  PyObject* object = value.ptr();
  if (value.is_none()) return "auto";
  if (nb::isinstance<nb::str>(value)) return nb::cast<std::string>(value);
  if (is_numpy_bool(value)) return PyObject_IsTrue(object) == 1;
  if (PyIndex_Check(object)) {
    const Py_ssize_t whole = PyNumber_AsSsize_t(object, nullptr);  // too large numbers become the largest one
    if (!PyErr_Occurred()) return std::int64_t(whole);
    PyErr_Clear();  // an array of NumPy
  }
  if (PySequence_Check(object) && PySequence_Size(object) >= 0) {
    Json list = Json::array();
    for (const nb::handle entry : nb::borrow<nb::sequence>(value)) list.push_back(json_of(entry));
    return list;
  }
  PyErr_Clear();  // an array without dimension has no size
  if (PyFloat_Check(object) || nb::hasattr(value, "__float__")) {
    const double number = PyFloat_AsDouble(object);
    if (PyErr_Occurred()) {
      PyErr_Clear();
      return nullptr;
    }
    return number == std::numeric_limits<double>::infinity() ? Json("infinity") : Json(number);
  }
  return nullptr;
}

// The values of an option that is on or off. Only an option that may be chosen automatically has "auto".
std::string words_of_switch(const Option& option) {
  const bool automatic = std::find(option.words.begin(), option.words.end(), "auto") != option.words.end();
  return automatic ? "one of True, False, None, 'auto'" : "True or False";
}

void set_option(IdentifyOptions& options, const std::string& key, nb::handle value) {
  const Option* option = find_option(key);
  if (!option) throw std::invalid_argument(key + " is no option of an identification");
  if (!option->read(options, json_of(value)))
    throw std::invalid_argument(fmt::format("{}: {} found, {} needed", key, nb::cast<std::string>(nb::repr(value)),
                                            option->is_switch() ? words_of_switch(*option) : option->needed("'")));
}

// Converts the Python dataclass with the choices of an earlier identification.
NoisyChoices choices_of(nb::handle choices) {
  const auto number = [](nb::handle object, const char* name) { return nb::cast<double>(object.attr(name)); };
  const nb::object variation = choices.attr("variation");
  NoisyChoices result;
  result.variation = {number(variation, "smoothing"), nb::cast<Index>(variation.attr("period")),
                      nb::cast<std::vector<Index>>(choices.attr("jumps"))};
  result.state_smoothing = number(choices, "state_smoothing");
  IdentifyOptions options;
  set_option(options, "weighting", choices.attr("weighting"));
  result.weighting = options.weighting.value_or(Weighting::one_step);
  result.refinement_smoothing = number(choices, "refinement_smoothing");
  result.refinement_iterations = nb::cast<Index>(choices.attr("refinement_iterations"));
  result.delays = nb::cast<std::vector<Index>>(choices.attr("delays"));
  return result;
}

nb::object object_of(const RefinedModel& refined) {
  const Refinement& s = refined.refinement;
  return make("Refinement",
              {Field("smoothing", refined.smoothing), Field("reason", refined.reason),
               Field("choice", refined.choice.smoothing.empty() ? std::nullopt : std::optional(refined.choice)),
               FIELD(start_log_likelihood), FIELD(log_likelihood), FIELD(penalised), FIELD(iterations),
               FIELD(converged), FIELD(noise_segments), Field("before", refined.before), Field("after", refined.after),
               Field("findings", refined.findings)});
}

nb::tuple refined(const Model& model, const Ensemble& data, std::optional<double> smoothing,
                  std::optional<Index> period, std::optional<bool> feedthrough, Index iterations, double tolerance,
                  std::optional<InitialState> initial_state, bool accelerate, bool warm_up, int threads,
                  nb::object listener) {
  Call call(std::move(listener));
  RefineModelOptions options;
  options.smoothing = smoothing;
  options.refine.period = period;
  options.feedthrough = feedthrough;
  options.refine.iterations = iterations;
  options.refine.tolerance = tolerance;
  options.refine.initial_state = initial_state;
  options.refine.accelerate = accelerate;
  options.refine.warm_up = warm_up;
  options.refine.execution = call.execution(threads);
  RefinedModel result = call.run([&] { return refine_model(model, data, options); });
  nb::object evidence = object_of(result);
  return nb::make_tuple(std::move(result.refinement.model), evidence);
}

}  // namespace

void bind_identify(nb::module_& module) {
  nb::class_<IdentifyOptions>(module, "IdentifyOptions", "The options of an identification, as the library has them.")
      .def(nb::init<>())
      .def("set", &set_option, nb::arg("key"), nb::arg("value").none(), "One of the table, from what a user has given.")
      .def("follow", [](IdentifyOptions& o, nb::handle choices) { o.choices = choices_of(choices); });
  // (key, range, words) of each option
  module.def("option_table", [] {
    nb::list table;
    for (const Option& option : option_table()) table.append(nb::make_tuple(option.key, option.range, option.words));
    return table;
  });

  module.def("identify", &identified, nb::arg("data"), nb::arg("options"), nb::arg("threads"),
             nb::arg("listener").none(), nb::arg("keep_state"), nb::arg("page").none(), nb::arg("on_model").none());
  module.def(
      "identify_stream",
      [](const std::filesystem::path& from, const std::filesystem::path& to, IdentifyOptions identify, Index block,
         double memory_per_thread, int threads, nb::object listener) {
        Call call(std::move(listener));
        identify.execution = call.execution(threads);
        return call.run([&] {
          const EnsembleFile file(from);
          StreamOptions options;
          options.identify = identify;
          options.block = block;
          options.memory_per_thread = memory_per_thread;
          return identify_stream(file, to, options);
        });
      },
      nb::arg("data"), nb::arg("model"), nb::arg("options"), nb::kw_only(), nb::arg("block"),
      nb::arg("memory_per_thread"), nb::arg("threads"), nb::arg("listener").none());
  module.def("refine", &refined, nb::arg("model"), nb::arg("data"), nb::kw_only(), nb::arg("smoothing").none(),
             nb::arg("period").none(), nb::arg("feedthrough").none(), nb::arg("iterations"), nb::arg("tolerance"),
             nb::arg("initial_state").none(), nb::arg("accelerate"), nb::arg("warm_up"), nb::arg("threads"),
             nb::arg("listener").none());
  module.def(
      "log_likelihoods",
      [](const Model& model, const Ensemble& data, int threads, nb::object listener) {
        Call call(std::move(listener));
        const Execution execution = call.execution(threads);
        return call.run([&] { return log_likelihoods(model, data, execution); });
      },
      nb::arg("model"), nb::arg("data"), nb::kw_only(), nb::arg("threads"), nb::arg("listener").none());
}

}  // namespace tokid::python
