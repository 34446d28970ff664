# The virtual environment of the tests that take packages from PyPI: of the Python package, and of pages in a browser.
# The Python package is built with the same one, unless Python_EXECUTABLE names another Python that has nanobind.
find_program(TOKID_BASE_PYTHON python3 HINTS /usr/bin DOC "The Python of which the tests' environment is made")
set(TOKID_VENV ${PROJECT_BINARY_DIR}/venv)
# What the extension is built with comes first, the rest while it is built.
set(TOKID_SET_UP_BUILD ${TOKID_BASE_PYTHON} ${PROJECT_SOURCE_DIR}/tests/set_up.py ${TOKID_VENV}
    ${PROJECT_SOURCE_DIR}/python/requirements-build.txt)
set(TOKID_SET_UP_TESTS ${TOKID_SET_UP_BUILD}
    ${PROJECT_SOURCE_DIR}/python/requirements-test.txt ${PROJECT_SOURCE_DIR}/tests/browser/requirements.txt)
