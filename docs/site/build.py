#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Builds the site from the documents, the Python package, the headers and the examples.

    make docs

collects everything into one folder of Markdown and reStructuredText (OUT/source), runs Doxygen and Sphinx, and checks
every link of OUT/html. What did not change is not built again.
"""

import argparse
import fnmatch
import json
import os
import re
import shutil
import subprocess
import sys
from base64 import b64decode
from importlib.util import find_spec
from pathlib import Path

import check
import rooms
from headers import Headers

SITE = Path(__file__).resolve().parent
ROOT = SITE.parents[1]
DOCS = ROOT / "docs"
FENCE = re.compile(r"^\s*(```+|~~~+)\s*(\S*)")
LINK = re.compile(r"(?<!\\)(\]\()([^)\s]+)(\))")
NAMED = re.compile(r"\[(?:\.\./)*[\w/-]+\.md\]\((?!http)")  # the page is named by its file; the site shows its title
TEXTS = {".py": "python", ".cpp": "cpp", ".hpp": "cpp", ".m": "matlab", ".sh": "sh", ".txt": "text", ".md": "markdown",
         ".toml": "toml", ".json": "json", ".cff": "yaml", "": "text"}


class Source:
    """The folder that Sphinx reads. Files are only written when their content changes."""

    def __init__(self, folder):
        self.folder, self.written = folder, set()

    def write(self, name, content):
        path = self.folder / name
        self.written.add(path)
        content = content.encode() if isinstance(content, str) else content
        if not path.exists() or path.read_bytes() != content:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)

    def pages(self, pattern):
        """Names without extension of the pages that match, in the order of the alphabet."""
        names = {str(p.relative_to(self.folder).with_suffix("")) for p in self.written if p.suffix in (".md", ".rst")}
        return sorted(name for name in names if fnmatch.fnmatchcase(name, pattern) and name.count("/") == pattern.count("/"))

    def forget_the_rest(self):
        for path in sorted(self.folder.rglob("*"), reverse=True):
            if path.is_file() and path not in self.written:
                path.unlink()
            elif path.is_dir() and not any(path.iterdir()):
                path.rmdir()


# ---- Documents ----


def place(path):
    """The page of the site that shows a file of the repository, or None for a file that no page shows yet."""
    name = str(path.relative_to(ROOT))
    if name in rooms.PAGES:
        return rooms.PAGES[name]
    if path.parent == ROOT / "examples" / "python" and path.stem in rooms.EXAMPLES:
        return f"gallery/{path.stem}.ipynb"
    if name == "README.md":
        return "index.md"
    if path.is_relative_to(DOCS) and not path.is_relative_to(SITE):
        return str(path.relative_to(DOCS))
    return None


class Documents:
    """Copies Markdown of the repository. Links to files that are no pages lead to pages that show these files."""

    def __init__(self, source):
        self.source, self.shown = source, set()

    def copy(self, path, name):
        self.source.write(name, self.converted(path.read_text(encoding="utf-8"), path, name))

    def converted(self, text, path, name):
        """Text with equations in ```math fences as $$ blocks, and with the links of the site."""
        lines, fence = [], ""
        for line in text.split("\n"):
            found = FENCE.match(line)
            if found and not fence:
                fence, kind = found[1], found[2]
                line = line.replace("```math", "$$") if kind == "math" else line
            elif found and found[1] == fence and not found[2]:
                line = line.replace(fence, "$$") if kind == "math" else line
                fence = ""
            elif not fence:
                line = NAMED.sub("[](", line)
                line = LINK.sub(lambda link: link[1] + self.target(link[2], path, name) + link[3], line)
            lines.append(line)
        return "\n".join(lines)

    def target(self, link, path, name):
        link, _, anchor = link.partition("#")
        if not link or ":" in link:
            return link + ("#" + anchor if anchor else "")
        wanted = Path(os.path.normpath(path.parent / link))
        if not wanted.exists():
            raise SystemExit(f"{path.relative_to(ROOT)}: the link {link} leads nowhere")
        page = place(wanted) if wanted.is_file() else None
        if page is None:
            page = f"files/{wanted.relative_to(ROOT)}.md"
            self.shown.add(wanted)
        return os.path.relpath(page, Path(name).parent) + ("#" + anchor if anchor else "")

    def show_files(self):
        """A page for each file or folder that a document links to."""
        for path in sorted(self.shown):
            name = str(path.relative_to(ROOT))
            if path.is_dir():
                inside = sorted(p.name + "/" * p.is_dir() for p in path.iterdir() if not p.name.startswith((".", "__")))
                body = "\n".join(f"- `{entry}`" for entry in inside)
            else:
                body = f"``````{TEXTS.get(path.suffix, 'text')}\n{path.read_text(encoding='utf-8')}``````"
            self.source.write(f"files/{name}.md", f"---\norphan: true\n---\n\n# {name}\n\n{body}\n")


def documents(source):
    pages = Documents(source)
    for path in sorted(DOCS.rglob("*")):
        if not path.is_file() or path.is_relative_to(SITE):
            continue
        name = str(path.relative_to(DOCS))
        if path.suffix == ".md" and name != "index.md":
            pages.copy(path, name)
        elif path.suffix in (".svg", ".png"):
            source.write(name, path.read_bytes())
    for name, page in rooms.PAGES.items():
        pages.copy(ROOT / name, page)
    return pages


# ---- Front pages ----


def toctree(entries, *options):
    return "\n".join(["```{toctree}", *options, "", *entries, "```", ""])


def card(title, link, text, image=None):
    above = [f":img-top: {image}", ":class-img-top: shown"] if image else []
    return "\n".join([f":::{{grid-item-card}} {title}", f":link: {link}", ":link-type: doc", *above, "", text, ":::", ""])


def grid(cards, columns="1 2 2 3"):
    return "\n".join([f"::::{{grid}} {columns}", ":gutter: 3", "", *cards, "::::", ""])


def first_screen():
    """The README up to its mark, or else up to its second heading."""
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    mark = readme.find("<!-- end of the first screen -->")
    headings = [match.start() for match in re.finditer(r"^## ", readme, re.MULTILINE)]
    return readme[:mark if mark >= 0 else headings[1]]


def contents():
    """The sections of docs/index.md by their titles, and the pages that it links to, in its order."""
    path = DOCS / "index.md"
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    parts = re.split(r"^## (.*)\n", text, flags=re.MULTILINE)
    links = [link.removesuffix(".md") for link in re.findall(r"\]\(([^)#]+\.md)\)", text)]
    return dict(zip(parts[1::2], parts[2::2])), links


def front(source, pages):
    """The landing page and the first page of each section."""
    texts, links = contents()
    placed = set()
    for folder, (title, sentence, patterns) in rooms.SECTIONS.items():
        found = []
        for pattern in patterns:
            names = [name for name in source.pages(pattern) if name not in placed and name != f"{folder}/index"]
            found += sorted(names, key=lambda name: links.index(name) if name in links else len(links))
            placed.update(names)
        whole = all(name in links for name in source.pages(f"{folder}/*") if name != f"{folder}/index")
        text = texts.get(title, "") if "*" in patterns[0] and whole else ""
        shown = pages.converted(text, DOCS / "index.md", f"{folder}/index.md") if text else sentence
        if text and len(left := [name for name in found if "/" not in name]):
            shown += "\nMore:\n\n" + "\n".join(f"- {{doc}}`/{name}`" for name in left)
        tree = toctree([f"/{name}" for name in found], ":hidden:" if text else ":maxdepth: 1")
        source.write(f"{folder}/index.md", f"# {title}\n\n{shown}\n\n{tree}")
    first = {"index", *rooms.FIRST} | {f"{folder}/index" for folder in rooms.SECTIONS}
    rest = [name for name in source.pages("*") + source.pages("*/*") if name not in placed | first
            and not name.startswith(("files/", "gallery/"))]
    cards = [*(card(title, page, sentence) for page, (title, sentence) in rooms.FIRST.items()),
             card("Gallery", "gallery/index", "Executed examples with pictures, measured data first.")]
    cards += [card(title, f"{folder}/index", sentence) for folder, (title, sentence, _) in rooms.SECTIONS.items()]
    text = pages.converted(first_screen(), ROOT / "README.md", "index.md")
    begin = [f"{title} <{page}>" for page, (title, _) in rooms.FIRST.items()]
    tree = toctree([*begin, "gallery/index", *(f"{folder}/index" for folder in rooms.SECTIONS), *rest], ":hidden:")
    source.write("index.md", "\n".join([text, "", "## Where to go", "", grid(cards), tree]))


# ---- Gallery ----


def picture(notebook):
    """The last picture that a notebook shows."""
    for cell in reversed(notebook["cells"]):
        for output in reversed(cell.get("outputs", [])):
            if "image/png" in output.get("data", {}):
                return b64decode("".join(output["data"]["image/png"]))
    return None


def gallery(source, pages):
    cards = []
    for name in rooms.EXAMPLES:
        path = ROOT / "examples" / "python" / f"{name}.ipynb"
        notebook = json.loads(path.read_text(encoding="utf-8"))
        image = picture(notebook)
        if image is None:
            raise SystemExit(f"{path.relative_to(ROOT)} has no picture: run examples/python/notebooks.py --run {name}")
        source.write(f"gallery/{name}.png", image)
        source.write(f"gallery/{name}.py", path.with_suffix(".py").read_bytes())
        source.write(f"gallery/downloads/{name}.ipynb", path.read_bytes())
        for cell in notebook["cells"]:
            if cell["cell_type"] == "markdown":
                text = pages.converted("".join(cell["source"]), path, f"gallery/{name}.ipynb")
                cell["source"] = text.splitlines(keepends=True)
        first = notebook["cells"][0]["source"]
        title, text = first[0].lstrip("# ").strip(), "".join(first[1:]).strip().split("\n\n")[0].replace("\n", " ")
        first.append(f"\n\n{{download}}`Script <{name}.py>`, {{download}}`notebook <downloads/{name}.ipynb>`")
        source.write(f"gallery/{name}.ipynb", json.dumps(notebook, indent=1, ensure_ascii=False))
        cards.append(card(title, f"/gallery/{name}", text, f"/gallery/{name}.png"))
    text = ("# Gallery\n\nThe outputs and pictures are those of `examples/python/notebooks.py --run`, which executes the "
            "examples.\nThe tests run the same code.\n")
    source.write("gallery/index.md", "\n".join([text, grid(cards, "1 1 2 2"), toctree(rooms.EXAMPLES, ":hidden:")]))


# ---- Reference ----


def heading(text, mark="="):
    return f"{text}\n{mark * len(text)}\n"


def definitions(text):
    """The help of a command: its options as a list of terms and descriptions, usage and example as they are."""
    parts = []
    for block in text.split("\n\n"):
        title, *lines = block.split("\n")
        if title in ("Arguments:", "Options:", "Commands:"):
            parts.append(f"**{title}**\n")
            for line in lines:
                term, _, description = line.strip().partition("  ")
                if line.startswith("   ") and description == "":  # goes on with the description
                    parts[-1] = parts[-1].rstrip("\n") + (" " if "\n: " in parts[-1] else "\n: ") + f"{prose(term)}\n"
                else:
                    parts.append(f"`{term}`\n" + (f": {prose(description.strip())}\n" if description else ""))
        elif title.startswith(("Usage:", "Example")):
            parts.append(f"```text\n{block}\n```\n")
        else:
            parts.append(prose(block) + "\n")
    return "\n".join(parts)


def prose(text):
    """Text of which Markdown makes nothing else."""
    return re.sub(r"([\\`*_{}\[\]<>#|$~])", r"\\\1", text)


def commands(source, tool):
    """The help of every command."""
    def run(*arguments):
        return subprocess.run([tool, *arguments], check=True, capture_output=True, text=True).stdout.rstrip()

    whole = run("--help")
    names = re.findall(r"^  (\w[\w-]*) {2,}\S", whole[whole.index("Commands:"):], re.MULTILINE)
    parts = ["# Commands\n", "What `tokid --help` and `tokid COMMAND --help` print.\n", definitions(whole)]
    parts += [f"## tokid {name}\n\n{definitions(run(name, '--help'))}" for name in names]
    source.write("reference/commands.md", "\n".join(parts))


def matlab(source):
    """The help texts of the functions of the package."""
    parts = ["# MATLAB functions\n", "What `help tokid.NAME` shows. [The guide](/matlab.md) leads through them.\n"]
    for path in sorted((ROOT / "matlab" / "+tokid").glob("*.m")):
        comment = re.search(r"^%.*\n(?:%.*\n)*", path.read_text(encoding="utf-8"), re.MULTILINE)
        if path.stem != "Contents" and comment:
            text = re.sub(r"^% ?", "", comment[0], flags=re.MULTILINE).rstrip()
            parts.append(f"## tokid.{path.stem}\n\n```text\n{text}\n```\n")
    source.write("reference/matlab-functions.md", "\n".join(parts))


def public(module):
    """Functions, classes and values of a module that users may name."""
    return getattr(module, "__all__", None) or [name for name, value in vars(module).items() if not name.startswith("_")
                                                and getattr(value, "__module__", None) == module.__name__]


def python(source, package):
    sys.path.insert(0, str(package))
    from importlib import import_module

    tokid = import_module("tokid")
    modules = {name: import_module(name) for name in ("tokid.stages", "tokid.plot", "tokid.interop", "tokid.results")}
    listed = {name for _, _, names in rooms.PYTHON.values() for name in names}
    left = [f"tokid.{name}" for name in public(tokid) if f"tokid.{name}" not in listed and name != "__version__"]
    seen = {id(getattr(tokid, name)) for name in public(tokid)}
    results = modules["tokid.results"]
    left += [f"tokid.results.{name}" for name in public(results) if id(getattr(results, name)) not in seen]

    def value_of(name):
        owner, _, last = name.rpartition(".")
        return getattr(modules.get(owner, tokid), last)

    def block(name):
        value = value_of(name)
        if isinstance(value, type):
            foreign = [base.__name__ for base in value.__mro__ if not base.__module__.startswith("tokid")]
            return f".. autoclass:: {name}\n   :members:\n   :inherited-members: {', '.join(foreign)}\n"
        if callable(value):
            return f".. autofunction:: {name}\n"
        keys = ", ".join(f"``{key}``" for key in value)
        return f".. py:data:: {name}\n\n   Values by name: {keys}.\n"

    for page, (title, sentence, names) in rooms.PYTHON.items():
        names = names + (left if page == "other" else [])
        parts, whole = [], []
        for name in names:
            if name in modules:
                parts += [f".. automodule:: {name}\n"]
                inside = [f"{name}.{n}" for n in public(modules[name])]
                parts += [heading(name, "-")] * (len(names) > 1)
                whole += inside
                parts += [block(n) for n in inside]
            else:
                whole.append(name)
                parts.append(block(name))
        rows = [f"   ~{name}" for name in whole if callable(value_of(name))]
        table = "\n".join([".. autosummary::", "   :nosignatures:", "", *rows, ""])
        source.write(f"reference/python/{page}.rst", "\n".join([heading(title), sentence + "\n", table, *parts]))
    entries = "\n".join(f"   {page}" for page in rooms.PYTHON)
    source.write("reference/python/index.rst", "\n".join([
        heading("Python API"), "All public functions and classes. :doc:`/python` is the guide.\n",
        f".. toctree::\n   :maxdepth: 1\n\n{entries}\n"]))


def cpp(source, out):
    """Runs Doxygen if a header changed, and writes the pages of the headers."""
    headers = sorted((ROOT / "include" / "tokid").glob("*.hpp"))
    state = "".join(path.read_text(encoding="utf-8") for path in [*headers, SITE / "doxygen_filter.py", SITE / "Doxyfile"])
    stamp = out / "stamp"
    if not stamp.exists() or stamp.read_text(encoding="utf-8") != state:
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir(parents=True)
        given = (f"INPUT = {ROOT / 'include' / 'tokid'}\nOUTPUT_DIRECTORY = {out}\nSTRIP_FROM_PATH = {ROOT / 'include'}\n"
                 f"INPUT_FILTER = \"{sys.executable} {SITE / 'doxygen_filter.py'}\"\n")
        text = (SITE / "Doxyfile").read_text(encoding="utf-8") + given
        done = subprocess.run(["doxygen", "-"], input=text, text=True, capture_output=True, check=True)
        if done.stderr:
            raise SystemExit(done.stderr)
        stamp.write_text(state, encoding="utf-8")
    read = Headers(out / "xml")
    listed = [name for _, names in rooms.CPP.values() for name in names]
    left = [path.stem for path in headers if path.stem not in listed]
    for page, (title, names) in rooms.CPP.items():
        parts = [heading(title)]
        for name in [n for n in names if any(path.stem == n for path in headers)] + (left if page == "other" else []):
            parts += [heading(f"tokid/{name}.hpp", "-"), ".. cpp:namespace:: tokid\n", read.page(name)]
        source.write(f"reference/cpp/{page}.rst", "\n".join(parts))
    entries = "\n".join(f"   {page}" for page in rooms.CPP)
    source.write("reference/cpp/index.rst", "\n".join([
        heading("C++ API"), "The public headers, in the groups of the Python API. ``#include <tokid/tokid.hpp>`` has all of "
        "them. Matrices are those of Eigen. :doc:`/how-to/cpp` is the guide. The members ``execution`` of options, for "
        "threads and progress, are of ``tokid/parallel.hpp`` in the group Identify.\n",
        f".. toctree::\n   :maxdepth: 1\n\n{entries}\n"]))


def static(out):
    """Files that pages load: the versions, and MathJax with its fonts from a package, so that none needs another host."""
    files = Path(find_spec("sphinx-mathjax-offline").origin).parent / "static" / "mathjax"
    for path in [files / "tex-chtml.js", *sorted((files / "output" / "chtml" / "fonts" / "woff-v2").glob("*.woff"))]:
        target = out / "mathjax" / path.relative_to(files)
        if not target.exists():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(path, target)
    versions = json.loads((SITE / "versions.json").read_text(encoding="utf-8"))
    place = os.environ.get("TOKID_DOCS_URL") or "/"
    for version in versions:
        version["url"] = re.sub(r"^/", place.rstrip("/") + "/", version["url"])
    (out / "switcher.json").write_text(json.dumps(versions), encoding="utf-8")
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--tool", type=Path, default=ROOT / "build" / "bin" / "tokid")
    parser.add_argument("--package", type=Path, default=ROOT / "build" / "python", help="folder with the package tokid")
    arguments = parser.parse_args()
    out = arguments.out.resolve()
    source = Source(out / "source")
    pages = documents(source)
    gallery(source, pages)
    commands(source, arguments.tool.resolve())
    matlab(source)
    python(source, arguments.package.resolve())
    cpp(source, out / "doxygen")
    front(source, pages)
    pages.show_files()
    source.forget_the_rest()
    for page in (out / "html").rglob("*.html"):  # Sphinx leaves pages that have no source any more
        name = page.relative_to(out / "html").with_suffix("")
        made = str(name) in ("genindex", "py-modindex", "search") or name.parts[0].startswith("_")
        if not made and not any((source.folder / name).parent.glob(f"{name.name}.*")):
            page.unlink()
    version = re.search(r"project\(\s*tokid\s+VERSION\s+([\d.]+)", (ROOT / "CMakeLists.txt").read_text())[1]
    environment = {**os.environ, "PYTHONPATH": str(arguments.package.resolve()), "MPLBACKEND": "agg",
                   "TOKID_DOCS_VERSION": version, "TOKID_DOCS_STATIC": str(static(out / "static"))}
    status = subprocess.run([sys.executable, "-m", "sphinx", "-b", "html", "-W", "--keep-going", "-n", "-q", "-j", "auto",
                             "-c", SITE, "-d", out / "doctrees", source.folder, out / "html"], env=environment, check=False)
    if status.returncode:
        shutil.rmtree(out / "doctrees", ignore_errors=True)  # else the next build would not repeat the warnings
        return status.returncode
    wrong = check.problems(out / "html")
    print("\n".join(wrong) if wrong else f"The site: {out / 'html' / 'index.html'}")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
