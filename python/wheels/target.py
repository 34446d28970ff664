# SPDX-License-Identifier: BSD-3-Clause
"""A processor that wheels are made for: its compiler, and what tokid is linked with."""

import os
import shutil
from pathlib import Path

from debian import run

GLIBC = "2.28"
DEBIAN_NAMES = {"x86_64": "amd64", "aarch64": "arm64"}
# The oldest processors. zig switches every other feature off, and only this one is not switched on again by AVX-512 where
# Highway asks for it; by itself it does nothing.
PROCESSORS = {"x86_64": "x86_64+evex512", "aarch64": "generic"}
JOBS = min(2, os.cpu_count())
HERE = Path(__file__).parent

# Sources that are compiled, and headers or a library that are taken as they are, each with the release of Debian. HDF5
# before 1.14 runs programs of the target while it is built.
SOURCES = {"zlib": "bookworm", "libzip": "bookworm", "libcsv": "bookworm", "hdf5": "trixie", "fmtlib": "trixie"}
BINARIES = {"libeigen3-dev": "trixie", "libboost1.83-dev": "trixie", "libcli11-dev": "trixie", "libhwy-dev": "trixie",
            "libxxhash-dev": "trixie", "nlohmann-json3-dev": "trixie", "libmatio-dev": "trixie"}
# Those that need no more than a compiler: their headers, and their files
PLAIN = {"zlib": ("libz.a", ("zlib.h", "zconf.h"), "[!g]*.c"),  # what gz*.c has, is not used
         "libcsv": ("libcsv.a", ("csv.h",), "libcsv.c")}
CMAKE_OPTIONS = {
    "libzip": ("-DENABLE_GNUTLS=OFF", "-DENABLE_MBEDTLS=OFF", "-DENABLE_OPENSSL=OFF", "-DENABLE_BZIP2=OFF",
               "-DENABLE_LZMA=OFF", "-DBUILD_TOOLS=OFF", "-DBUILD_REGRESS=OFF", "-DBUILD_EXAMPLES=OFF", "-DBUILD_DOC=OFF"),
    "hdf5": ("-DBUILD_TESTING=OFF", "-DHDF5_BUILD_TOOLS=OFF", "-DHDF5_BUILD_EXAMPLES=OFF", "-DHDF5_BUILD_HL_LIB=OFF",
             "-DHDF5_BUILD_UTILS=OFF", "-DHDF5_ENABLE_Z_LIB_SUPPORT=ON",
             # as in Debian: several threads of a Python program may read files
             "-DHDF5_ENABLE_THREADSAFE=ON"),
    "fmtlib": ("-DFMT_TEST=OFF", "-DFMT_DOC=OFF"),
}


def cmake_build(source, binary, *options, target="install"):
    """Configures and builds, both without a word unless they fail."""
    run("cmake", "-S", source, "-B", binary, "-G", "Ninja", "-DCMAKE_BUILD_TYPE=Release", *options)
    run("cmake", "--build", binary, "--target", target, "--parallel", str(JOBS))


class Target:
    """root/usr holds headers and static libraries, those of the C and the C++ library apart: zig has them."""

    def __init__(self, machine, directory, zig):
        self.machine = machine
        self.directory = directory
        self.root = directory / "root"
        self.compilers = directory / "compilers"
        self.compilers.mkdir(parents=True, exist_ok=True)
        self.tool = self.root / "usr/bin/tokid"
        # Nothing of a wheel tells where it was made.
        words = f"-target {machine}-linux-gnu.{GLIBC} -mcpu={PROCESSORS[machine]} -ffile-prefix-map={HERE.parents[1]}=."
        for name, command in {"cc": f"cc {words}", "c++": f"c++ {words}", "ar": "ar", "ranlib": "ranlib"}.items():
            self._program(name, f'exec "{zig}" {command} "$@"')
        # Libraries are compiled anew with other flags, or another compiler.
        self.made_with = f"{words} {(HERE / 'requirements.txt').read_text()}"
        self.toolchain = directory / "toolchain.cmake"
        self.toolchain.write_text(f"""
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR {machine})
set(CMAKE_C_COMPILER {self.compilers}/cc)
set(CMAKE_CXX_COMPILER {self.compilers}/c++)
set(CMAKE_AR {self.compilers}/ar CACHE FILEPATH "")
set(CMAKE_RANLIB {self.compilers}/ranlib CACHE FILEPATH "")
set(CMAKE_FIND_ROOT_PATH {self.root})
set(CMAKE_LIBRARY_ARCHITECTURE {machine}-linux-gnu)
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
""")
        self.options = (f"-DCMAKE_TOOLCHAIN_FILE={self.toolchain}", f"-DCMAKE_INSTALL_PREFIX={self.root}/usr",
                        "-DCMAKE_INSTALL_LIBDIR=lib", "-DBUILD_SHARED_LIBS=OFF", "-DCMAKE_POSITION_INDEPENDENT_CODE=ON")

    def _program(self, name, command):
        path = self.compilers / name
        path.write_text(f"#!/bin/sh\n{command}\n")
        path.chmod(0o755)

    def unpack(self, debian, package, release):
        return debian.unpack(package, release, DEBIAN_NAMES[self.machine], self.root)

    def build_libraries(self, debian):
        """Their parts: name, version, what becomes of it, file of the licence."""
        parts = []
        for package, release in BINARIES.items():
            use = "linked statically" if package == "libmatio-dev" else "headers that are compiled in"
            version = self.unpack(debian, package, release)
            licence = self.root / "usr/share/doc" / package / "copyright"
            parts.append((package, version, use, None if "boost" in package else licence))
        self._take_matio()
        for package, release in SOURCES.items():
            source, version = debian.source(package, release)
            parts.append((package, version, "linked statically", source / "debian/copyright"))
            # HDF5 would be compiled anew: its configuration writes a header each time.
            stamp, wanted = self.directory / f"{package}.done", f"{version} {self.made_with} {CMAKE_OPTIONS.get(package)}"
            if stamp.exists() and stamp.read_text() == wanted:
                continue
            if package in PLAIN:
                library, headers, files = PLAIN[package]
                for header in headers:
                    shutil.copy2(source / header, self.root / "usr/include")
                self._archive(library, *source.glob(files))
            else:
                cmake_build(source, self.directory / package, *self.options, *CMAKE_OPTIONS[package])
            stamp.write_text(wanted)
        return parts

    def _archive(self, name, *sources):
        """A static library of C files; those of an archive of that name stay in it."""
        objects = [self.directory / f"{source.stem}.o" for source in sources]
        for source, compiled in zip(sources, objects):
            run(self.compilers / "cc", "-O2", "-fPIC", "-c", source, "-o", compiled)
        run(self.compilers / "ar", "rcs", self.root / "usr/lib" / name, *objects)

    def _take_matio(self):
        """Debian's static library needs no symbol that is newer than glibc 2.28."""
        libraries = self.root / "usr/lib"
        shutil.move(libraries / f"{self.machine}-linux-gnu" / "libmatio.a", libraries / "libmatio.a")
        self._archive("libmatio.a", HERE / "standard_streams.c")

    def build_library(self, source):
        """tokid itself, the library and the command line tool, installed in root."""
        cmake_build(source, self.directory / "tokid", *self.options, "-DTOKID_BUILD_TOOL=ON", "-DTOKID_BUILD_EXAMPLES=OFF",
                    "-DTOKID_BUILD_TESTS=OFF",
                    # A wheel needs no symbols of a debugger, and the tool no path to a library. With -pie, the system
                    # loads the tool at random addresses.
                    "-DCMAKE_EXE_LINKER_FLAGS=-s -pie", "-DCMAKE_SKIP_INSTALL_RPATH=ON",
                    # Boost's long double overflows in gamma_q here: tokid.paper() failed. Doubles are enough.
                    "-DCMAKE_CXX_FLAGS=-DBOOST_MATH_PROMOTE_DOUBLE_POLICY=false")
