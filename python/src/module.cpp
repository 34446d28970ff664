// The extension module: the types and functions of the library, nearly unchanged. Users see python/tokid/*.py instead.
// SPDX-License-Identifier: BSD-3-Clause

#include <stdexcept>
#include <string>
#include <utility>

#include "linalg/simd.hpp"
#include "python.hpp"
#include "words.hpp"

NB_MODULE(_tokid, module) {
  namespace nb = nanobind;
  namespace python = tokid::python;

  tokid::simd::target();  // refuses a wrong TOKID_SIMD before any work
  module.doc() = "Bindings of the C++ library tokid; private, see the package tokid.";
  module.attr("version") = std::string(tokid::version);
  module.attr("test_lags") = tokid::test_lags;
  // nanobind already turns std::bad_alloc into MemoryError, and other std::exceptions into RuntimeError.
  const nb::exception<tokid::IoError> io_error(module, "IoError", PyExc_OSError);
  io_error.attr("__doc__") =
      "A file that can't be read or written, or does not hold what it should: names the file, the data set, what was "
      "found and what is needed.";
  nb::register_exception_translator(
      [](const std::exception_ptr& thrown, void* type) {
        try {
          std::rethrow_exception(thrown);
        } catch (const tokid::WriteError& error) {
          const nb::object raised = nb::borrow(static_cast<PyObject*>(type))(python::in_python(error.what()));
          if (error.error() != 0) raised.attr("errno") = error.error();
          PyErr_SetObject(static_cast<PyObject*>(type), raised.ptr());
        } catch (const tokid::IoError& error) {
          PyErr_SetString(static_cast<PyObject*>(type), python::in_python(error.what()).c_str());
        } catch (const std::invalid_argument& error) {
          PyErr_SetString(PyExc_ValueError, python::in_python(error.what()).c_str());
        }
      },
      io_error.ptr());
  module.def("in_python", [](std::string text) { return python::in_python(std::move(text)); });

  using namespace python;
  for (const auto bind : {bind_ensemble, bind_model, bind_io, bind_example, bind_report, bind_update, bind_identify,
                          bind_validate, bind_confidence, bind_modes, bind_plan, bind_control, bind_stages})
    bind(module);
}
