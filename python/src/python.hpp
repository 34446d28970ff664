// The common parts of all files of the extension module.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
// All files include all casters: a missing caster causes no error when the file is compiled, but only when the function
// is called.
#include <nanobind/eigen/dense.h>
#include <nanobind/stl/complex.h>
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/map.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include <utility>

#include "tokid/tokid.hpp"

namespace tokid::python {

namespace nb = nanobind;

// An object that has the type typing.Any in the stubs.
inline nb::any any(nb::object object) { return nb::steal<nb::any>(object.release()); }

// Functions with it do not hold the GIL.
inline constexpr nb::call_guard<nb::gil_scoped_release> no_gil;

// The properties with the names and units of the channels.
template <class Class>
void def_channels(nb::class_<Class>& type) {
  using Texts = std::vector<std::string>;
  const auto def = [&type](const char* name, Texts Channels::*texts) {
    type.def_prop_rw(
        name, [texts](const Class& object) { return object.names.*texts; },
        [texts](Class& object, Texts given) { object.names.*texts = std::move(given); });
  };
  def("input_names", &Channels::input_names);
  def("output_names", &Channels::output_names);
  def("input_units", &Channels::input_units);
  def("output_units", &Channels::output_units);
}

void bind_ensemble(nb::module_& module);
void bind_model(nb::module_& module);
void bind_identify(nb::module_& module);
void bind_io(nb::module_& module);
void bind_example(nb::module_& module);
void bind_validate(nb::module_& module);
void bind_confidence(nb::module_& module);
void bind_modes(nb::module_& module);
void bind_plan(nb::module_& module);
void bind_report(nb::module_& module);
void bind_update(nb::module_& module);
void bind_control(nb::module_& module);
void bind_stages(nb::module_& module);

}  // namespace tokid::python
