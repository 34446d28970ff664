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
#include "tokid/report.hpp"
#include "tokid/update.hpp"

namespace tokid::python {

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
                     const std::optional<std::filesystem::path>& page, const ReportOptions& page_options,
                     const nb::object& on_model) {
  Call call(std::move(listener));
  options.execution = call.execution(threads);
  if (keep_state && !options.delays) options.delays.emplace();  // a state can't contain dead times
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
             nb::arg("listener").none(), nb::arg("keep_state") = false, nb::arg("page").none() = nb::none(),
             nb::arg("page_options") = ReportOptions(), nb::arg("on_model").none() = nb::none());
}

}  // namespace tokid::python
