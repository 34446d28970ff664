#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""A virtual environment with packages from PyPI, made once: set_up.py DIRECTORY REQUIREMENTS ...

What is in it already stays; files of requirements that are new or were changed are installed.
"""

import json
import subprocess
import sys
import venv
from pathlib import Path


def main():
    directory, files = Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]]
    stamp = directory / "installed.json"
    try:
        installed = json.loads(stamp.read_text())
    except (OSError, ValueError):  # none yet, or one that was cut off
        installed = {}
    wanted = {file.name: file.read_text() for file in files}
    if wanted.items() <= installed.items():
        return
    if not installed:
        venv.create(directory, clear=True, with_pip=True)
    requirements = [word for file in files for word in ("--requirement", file)]
    subprocess.run([directory / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check",
                    *requirements], check=True)
    stamp.write_text(json.dumps(installed | wanted))


if __name__ == "__main__":
    main()
