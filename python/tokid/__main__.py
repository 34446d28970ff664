# SPDX-License-Identifier: BSD-3-Clause
"""python -m tokid: the command line tool that was installed with this package, and the command import."""

from __future__ import annotations

import os
import sys
from importlib import metadata
from pathlib import Path


def places(package: Path) -> list[Path]:
    """Where the tool of a package may be. The first of these files that exists is the tool."""
    found = []
    installed = package / "installed-tool.txt"  # the package was linked with an installed tokid
    if installed.exists():
        found.append(Path(installed.read_text(encoding="utf-8").strip()))
    found.append(package.parent / "bin" / "tokid")  # pip install --target
    for distribution in metadata.distributions(name="tokid"):
        # Another tokid may be installed in this Python.
        if Path(str(distribution.locate_file("tokid"))).resolve() == package.resolve():
            # pip lists the programs that it puts beside its Python.
            found += [Path(str(file.locate())) for file in distribution.files or [] if file.name == "tokid"]
    if (package.parents[1] / "CMakeCache.txt").exists():  # a build tree
        found.append(package.parents[1] / "bin" / "tokid")
    return found


def main() -> int:
    """Run the tool with the arguments of this process, and return its exit code. Python runs the command import."""
    if sys.argv[1:2] == ["import"]:
        from tokid import read
        from tokid._reading.command import main as import_tables

        return import_tables(sys.argv[2:], read)
    package = Path(__file__).absolute().parent
    tool = next((path for path in places(package) if path.is_file() and os.access(path, os.X_OK)), None)
    if tool is None:
        print(f"tokid: no command line tool was installed with the package in {package}. The package was built without "
              "the tool, or the tool was removed. Install the package again, or build the tool from source: make build",
              file=sys.stderr)
        return 1
    # The tool takes the place of this process, so that signals and the exit code are its own.
    sys.stdout.flush()
    os.execv(tool, ["tokid", *sys.argv[1:]])


if __name__ == "__main__":
    sys.exit(main())
