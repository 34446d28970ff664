// The extension module: the library's types and functions, nearly as they are. What users see is python/tokid/*.py.
// SPDX-License-Identifier: BSD-3-Clause

#include <string>

#include "python.hpp"

NB_MODULE(_tokid, module) {
  namespace nb = nanobind;
  using namespace tokid::python;

  module.doc() = "Bindings of the C++ library tokid; private, see the package tokid.";
  module.attr("version") = std::string(tokid::version);
  // std::invalid_argument is a ValueError already, std::bad_alloc a MemoryError, other std::exceptions RuntimeErrors.
  nb::exception<tokid::IoError>(module, "IoError", PyExc_OSError);

  bind_ensemble(module);
  bind_model(module);
  bind_io(module);
  bind_identify(module);
  bind_validate(module);
  bind_example(module);
}
