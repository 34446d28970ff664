// Converts the results of the library to the dataclasses of tokid/results.py. Each field of a C++ struct becomes a
// keyword of the dataclass.
// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <initializer_list>
#include <string>
#include <utility>
#include <vector>

#include "python.hpp"

namespace tokid::python {

namespace results {

nb::object cast(const std::string& value);
nb::object cast(const char* value);
nb::object cast(bool value);
nb::object cast(Index value);
nb::object cast(double value);
nb::object cast(const Vector& value);
nb::object cast(const Matrix& value);
nb::object cast(const std::vector<double>& value);
nb::object cast(nb::object value);
template <class T>
nb::object cast(const std::vector<T>& values) {
  nb::list list;
  for (const T& value : values) list.append(cast(value));
  return list;
}

}  // namespace results

// A field of a dataclass: its name and its value. make() makes the dataclass with the name `type`.
struct Field {
  template <class T>
  Field(const char* field_name, T&& field_value)
      : name(field_name), value(results::cast(std::forward<T>(field_value))) {}
  const char* name;
  nb::object value;
};
nb::any make(const char* type, std::initializer_list<Field> fields);

nb::any object_of(const Fit& fit);
nb::any object_of(const ExperimentFits& fits);
nb::any object_of(const Similarity& similarity);
nb::any object_of(const Validation& validation, const Channels& names);
nb::any object_of(const NoisyChoices& choices);
nb::any object_of(const LikelihoodChoice& choice);
nb::any object_of(const Verdict& verdict);
nb::any object_of(const Identification& result);  // without its model

nb::list texts(const std::vector<std::string>& texts);
nb::list list_of(const Findings& findings);  // a list of Finding

}  // namespace tokid::python
