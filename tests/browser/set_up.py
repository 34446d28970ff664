#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A virtual environment with Playwright for the browser tests, made once: set_up.py DIRECTORY

It sees the packages of the system (pytest, NumPy) and adds those of requirements.txt.
"""

import subprocess
import sys
import venv
from pathlib import Path

WANTED = Path(__file__).with_name("requirements.txt")


def main():
    directory = Path(sys.argv[1])
    stamp = directory / "installed.txt"
    if stamp.exists() and stamp.read_text() == WANTED.read_text():
        return
    venv.create(directory, system_site_packages=True, clear=True, with_pip=True)
    subprocess.run([directory / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
                    "--requirement", WANTED], check=True)
    stamp.write_text(WANTED.read_text())


if __name__ == "__main__":
    main()
