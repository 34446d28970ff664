# Everything from a bare Debian 12 or 13 machine on: what is missing is installed with apt-get, as root or through sudo.

build_packages := g++ cmake ninja-build libeigen3-dev libboost-dev libhdf5-dev libmatio-dev libzip-dev zlib1g-dev \
                  libcsv-dev libcli11-dev libfmt-dev libhwy-dev libxxhash-dev nlohmann-json3-dev
test_packages  := $(build_packages) git libgtest-dev libopenmpi-dev openmpi-bin \
                  python3 python3-numpy python3-scipy python3-h5py python3-pytest \
                  python3-dev python3-venv chromium fonts-dejavu-core octave octave-control \
                  clang gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm
wheel_packages := cmake ninja-build binutils debian-archive-keyring dpkg-dev python3 python3-venv
wheel_test_packages := $(build_packages) debootstrap python3 python3-venv qemu-user-static
bench_packages := $(build_packages) libbenchmark-dev libopenblas-serial-dev libopenmpi-dev openmpi-bin \
                  python3 python3-numpy python3-h5py python3-dev python3-venv octave octave-control
compare_packages := $(build_packages) python3 python3-dev python3-venv octave octave-control
cover_packages := $(test_packages) gcovr
grind_packages := $(test_packages) valgrind
fuzz_packages  := $(build_packages) clang-16 libclang-rt-16-dev python3
tidy_packages  := $(test_packages) libbenchmark-dev libopenblas-serial-dev cppcheck
package_packages := $(build_packages) dpkg-dev file help2man python3
release_packages := $(package_packages) debootstrap lintian python3-venv
docs_packages := $(build_packages) doxygen python3 python3-dev python3-venv
portability_packages := debootstrap git python3 python3-numpy python3-h5py

# $(call install,PACKAGES) installs those that are missing; where there is no dpkg, they are the user's business.
install = @wanted="$(strip $(1))"; \
  command -v dpkg-query >/dev/null || { echo "Not a Debian machine; taken as installed: $$wanted"; exit 0; }; \
  have=" $$(dpkg-query -W -f='$${Package} $${db:Status-Status}\n' $$wanted 2>/dev/null | \
            sed -n 's/ installed$$//p' | tr '\n' ' ')"; \
  missing=; for package in $$wanted; do case "$$have" in *" $$package "*) ;; *) missing="$$missing $$package";; esac; done; \
  test -n "$$missing" || exit 0; \
  echo "Installing$$missing"; \
  sudo=; test "$$(id -u)" = 0 || sudo=sudo; \
  $$sudo apt-get -qq update && \
  $$sudo env DEBIAN_FRONTEND=noninteractive apt-get -qq -o DPkg::Lock::Timeout=300 \
    install --no-install-recommends $$missing >/dev/null

# TOKID_WARNINGS_AS_ERRORS=ON, as .ci/run says it, stops at warnings in tokid's own code. The build directory remembers it.
configure = cmake --log-level=WARNING $(if $(TOKID_WARNINGS_AS_ERRORS),-DTOKID_WARNINGS_AS_ERRORS=$(TOKID_WARNINGS_AS_ERRORS)) \
  --preset
# Debian's own, which has the packages above; another one may come first on the path.
python := $(firstword $(wildcard /usr/bin/python3) python3)

.PHONY: help build demo test test-all docs gallery wheel wheels wheel-test package release release-test portability bench studies zoo compare sbom install-test asan tsan valgrind coverage fuzz tidy format clean

help:
	@echo 'make demo          the tool, then the main job on the example of the paper (files in build/demo)'
	@echo 'make test          build with the tests and run what a change needs'
	@echo 'make test-all      the same, and the slow tests, of many systems, other programs and the printed documents'
	@echo 'make docs          the site: documents, references, gallery (build/docs/html/index.html)'
	@echo 'make gallery       runs the examples of EXAMPLES, all unless told otherwise, for the outputs that the gallery shows'
	@echo 'make wheel         the Python package for this Python as a wheel for any Linux with glibc 2.28 (build/wheel)'
	@echo 'make wheels        those of all Pythons from 3.9 on, for x86_64 and aarch64; for half an hour'
	@echo 'make wheel-test    installs them on Debian 11 and 13, for arm64 in QEMU; as root, for some minutes'
	@echo 'make package       packages for Debian, an archive, their sums, release notes (build/package)'
	@echo 'make release       all files of a release, of the last commit: package, wheels, sbom, docs (build/release-VERSION)'
	@echo 'make release-test  installs these on a Debian that debootstrap makes; as root, for some minutes'
	@echo 'make portability   builds and tests the last commit on other systems (docs/portability.md); as root, for hours'
	@echo 'make bench         measures time and memory for twenty minutes, writes the tables of docs/performance.md'
	@echo 'make studies       rounding errors, coverage, defects, noise, outliers: prints the tables of docs/ (tests/studies/README.md)'
	@echo 'make zoo           identifies the plants of docs/plants.md and measured ensembles, for an hour: prints the tables'
	@echo 'make compare       tokid beside other methods for twenty minutes, writes the tables of docs/comparison.md'
	@echo 'make sbom          what tokid consists of, with versions, in CycloneDX (build/tokid.cdx.json)'
	@echo 'make build         the tool (build/bin/tokid), the library, the examples'
	@echo 'make install-test  only the tests of the installed package'
	@echo 'make asan          all tests under the address and undefined behaviour sanitizers'
	@echo 'make tsan          all tests under the thread sanitizer'
	@echo 'make fuzz          every fuzzer for FUZZ_SECONDS, ten minutes unless told otherwise'
	@echo 'make valgrind      the end-to-end tests with the tool under valgrind, but for what the Makefile names'
	@echo 'make coverage      which lines of the library the tests run: build-coverage/report/index.html'
	@echo 'make tidy          clang-tidy and cppcheck, whose warnings are errors'
	@echo 'make format        clang-format, in place'
	@echo 'make clean         remove what was built'

build:
	$(call install,$(build_packages))
	@$(configure) release >/dev/null
	@cmake --build build

demo:
	$(call install,$(build_packages))
	@$(configure) release >/dev/null
	@cmake --build build --target tokid_tool
	@examples/demo.sh build/bin build/demo

# LEVEL: avx2, sse4 or baseline for results as on an older processor
test test-all:
	$(call install,$(test_packages))
	@$(configure) test $(if $(filter test-all,$@),-DTOKID_BUILD_STUDIES=ON) >/dev/null
	@cmake --build build --target all tests_environment
	@$(python) tests/run.py build $(if $(LEVEL),--as $(LEVEL)) $(if $(filter test,$@),--label-exclude slow)

# The package and the tool, and the environment of the site, which needs no network from then on.
define site_environment
@$(configure) release -DTOKID_BUILD_PYTHON=ON >/dev/null
@cmake --build build --target tokid_tool _tokid
@$(python) tests/set_up.py build/docs-venv python/requirements-test.txt docs/requirements.txt
endef

docs:
	$(call install,$(docs_packages))
	$(site_environment)
	@build/docs-venv/bin/python docs/site/build.py build/docs

# TOKID_DATA: folder with measured data, as the examples on them tell
gallery:
	$(call install,$(docs_packages))
	$(site_environment)
	@PYTHONPATH=build/python build/docs-venv/bin/python examples/python/notebooks.py --run $(EXAMPLES)

wheel:
	$(call install,$(wheel_packages))
	@$(python) python/wheels/make_wheels.py . build/wheel

wheels:
	$(call install,$(wheel_packages))
	@$(python) python/wheels/make_wheels.py . build/wheel --all

wheel-test: build
	$(call install,$(wheel_test_packages))
	@$(python) python/wheels/try_wheels.py build build/wheel build/wheel-test

package: build
	$(call install,$(package_packages))
	@$(python) release/make_packages.py . build build/package

# WHEELS: wheel for that of this machine's Python alone
WHEELS ?= wheels

release:
	$(call install,git python3)
	@$(python) release/make_release.py begin . build
	@set -e; for target in package $(WHEELS) sbom docs; do $(MAKE) --no-print-directory $$target; done
	@$(python) release/make_release.py finish . build

release-test: package
	$(call install,$(release_packages))
	@$(python) release/try_packages.py . build/package build/release

# ROWS: some of those of docs/portability.md, all unless told otherwise
portability:
	$(call install,$(portability_packages))
	@$(python) release/portability.py . build/portability $(ROWS)

bench:
	$(call install,$(bench_packages))
	@$(configure) bench >/dev/null
	@cmake --build build
	@$(python) tests/set_up.py build/bench-venv bench/requirements.txt
	@$(python) tests/set_up.py build/bench-venv bench/requirements-competitors.txt || echo 'Not all competitors are measured'
	@$(python) bench/performance.py build

# STUDIES: some of those of tests/studies/README.md, all unless told otherwise
STUDIES ?= accuracy coverage defects noise outliers

studies:
	$(call install,$(test_packages))
	@$(configure) test >/dev/null
	@cmake --build build --target $(STUDIES:%=tokid_%)
	@set -e; for study in $(STUDIES); do echo; echo "$$study"; build/bin/tokid_$$study; done

# Goes on where it was stopped. ZOO: arguments of bench/zoo/run.py, like --grid or --cells REGEX
zoo: build
	$(call install,python3 python3-numpy python3-scipy)
	@$(python) bench/zoo/run.py --tool build/bin/tokid --jobs 2 -o build/zoo.jsonl $(ZOO)
	@$(python) bench/zoo/run.py --tool build/bin/tokid --jobs 2 -o build/zoo.jsonl --recorded
	@$(python) bench/zoo/table.py build/zoo.jsonl

# Goes on where it was stopped. COMPARE: arguments of bench/compare/run.py, like --short or --print
compare:
	$(call install,$(compare_packages))
	@$(configure) release -DTOKID_BUILD_PYTHON=ON >/dev/null
	@cmake --build build --target _tokid
	@$(python) tests/set_up.py build/bench-venv bench/requirements.txt bench/requirements-compare.txt
	@PYTHONPATH=$(CURDIR)/build/python build/bench-venv/bin/python bench/compare/run.py -o build/compare.jsonl $(COMPARE)

sbom: build
	@$(python) cmake/sbom.py . build build/tokid.cdx.json

install-test:
	$(call install,$(test_packages))
	@$(configure) test >/dev/null
	@cmake --build build
	@$(python) tests/run.py build --label-regex install --build-config Install

asan tsan:
	$(call install,$(test_packages))
	@$(configure) $@ >/dev/null
	@cmake --build build-$@
	@UBSAN_OPTIONS=print_stacktrace=1 TSAN_OPTIONS=halt_on_error=1:suppressions=$(CURDIR)/tests/races.supp \
	  LSAN_OPTIONS=suppressions=$(CURDIR)/tests/leaks.supp:print_suppressions=0 \
	  $(python) tests/run.py build-$@

# Left out: what measures time and memory, kills the tool, or starts it from other programs; and what would take hours
# for numerics that the others reach too. Each call takes two seconds to begin.
not_ground := blocks faults hostile mpi octave performance release sbom terminal docs examples noise pendubot
ground     := $(filter-out $(not_ground:%=tests/e2e/test_%.py),$(wildcard tests/e2e/test_*.py))

valgrind: build
	$(call install,$(grind_packages))
	@cd tests/e2e && printf '%s\n' $(notdir $(ground)) | \
	  TOKID=$(CURDIR)/tests/under_valgrind.sh TOKID_UNDER_VALGRIND=$(CURDIR)/build/bin/tokid \
	  xargs -n 1 -P $$(nproc) $(python) -m pytest -q -p no:cacheprovider

# At least nine lines of ten. What a line is to be left out for stands beside it.
coverage:
	$(call install,$(cover_packages))
	@$(configure) $@ >/dev/null
	@cmake --build build-$@
	@find build-$@ -name '*.gcda' -delete
	@GCOV_ERROR_FILE=/dev/null $(python) tests/run.py build-$@ --label-regex 'unit|e2e|slow'
	@mkdir -p build-$@/report
	@gcovr --root . --filter src/ --filter include/ --exclude-throw-branches --print-summary --fail-under-line 90 \
	  --html-details build-$@/report/index.html --txt build-$@/report/lines.txt build-$@

FUZZ_SECONDS ?= 600

fuzz:
	$(call install,$(fuzz_packages))
	@$(configure) fuzz >/dev/null
	@cmake --build build-fuzz --target fuzzers
	@$(python) fuzz/run.py build-fuzz $(FUZZ_SECONDS)

# The clang-tidy of PyPI leaves out what system headers declare, which Debian's spends most of its time with.
tidy_tools := build-tidy/tools/bin

tidy:
	$(call install,$(tidy_packages))
	@$(configure) dev -B build-tidy -DTOKID_BUILD_BENCH=ON -DTOKID_BUILD_PYTHON=ON -DTOKID_WITH_MPI=ON >/dev/null
	@cppcheck --std=c++20 --language=c++ --library=googletest --enable=warning,performance,portability --inline-suppr \
	  --suppress=missingIncludeSystem --error-exitcode=1 -Iinclude -Isrc -Iapp -Ibuild-tidy/include -q \
	  src app bench examples python/src tests fuzz
	@test -x $(tidy_tools)/clang-tidy || $(python) -m venv build-tidy/tools
	@$(tidy_tools)/pip install --quiet --disable-pip-version-check --requirement cmake/requirements-tidy.txt
	@$(tidy_tools)/python $(tidy_tools)/run-clang-tidy.py -quiet -clang-tidy-binary $(tidy_tools)/clang-tidy \
	  -p build-tidy '$(CURDIR)/(src|app|bench|examples|python/src|tests|fuzz)/'

format:
	$(call install,clang-format)
	@find include src app bench examples tests python fuzz -name '*.[ch]pp' -exec clang-format -i {} +

clean:
	rm -rf build build-asan build-tsan build-coverage build-fuzz build-tidy build-dev
