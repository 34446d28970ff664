# SPDX-License-Identifier: BSD-3-Clause
"""The examples of the pages in docs and of the docstrings."""

import doctest
import importlib
import pkgutil
import re
from pathlib import Path

import numpy as np
import pytest

import tokid
from perturbation import SEED
from tokid import Ensemble

pytestmark = pytest.mark.usefixtures("other_processor")
DOCS = Path(__file__).resolve().parents[2] / "docs"
FLAGS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
# Those of optional packages have tests of their own.
MODULES = [name for _, name, _ in pkgutil.iter_modules(tokid.__path__) if name.startswith("_") or name in ("results", "stages")]


def test_data_are_perturbed():
    asked = {"experiments": 2, "steps": 9, "measurement_noise": 0.1}
    plain = tokid._example.example("oscillator", **asked)
    for data in (tokid.example("oscillator", **asked), Ensemble(plain.u, plain.y)):
        assert (SEED == 0 or np.any(data.y != plain.y)) and np.abs(data.y / plain.y - 1).max() < 1e-15


@pytest.mark.parametrize("name", ["", *MODULES])
def test_docstrings(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    module = importlib.import_module(f"tokid.{name}" if name else "tokid")
    names = {"tokid": tokid, "Ensemble": tokid.Ensemble, "Model": tokid.Model}
    try:
        assert doctest.testmod(module, extraglobs=names, optionflags=FLAGS).failed == 0
    except TypeError:  # the extension has no source
        assert name == "_tokid"


# Pictures of python-interop.md need Matplotlib: test_interop.py runs it.
PAGES = [path for path in sorted(DOCS.rglob("*.md")) if path.name != "python-interop.md" and ">>> " in path.read_text(encoding="utf-8")]


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_pages(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert doctest.testfile(str(page), module_relative=False, optionflags=FLAGS, encoding="utf-8").failed == 0


def test_pages_are_found():
    assert {"python", "control", "modes", "robot-control"} <= {page.stem for page in PAGES}


def test_readme(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    page = (Path(__file__).resolve().parents[2] / "README.md").read_text()
    (program,) = re.findall(r"^```python\n(import tokid\n.*?)^```$", page, re.MULTILINE | re.DOTALL)
    exec(compile(program.replace("experiments=200", "experiments=40, steps=30"), "README.md", "exec"), {})
    assert (tmp_path / "model.h5").exists() and capsys.readouterr().out.startswith("[9")


def test_everything_public_is_documented():
    for name in tokid.__all__:
        thing = getattr(tokid, name)
        if name.startswith("__") or not callable(thing):
            continue
        assert thing.__doc__, name
        if isinstance(thing, type) and thing.__module__.startswith("tokid"):
            bases = [base for base in thing.__mro__ if base.__module__.startswith("tokid")]
            for member, value in (item for base in bases for item in vars(base).items()):
                if not member.startswith("_") and (callable(value) or isinstance(value, (property, classmethod))):
                    doc = (value.__func__ if isinstance(value, classmethod) else value).__doc__
                    assert doc and doc != type(value).__doc__, f"{name}.{member}"
