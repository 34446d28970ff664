#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""pip install of the checkout on a tokid that is installed: try_install.py SOURCE PREFIX DIRECTORY VERSION

A fresh environment in DIRECTORY gets the package, whose extension is linked with the library below PREFIX, and runs it.
The environment gets no command `tokid` of its own. `python -m tokid` runs the tool below PREFIX, if there is one.
"""

import os
import subprocess
import sys
import venv
from pathlib import Path

TRIAL = """
import sys
from importlib.metadata import version
import tokid
from tokid import _tokid
assert tokid.__file__.startswith(sys.prefix), tokid.__file__
assert version("tokid") == tokid.__version__ == sys.argv[2]
libraries = [line.split()[-1] for line in open("/proc/self/maps") if "libtokid" in line]
assert libraries and all(path.startswith(sys.argv[1]) for path in libraries), libraries
for name in ("py.typed", "_tokid.pyi", "results.py"):
    assert __import__("pathlib").Path(tokid.__file__).with_name(name).exists(), name
data = tokid.example("oscillator", experiments=30, steps=30)
model = tokid.identify(data.u, data.y, dt=data.dt)
assert model.states == 4 and abs(model.simulate(data) - data.y).max() < 1e-8
"""


def main():
    source, prefix, directory = (Path(word).resolve() for word in sys.argv[1:4])
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    venv.create(directory / "environment", clear=True, with_pip=True)
    python = directory / "environment" / "bin" / "python"
    subprocess.run([python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", source,
                    "--config-settings", "cmake.define.TOKID_USE_INSTALLED=ON",
                    "--config-settings", f"cmake.define.CMAKE_PREFIX_PATH={prefix}",
                    # Compiled without optimisation, which takes half the time.
                    "--config-settings", "cmake.build-type=Debug",
                    "--config-settings", "cmake.define.CMAKE_CXX_FLAGS_DEBUG=-O0",
                    "--config-settings", f"build-dir={directory / 'build'}"], check=True, env=environment)
    subprocess.run([python, "-c", TRIAL, prefix, sys.argv[4]], check=True, cwd=directory, env=environment)
    assert not python.with_name("tokid").exists(), "a second tool beside the one that is installed"
    if (prefix / "bin" / "tokid").exists():
        told = subprocess.run([python, "-m", "tokid", "--version"], check=True, cwd=directory, env=environment,
                              capture_output=True, text=True).stdout
        assert told == f"tokid {sys.argv[4]}\n", told


if __name__ == "__main__":
    main()
