# SPDX-License-Identifier: BSD-3-Clause
"""python -m tokid: the command line tool that was installed with this package."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib import metadata
from pathlib import Path


def places(package: Path) -> list[Path]:
    """Where the tool of a package may be, the nearest one first."""
    name = "tokid.exe" if os.name == "nt" else "tokid"
    # The first one is that of `pip install --target`, and the second one that of a build tree.
    found = [package.parent / "bin" / name, package.parents[1] / "bin" / name]
    installed = package / "installed-tool.txt"  # the package was linked with an installed tokid
    if installed.exists():
        found.append(Path(installed.read_text(encoding="utf-8").strip()))
    try:
        files = metadata.files("tokid") or []
    except metadata.PackageNotFoundError:
        files = []
    # pip lists the programs that it puts beside its Python.
    return found + [Path(str(file.locate())) for file in files if file.name == name]


def main() -> int:
    """Run the tool with the arguments of this process, and return its exit code."""
    package = Path(__file__).absolute().parent
    tool = next((path for path in places(package) if path.is_file()), None)
    if tool is None:
        print(f"tokid: no command line tool was installed with the package in {package}. The package was built without "
              "the tool, or the tool was removed. Install the package again, or build the tool from source: make build",
              file=sys.stderr)
        return 1
    if os.name == "nt":
        return subprocess.run([tool, *sys.argv[1:]], check=False).returncode
    # The tool takes the place of this process, so that signals and the exit code are its own.
    sys.stdout.flush()
    os.execv(tool, ["tokid", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
