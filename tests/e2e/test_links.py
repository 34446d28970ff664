# SPDX-License-Identifier: BSD-3-Clause
"""Relative links, their anchors and the pages that sources name exist."""

import re
from urllib.parse import unquote

import pytest
from conftest import ROOT

DOCS = ROOT / "docs"
TEXTS = {".py", ".m", ".md", ".hpp", ".cpp", ".txt", ".cmake", ".toml", ".yml", ".js", ".ipynb", ".in", ""}


def files():
    """The files of the repository, without what builds and tools put beside them."""
    for top in sorted(ROOT.iterdir()):
        if top.name == ".git" or top.name.startswith(("build", "_", "dist")):
            continue
        yield from [top] if top.is_file() else (path for path in sorted(top.rglob("*")) if path.is_file())


DOCUMENTS = [path for path in files() if path.suffix == ".md"]


def without_code(text):
    text = re.sub(r"^ *(```|~~~).*?^ *\1 *$", "", text, flags=re.MULTILINE | re.DOTALL)
    return re.sub(r"(`+)(?!`).*?\1", "", text, flags=re.DOTALL)


def anchors(text):
    """Names that GitHub and MyST give to the headings, and stated ones."""
    found = set(re.findall(r"(?:id|name)=\"([^\"]+)\"", text)) | set(re.findall(r"^\(([\w-]+)\)=$", text, re.MULTILINE))
    code = re.sub(r"^ *(```|~~~).*?^ *\1 *$", "", text, flags=re.MULTILINE | re.DOTALL)
    for heading in re.findall(r"^#{1,6} +(.*?) *#*$", code, re.MULTILINE):
        words = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        name = base = re.sub(r"[^\w\- ]", "", words).strip().replace(" ", "-")
        count = 0
        while name in found:
            count += 1
            name = f"{base}-{count}"
        found.add(name)
    return found


def links(text):
    text = without_code(text)
    return (re.findall(r"\]\(\s*<?([^)>\s]+)>?(?:\s+\"[^\"]*\")?\s*\)", text) + re.findall(r"^\[[^\]]+\]: +(\S+)", text, re.MULTILINE)
            + re.findall(r"(?:href|src)=\"([^\"]+)\"", text))


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links(document):
    text = document.read_text(encoding="utf-8")
    for link in links(text):
        if re.match(r"[a-z][a-z+.-]*:", link):
            continue
        place, _, anchor = link.partition("#")
        path = (document.parent / unquote(place)).resolve() if place else document
        assert path.exists(), link
        if anchor and path.suffix == ".md":
            assert anchor in anchors(path.read_text(encoding="utf-8")), link


def test_links_are_found():
    text = "# A `b`: c\n\n[x](y.md#z) ![p](q.png) `[no](link)`\n\n```\n[no](link)\n```\n## A b c\n"
    assert links(text) == ["y.md#z", "q.png"] and anchors(text) == {"a-b-c", "a-b-c-1"}


def test_index_lists_all_pages():
    listed = {(DOCS / link.partition("#")[0]).resolve() for link in links((DOCS / "index.md").read_text(encoding="utf-8"))}
    assert {path for path in DOCS.rglob("*.md")} - {DOCS / "index.md"} <= listed


def test_pages_that_sources_name():
    named = 0
    for path in files():
        if path.suffix in TEXTS:
            for page in re.findall(r"(?<![\w/.-])docs/[\w/-]+\.md\b", path.read_text(encoding="utf-8", errors="ignore")):
                assert (ROOT / page).exists(), f"{path.relative_to(ROOT)}: {page}"
                named += 1
    assert named > 30
