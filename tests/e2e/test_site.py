# SPDX-License-Identifier: BSD-3-Clause
"""The site (make docs): what its lists name exists, texts are converted, and its checks find what they are for."""

import ast
import importlib
import json
import re
import sys

import pytest
from conftest import ROOT

SITE = ROOT / "docs" / "site"


@pytest.fixture
def module(monkeypatch):
    """Imports a module of docs/site."""
    monkeypatch.syspath_prepend(str(SITE))
    names = ("build", "check", "doxygen_filter", "headers", "rooms")
    for name in names:
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield importlib.import_module
    for name in names:
        sys.modules.pop(name, None)


def once(names):
    assert len(names) == len(set(names))
    return set(names)


# What no list names stands in the last group of its kind; what a list names must be there.
def test_listed_headers_exist(module):
    placed = once([name for _, names in module("rooms").CPP.values() for name in names])
    assert placed <= {path.stem for path in (ROOT / "include" / "tokid").glob("*.hpp")}


def test_listed_python_names_exist(module):
    placed = once([name for _, _, names in module("rooms").PYTHON.values() for name in names])
    tree = ast.parse((ROOT / "python" / "tokid" / "__init__.py").read_text(encoding="utf-8"))
    values = {node.targets[0].id: node.value for node in tree.body if isinstance(node, ast.Assign)}
    public = set(ast.literal_eval(values["__all__"])) | set(ast.literal_eval(values["_LATER"]))
    assert placed <= {f"tokid.{name}" for name in public - {"__version__"}}


def test_each_example_is_in_the_gallery(module):
    shown = once(module("rooms").EXAMPLES)
    assert shown == {path.stem for path in (ROOT / "examples" / "python").glob("*.ipynb")}


def test_the_front_page_says_for_whom_tokid_is_and_how_to_install_it(module):
    text = module("build").first_screen()
    for heading in ("## Who uses it, with what data", "## When to use it, and when not"):
        assert f"\n{heading}\n" in text
    assert "](docs/install.md)" in text and "\n## Install" not in text
    pages = list(module("rooms").FIRST)
    assert pages[0] == "install" and all((ROOT / "docs" / f"{page}.md").exists() for page in pages)


def test_equations_and_links_of_a_document(module, tmp_path):
    build = module("build")
    pages = build.Documents(build.Source(tmp_path))
    text = ("See [the paper](math.md#notation), [a script](../examples/python/modes.py), [a file](../tests/studies/oracle.cpp).\n"
            "```math\nx_k\n```\n```python\nf([a](b))\n```\n")
    assert pages.converted(text, ROOT / "docs" / "page.md", "page.md") == (
        "See [the paper](math.md#notation), [a script](gallery/modes.ipynb), [a file](files/tests/studies/oracle.cpp.md).\n"
        "$$\nx_k\n$$\n```python\nf([a](b))\n```\n")
    assert pages.shown == {ROOT / "tests" / "studies" / "oracle.cpp"}
    with pytest.raises(SystemExit, match=r"docs/page\.md: the link nowhere\.md leads nowhere"):
        pages.converted("[a](nowhere.md)", ROOT / "docs" / "page.md", "page.md")


def test_help_becomes_a_list_of_options(module):
    text = ("Fits a model\n\nUsage: tokid fit [OPTIONS]\n\nOptions:\n  --lags N|auto    Lag order *p*\n"
            "                   of the model\n  --a-long-option Excludes: --another\n                   Steps")
    assert module("build").definitions(text) == (
        "Fits a model\n\n```text\nUsage: tokid fit [OPTIONS]\n```\n\n**Options:**\n\n"
        "`--lags N|auto`\n: Lag order \\*p\\* of the model\n\n`--a-long-option Excludes: --another`\n: Steps\n")


def test_comments_of_headers_for_doxygen(module):
    lines = ["// What the file is.", "// SPDX-License-Identifier: BSD-3-Clause", "#pragma once", "// Sums 50 % <of> all.",
             "// \\throws IoError", "int f();", "double g = 1.0;  // [s]", 'const char* h = "//";']
    assert "\n".join(module("doxygen_filter").filtered(lines)).split("\n") == [
        "//! \\file", "//! What the file is.", "", "#pragma once", "/// Sums 50 \\% \\<of\\> all.", "///", "///",
        "/// Throws IoError", "int f();", "double g = 1.0;  ///< [s]", 'const char* h = "//";']


def test_each_member_of_a_declaration_gets_the_comments(module):
    lines = ["// File.", "struct A {", "  // Of both.", "  std::vector<Index> first, second = {};", "  Index third = 0, fourth;  // of two",
             "                            // more of it", "  int f(int a, int b);", "};"]
    assert "\n".join(module("doxygen_filter").filtered(lines)).split("\n")[2:] == [
        "struct A {", "  /// Of both.", "  std::vector<Index> first;", "  /// Of both.", "  std::vector<Index> second = {};",
        "  Index third = 0;          ///< of two", "                            ///< more of it",
        "  Index fourth;             ///< of two", "                            ///< more of it", "  int f(int a, int b);", "};"]


def test_errors_have_a_paragraph_of_their_own(module):
    lines = ["// File.", "", "// Opens it. \\throws IoError if it", "// is not there.", "void open();"]
    assert "\n".join(module("doxygen_filter").filtered(lines)).split("\n")[3:] == [
        "/// Opens it.", "///", "/// Throws IoError if it", "/// is not there.", "void open();"]


def test_the_function_of_a_header_comes_first(module, tmp_path):
    location = '<location file="tokid/fit.hpp" line="{}"/>'
    member = '<memberdef kind="function" prot="public" static="no"><type>int</type><name>{}</name><argsstring>()</argsstring>{}</memberdef>'
    (tmp_path / "fit_8hpp.xml").write_text('<doxygen><compounddef kind="file"><compoundname>fit.hpp</compoundname>'
                                           f"{location.format(1)}</compounddef></doxygen>", encoding="utf-8")
    (tmp_path / "namespacetokid.xml").write_text(
        "<doxygen><compounddef><sectiondef>" + member.format("other", location.format(5)) + member.format("fit", location.format(9))
        + "</sectiondef></compounddef></doxygen>", encoding="utf-8")
    page = module("headers").Headers(tmp_path).page("fit")
    assert page.index("int fit()") < page.index("int other()")


def test_the_check_finds_wrong_links_and_other_hosts(module, tmp_path):
    (tmp_path / "a.html").write_text('<a href="b.html#there"></a><a href="https://example.org"></a><img src="a.png">',
                                     encoding="utf-8")
    (tmp_path / "b.html").write_text('<p id="there"></p>', encoding="utf-8")
    (tmp_path / "a.png").write_bytes(b"")
    problems = module("check").problems
    assert problems(tmp_path) == []
    (tmp_path / "b.html").write_text('<a href="c.html"></a><a href="a.html#x"></a><script src="https://example.org/x.js">'
                                     "</script>", encoding="utf-8")
    (tmp_path / "a.css").write_text("@font-face { src: url(https://example.org/f.woff) }", encoding="utf-8")
    assert [text.split()[-1] for text in problems(tmp_path)] == ["have.", "nowhere.", "have.", "host.", "host."]


def test_the_switcher_has_this_version():
    (version,) = re.findall(r"^project\(tokid VERSION ([\d.]+)", (ROOT / "CMakeLists.txt").read_text(encoding="utf-8"), re.MULTILINE)
    known = json.loads((SITE / "versions.json").read_text(encoding="utf-8"))
    assert [entry["version"] for entry in known].count(version) == 1
