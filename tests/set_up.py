#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A virtual environment with what the tests take from PyPI, made once: set_up.py DIRECTORY REQUIREMENTS ..."""

import subprocess
import sys
import venv
from pathlib import Path


def main():
    directory, files = Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]]
    wanted = "".join(file.read_text() for file in files)
    stamp = directory / "installed.txt"
    if stamp.exists() and stamp.read_text() == wanted:
        return
    venv.create(directory, clear=True, with_pip=True)
    requirements = [word for file in files for word in ("--requirement", file)]
    subprocess.run([directory / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
                    *requirements], check=True)
    stamp.write_text(wanted)


if __name__ == "__main__":
    main()
