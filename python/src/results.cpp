// SPDX-License-Identifier: BSD-3-Clause
#include "results.hpp"

namespace tokid::python {

nb::dict dict_of(std::initializer_list<Field> fields) {
  nb::dict dict;
  for (const Field& field : fields) dict[field.name] = field.value;
  return dict;
}

nb::any make(const char* type, std::initializer_list<Field> fields) {
  return any(nb::module_::import_("tokid.results").attr(type)(**dict_of(fields)));
}

NamedValidation::NamedValidation(const Validation& validation, const Channels& names) : Validation(validation) {
  for (const Conclusion& c : tokid::conclusions(validation, names).all()) by_test[to_string(c.test)] = c;
}

}  // namespace tokid::python
