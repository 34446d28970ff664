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
  const nb::exception<tokid::IoError> io_error(module, "IoError", PyExc_OSError);
  io_error.attr("__doc__") =
      "A file that can't be read or written, or does not hold what it should: names the file, the data set, what was "
      "found and what is needed.";
  nb::register_exception_translator(
      [](const std::exception_ptr& thrown, void* type) {
        try {
          std::rethrow_exception(thrown);
        } catch (const tokid::WriteError& error) {
          const nb::object raised = nb::borrow(static_cast<PyObject*>(type))(error.what());
          if (error.error() != 0) raised.attr("errno") = error.error();
          PyErr_SetObject(static_cast<PyObject*>(type), raised.ptr());
        }
      },
      io_error.ptr());

  bind_ensemble(module);
  bind_model(module);
  bind_io(module);
  bind_example(module);
  bind_report(module);
  bind_update(module);
  bind_identify(module);
  bind_stream(module);
  bind_validate(module);
  bind_cross_validate(module);
  bind_refine(module);
  bind_confidence(module);
  bind_plan(module);
}
