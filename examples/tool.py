"""The tool from Python: where it is, its JSON, and where measured data lie. Used by the other examples."""
# SPDX-License-Identifier: BSD-3-Clause

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def executable():
    """TOKID in the environment, else the one that was built here, else the one that is installed."""
    built = ROOT / "build" / "bin" / "tokid"
    found = os.environ.get("TOKID") or (str(built) if built.exists() else shutil.which("tokid"))
    if not found:
        sys.exit("tokid is not built: run make build, or let TOKID hold its path")
    return found


def data_folder():
    """TOKID_DATA in the environment, else shared/data beside the project."""
    return Path(os.environ.get("TOKID_DATA") or ROOT.parent / "shared" / "data")


def run(*arguments):
    """What the tool prints; ends the program where it fails."""
    result = subprocess.run([executable(), *map(str, arguments)], stdin=subprocess.DEVNULL, capture_output=True,
                            text=True, check=False)
    if result.returncode:
        sys.exit(f"tokid {' '.join(map(str, arguments))}\n{result.stderr}")
    return result.stdout


def report(*arguments):
    """The tool's report as a dictionary."""
    return json.loads(run(*arguments, "--json"))
