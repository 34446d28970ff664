// The library's results as the dataclasses of tokid/results.py: one keyword for each field of the C++ struct.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "python.hpp"

namespace tokid::python {

nb::object object_of(const Fit& fit);
nb::object object_of(const Validation& validation);
nb::object object_of(const NoisyChoices& choices);
nb::object object_of(const Identification& result);  // without its model and warnings

nb::list texts(const std::vector<std::string>& texts);

}  // namespace tokid::python
