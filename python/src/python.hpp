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

#include "tokid/tokid.hpp"

namespace tokid::python {

namespace nb = nanobind;

// An object that has the type typing.Any in the stubs.
inline nb::any any(nb::object object) { return nb::steal<nb::any>(object.release()); }

void bind_ensemble(nb::module_& module);
void bind_model(nb::module_& module);
void bind_identify(nb::module_& module);
void bind_io(nb::module_& module);
void bind_example(nb::module_& module);
void bind_validate(nb::module_& module);
void bind_refine(nb::module_& module);
void bind_confidence(nb::module_& module);
void bind_modes(nb::module_& module);
void bind_cross_validate(nb::module_& module);
void bind_plan(nb::module_& module);
void bind_report(nb::module_& module);
void bind_stream(nb::module_& module);
void bind_update(nb::module_& module);
void bind_control(nb::module_& module);
void bind_stages(nb::module_& module);

}  // namespace tokid::python
