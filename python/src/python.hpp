// What all files of the extension module share.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
// A caster that one file lacks shows when it is called, not when it is compiled: all have all of them.
#include <nanobind/stl/filesystem.h>
#include <nanobind/stl/optional.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/vector.h>

#include "tokid/tokid.hpp"

namespace tokid::python {

namespace nb = nanobind;

void bind_ensemble(nb::module_& module);
void bind_model(nb::module_& module);
void bind_identify(nb::module_& module);
void bind_io(nb::module_& module);
void bind_example(nb::module_& module);
void bind_validate(nb::module_& module);

}  // namespace tokid::python
