# SPDX-License-Identifier: BSD-3-Clause
"""What the documents show is what the tool prints, also from data with other rounding errors: perturbation.py.

With TOKID_UPDATE_DOCS=1 in the environment, the outputs in these documents are written anew instead of compared.
"""

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from itertools import zip_longest

import pytest

from conftest import ROOT
from perturbation import perturb_file

DOCS = ROOT / "docs"
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")
WITH_POWER = re.compile(NUMBER.pattern + "(?:·10[⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)?")


@contextlib.contextmanager
def perturbing(folder):
    """Data that a program writes into the folder meanwhile are perturbed: perturbation.py says why."""
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    yield
    for path in sorted(folder.rglob("*")):
        if before.get(path) != path.stat().st_mtime_ns:
            perturb_file(path)


def run(tokid, command, folder):
    """What a reader sees in the terminal. Scripts in Python are those of the repository."""
    words = shlex.split(command, comments=True)
    program = {"tokid": [tokid.executable], "python3": [sys.executable, str(ROOT / words[1])]}[words[0]]
    arguments = words[1:] if words[0] == "tokid" else words[2:]
    makes_data = words[0] == "python3" or words[1] == "example"
    with perturbing(folder) if makes_data else contextlib.nullcontext():
        result = subprocess.run([*program, *arguments], cwd=folder, stdin=subprocess.DEVNULL, text=True,
                                stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False,
                                env={**os.environ, "LC_ALL": "C.UTF-8"})
    # On a terminal, the tool breaks messages.
    return result.returncode, [part for line in result.stdout.splitlines()
                               for part in ([line.rstrip()] if not line.startswith("tokid: ") else
                                            textwrap.wrap(line, 100, subsequent_indent="  ", break_long_words=False,
                                                          break_on_hyphens=False))]


def blocks_of(text):
    """The fenced blocks that a reader runs, in order: a session, as a list of (command, output lines), or a program in Python.

    A session begins with a command. Programs of the Python package, with their prompts, have tests of their own.
    """
    for match in re.finditer(r"^```(\w*)\n(.*?)^```$", text, re.MULTILINE | re.DOTALL):
        if match[1] == "python" and not match[2].startswith(">>> "):
            yield match, match[2]
        elif match[1] == "" and match[2].startswith("$ "):
            session = []
            for line in match[2].splitlines():
                if line.startswith("$ "):
                    session.append((line[2:], []))
                else:
                    session[-1][1].append(line)
            yield match, session


def same(shown, printed):
    """The same words, and numbers alike to 2 %: the last digits, and times, belong to the machine.

    "…" stands for any number: numbers of iterations, for example, depend on rounding errors of the data.
    """
    shown, printed = masked(shown, printed)
    if " in " in shown and shown.startswith("Written"):
        shown, printed = (re.sub(r" in [\d.]+ s$", "", line) for line in (shown, printed))
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(map(float, NUMBER.findall(shown)), map(float, NUMBER.findall(printed)))
    # Of probabilities as small as those, the order of magnitude counts.
    return all(abs(a - b) <= 0.02 * abs(a) or max(abs(a), abs(b)) < 1e-7 for a, b in pairs)


def masked(shown, printed):
    """The line shown, and the printed line with "…" for numbers where the page has "…"."""
    words = shown.split()
    if "…" not in shown or len(words) != len(printed.split()):
        return shown, printed
    words = iter(words)
    return shown, re.sub(r"\S+", lambda match: WITH_POWER.sub("…", match[0]) if "…" in next(words) else match[0], printed)


def anew(shown, printed):
    """The printed lines for the page. Those that are the same as before stay, and so does "…"."""
    return [before if same(before, now) else masked(before, now)[1]
            for before, now in zip_longest(shown[:len(printed)], printed, fillvalue="")]


def run_page(tokid, path, folder):
    """The page with the outputs of its commands, and a list of (command, shown, printed)."""
    text = updated = path.read_text()
    outputs, names = [], {"__name__": path.stem}
    for match, block in blocks_of(text):
        if isinstance(block, str):
            with contextlib.chdir(folder), perturbing(folder):
                exec(compile(block, path.name, "exec"), names)
            continue
        session = ""
        for command, shown in block:
            _, printed = run(tokid, command, folder)
            outputs.append((command, shown, printed))
            session += f"$ {command}\n" + "".join(line + "\n" for line in anew(shown, printed))
        updated = updated.replace(match[0], f"```\n{session}```")
    return updated, outputs


def check(page, updated, outputs):
    if os.environ.get("TOKID_UPDATE_DOCS") == "1":
        (DOCS / page).write_text(updated)
        pytest.skip(f"docs/{page} written anew")
    wrong = [f"{command}\nshown:   {before}\nprinted: {now}" for command, shown, printed in outputs
             for before, now in zip_longest(shown, printed, fillvalue="") if not same(before, now)]
    assert not wrong, "\n".join(wrong)


def pages_with_commands():
    pages = (path for path in sorted(DOCS.rglob("*.md")) if re.search(r"^```\n\$ ", path.read_text(), re.MULTILINE))
    return [str(path.relative_to(DOCS)) for path in pages]


@pytest.fixture(scope="session")
def tutorial(tokid, tmp_path_factory):
    """The folder in which the commands of the tutorial ran, and what they printed."""
    folder = tmp_path_factory.mktemp("tutorial")
    return folder, run_page(tokid, DOCS / "tutorial.md", folder)


def test_tutorial(tutorial):
    _, (updated, outputs) = tutorial
    assert len(outputs) >= 8
    check("tutorial.md", updated, outputs)


@pytest.mark.parametrize("page", [page for page in pages_with_commands() if page != "tutorial.md"])
def test_pages(tokid, tutorial, tmp_path, page):
    """Pages go on with the files of the tutorial."""
    folder = tmp_path / "files"
    shutil.copytree(tutorial[0], folder)
    check(page, *run_page(tokid, DOCS / page, folder))


def test_readme(tokid, tmp_path):
    block = re.search(r"^```sh\n(tokid .*?)^```$", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)[1]
    commands = block.splitlines()
    assert len(commands) >= 8
    for command in commands:
        if command:
            status, printed = run(tokid, command, tmp_path)
            assert status == 0, "\n".join([command, *printed])


def test_files_and_functions_that_documents_name():
    named = 0
    for document in [*DOCS.rglob("*.md"), ROOT / "CONTRIBUTING.md"]:
        text = " ".join(document.read_text().split())
        for path, list_of_names in re.findall(r"`((?:src|include|app|bench|tests)/[\w./-]+)`((?:[:,;]? (?:class )?`[\w:]+`)*)", text):
            assert (ROOT / path).exists(), f"{document.name}: {path}"
            if list_of_names.startswith(":"):
                source = (ROOT / path).read_text()
                for name in re.findall(r"`([\w:]+)`", list_of_names):
                    assert re.search(rf"\b{name.split('::')[-1]}\b", source), f"{document.name}: {name} in {path}"
                    named += 1
    assert named > 50


@pytest.mark.parametrize("table, header, start, least", [
    ("findings", "finding.hpp", "enum class Kind {\n    // data", 90),
    ("conclusions", "conclusion.hpp", "enum class Reason {", 20)])
def test_kinds_that_documents_name(table, header, start, least):
    enumerators = (ROOT / "include/tokid" / header).read_text().split(start)[1].split("last =")[0]
    names = re.findall(r"^ +([a-z_]+),", enumerators, re.MULTILINE)
    text = (DOCS / "formats.md").read_text().split(f"<!-- table: {table} -->")[1].split("<!-- end -->")[0]
    assert len(names) >= least
    assert re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE) == names


def fragments(source, least):
    """(literal, words) of C++ for all words between names and numbers of a text, if there are at least so many."""
    for literal in re.findall(r'"((?:[^"\\]|\\.)*)"', source):
        for words in re.split(r"\{[^{}|]*\|?|[|}]", literal):  # fields, and the texts that a field chooses from
            if len(words.split()) >= least:
                yield literal, words.strip(" ,.:;()")


def test_messages_can_be_searched():
    """All words of findings, between their names and numbers, are in docs/troubleshooting.md."""
    source = (ROOT / "src/base/finding.cpp").read_text().split("namespace {", 1)[1]
    page = " ".join((DOCS / "troubleshooting.md").read_text().split())
    searched = 0
    for literal, words in fragments(re.sub(r"//.*", "", source), least=3):
        assert words in page, literal
        searched += 1
    assert searched > 150


def test_remarks_of_the_reader_can_be_searched():
    """So are the words of the remarks of the reader of .csv."""
    page = " ".join((DOCS / "troubleshooting.md").read_text().replace("`", "").split())
    searched = 0
    for name in ("csv", "files"):
        source = re.sub(r"//.*", "", (ROOT / f"src/io/formats/{name}.cpp").read_text())
        source = re.sub(r'"\s*"', "", source)
        functions = re.split(r"\n(?=\S)", source)
        for function in functions:
            of_remarks = re.match(r"[^(]*\b(?:remarks?_on_|effect_on_noise|keep_once)", function)
            for statement in re.split(r";\n", function):
                if "throw" in statement or re.search(r"\bfail\(", statement):
                    continue
                if not of_remarks and not re.search(r"remark", statement):
                    continue
                for literal, words in fragments(statement, least=4):
                    assert words in page, literal
                    searched += 1
    assert searched > 5


def test_equations_have_their_place():
    """The code cites no equation that the table lacks, and the table no place that does not cite it."""
    table = (DOCS / "math.md").read_text().split("## Where each equation is")[1].split("\n## ")[0]
    places = {}
    for equations, path, names in re.findall(r"^\| (.+?) \|.*?\| `([\w./]+)`: (.*?) \|$", table, re.MULTILINE):
        source = (ROOT / path).read_text()
        for name in re.findall(r"`([\w:]+)`", names):
            assert re.search(rf"\b{name.split('::')[-1]}\b", source), f"{name} in {path}"
        for equation in re.findall(r"\d+", equations):
            places.setdefault(int(equation), []).append(path)
    assert len(places) > 25
    for folder in ("include/tokid", "src"):
        for file in (ROOT / folder).rglob("*.[ch]pp"):
            for line in file.read_text().splitlines():
                for first, last in re.findall(r"(?<![\w)\]}])\((\d{1,2})\)(?:-\((\d{1,2})\))?(?=[\s.,:;]|$)",
                                              line.partition("//")[2]):
                    cited = range(int(first), int(last or first) + 1)
                    # A range stands for a part of the paper, of which some equations are steps of a proof.
                    assert any(number in places for number in cited), f"({first}) in {file.name}: {line.strip()}"
