# SPDX-License-Identifier: BSD-3-Clause
"""Every include and every import of the Python package points down: no cycle among files or among rooms. A header and
the source of its name are one file."""

import ast
import re

from conftest import ROOT

# Who owns a public header that has no source of its name.
OWNERS = {"types": "base", "printable": "base", "progress": "base", "team": "base", "validate": "model", "subspace": "noise",
          "outlier": "diagnose", "choices": "choose", "stream": "large", "io": "io",
          "uncertainty": "uncertainty", "design": "design", "report": "report"}
EVERYTHING = "tokid/tokid"  # the header that includes all others
PACKAGE = ROOT / "python" / "tokid"


def files():
    found = [path for folder in ("src", "include/tokid") for path in (ROOT / folder).rglob("*.[ch]pp")]
    return [path for path in found if "vendor" not in path.parts]


def unit_of(path, sources):
    """The name of a header and its source, "room/name"; "tokid/name" for a public header without a source."""
    if (ROOT / "src") in path.parents:
        return str(path.relative_to(ROOT / "src").with_suffix(""))
    own = [source for source in sources if source.endswith("/" + path.stem)]
    assert len(own) <= 1, f"{path.name} belongs to several: {own}"
    return own[0] if own else f"tokid/{path.stem}"


def included(path):
    for name in re.findall(r'^#include "([^"]+)"', path.read_text(), re.MULTILINE):
        for folder in ("src", "include"):
            if (ROOT / folder / name).exists():
                yield ROOT / folder / name


def includes():
    """Unit → the units that it includes."""
    paths = files()
    sources = {str(path.relative_to(ROOT / "src").with_suffix("")) for path in paths if path.suffix == ".cpp"}
    edges = {}
    for path in paths:
        unit = unit_of(path, sources)
        edges.setdefault(unit, set()).update(unit_of(other, sources) for other in included(path))
        edges[unit].discard(unit)
    return edges


def knots(edges):
    """What is left when all that depends on nothing, or on which nothing depends, is taken away again and again."""
    left = {unit: set(others) for unit, others in edges.items()}
    while True:
        used = set().union(*left.values()) if left else set()
        ends = [unit for unit, others in left.items() if not others or unit not in used]
        if not ends:
            return left
        for unit in ends:
            del left[unit]
        for others in left.values():
            others.difference_update(ends)


def table_of_rooms():
    """The rooms of CONTRIBUTING.md. Those of a line come in this order, too."""
    table = (ROOT / "CONTRIBUTING.md").read_text().split("## Rooms")[1].split("\n## ")[0]
    lines = re.findall(r"^\| (`.*?) \|", table, re.MULTILINE)
    return [name for line in lines for name in re.findall(r"`([\w/]+)`", line)]


def room(unit, rooms):
    """The folder of a unit, or the folder around it, that is a room."""
    folder, _, name = unit.rpartition("/")
    if folder == "tokid":
        return OWNERS[name]
    return folder if folder in rooms else folder.split("/")[0]


def test_files():
    edges = includes()
    assert len(edges) > 150 and any(edges.values())
    assert {f"tokid/{name}" for name in OWNERS} == {unit for unit in edges if unit.startswith("tokid/")} - {EVERYTHING}
    assert knots(edges) == {}


def test_rooms():
    order = table_of_rooms()
    edges = {}
    for unit, others in includes().items():
        if unit != EVERYTHING:
            edges.setdefault(room(unit, order), set()).update(room(other, order) for other in others)
    for name, others in edges.items():
        others.discard(name)
    assert knots(edges) == {}
    assert set(order) == set(edges)
    for name, others in edges.items():
        above = set(order[:order.index(name)])
        assert others <= above, f"{name} includes {others - above}"


def imported(source):
    """The names below tokid that a module imports: at its top, inside functions and for types alone."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names = [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom):
            folder = ".".join(filter(None, ["tokid" if node.level else "", node.module]))
            names = [f"{folder}.{name.name}" for name in node.names]
        else:
            continue
        yield from (name.split(".")[1] for name in names if name.startswith("tokid."))


def imports():
    """Module of the Python package → the modules that it imports. The extension lies below all of them."""
    sources = {path.stem: path.read_text() for path in PACKAGE.glob("*.py")}
    # A sub-package is one module, whose imports of its own files are left out.
    for package in {path.parent for path in PACKAGE.glob("*/*.py")}:
        text = "\n".join(path.read_text() for path in package.glob("*.py"))
        text = re.sub(r"^( *)from \.(?!\.).*?import (?:\([^)]*\)|.*)$", r"\1pass", text, flags=re.MULTILINE)
        sources[package.name] = re.sub(r"\bfrom \.\.", "from .", text).replace("from __future__ import annotations", "")
    return {module: {name if name in sources else "__init__" for name in imported(source) if name != "_tokid"}
            for module, source in sources.items()}


def test_modules():
    edges = imports()
    assert len(edges) > 20 and {"_ensemble", "_model", "results", "plot"} <= edges["__init__"]
    assert knots(edges) == {}


def test_imports_are_found():
    source = """
import numpy, tokid.plot
from . import _options, _tokid
from ._ensemble import Ensemble
from tokid import results
if TYPE_CHECKING:
    from ._model import Model
def show():
    from . import interop
    from tokid import identify
"""
    assert set(imported(source)) == {
        "plot", "_options", "_tokid", "_ensemble", "results", "_model", "interop", "identify"}


def test_knots_are_found():
    assert knots({"a": {"b"}, "b": {"c"}, "c": {"b"}, "d": set()}) == {"b": {"c"}, "c": {"b"}}
    assert knots({"a": {"b"}, "b": {"c"}, "c": set()}) == {}
