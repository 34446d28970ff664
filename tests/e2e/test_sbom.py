# SPDX-License-Identifier: BSD-3-Clause
"""make sbom: what tokid consists of, in a form that other programs know."""

import json
import re
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).parents[2]


def test_components(tokid, tmp_path):
    build = Path(tokid.executable).parents[1]
    for name in ("one.json", "two.json"):
        subprocess.run([sys.executable, SOURCE / "cmake" / "sbom.py", SOURCE, build, tmp_path / name], check=True)
    assert (tmp_path / "one.json").read_bytes() == (tmp_path / "two.json").read_bytes()
    bom = json.loads((tmp_path / "one.json").read_text())
    assert (bom["bomFormat"], bom["specVersion"]) == ("CycloneDX", "1.5")
    own = bom["metadata"]["component"]
    assert f"tokid {own['version']}\n" == tokid("--version").stdout
    parts = {part["name"]: part for part in bom["components"]}
    assert len(parts) == len(bom["components"]) == len({part["bom-ref"] for part in bom["components"]})
    # Each Debian has its own numbers in the names of libraries.
    for name in (r"libhdf5-\d+.*", r"libmatio\d+", r"libzip\d+", r"libcsv\d+", "zlib1g", "libc6", r"libstdc\+\+6",
                 "libeigen3-dev", "uPlot", "numpy"):
        (found,) = (part for part in parts.values() if re.fullmatch(name, part["name"]))
        assert found["version"] and found["scope"] == "required", name
    for part in parts.values():
        assert part["type"] == "library" and part["purl"].startswith("pkg:")
    (dependencies,) = bom["dependencies"]
    assert dependencies["ref"] == own["bom-ref"]
    assert set(dependencies["dependsOn"]) < {part["bom-ref"] for part in parts.values()}
