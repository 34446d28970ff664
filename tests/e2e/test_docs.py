# SPDX-License-Identifier: BSD-3-Clause
"""What the documents show is what the tool prints.

With TOKID_UPDATE_DOCS=1 in the environment, the outputs in these documents are written anew instead of compared.
"""

import os
import re
import shlex
import subprocess
import sys
from itertools import zip_longest

import pytest

from conftest import ROOT

NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def run(tokid, command, folder):
    """What a reader sees in the terminal."""
    words = shlex.split(command, comments=True)
    assert words[0] == "tokid"
    result = subprocess.run([tokid.executable, *words[1:]], cwd=folder, stdin=subprocess.DEVNULL, text=True,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, check=False)
    return result.returncode, [line.rstrip() for line in result.stdout.splitlines()]


def session_blocks(text):
    """Fenced blocks that begin with a command, as lists of (command, output lines)."""
    for match in re.finditer(r"^```\n(\$ tokid .*?)^```$", text, re.MULTILINE | re.DOTALL):
        session = []
        for line in match[1].splitlines():
            if line.startswith("$ "):
                session.append((line[2:], []))
            else:
                session[-1][1].append(line)
        yield match, session


def same(shown, printed):
    """The same words, and numbers alike to 2 %: the last digits, and times, belong to the machine."""
    if " in " in shown and shown.startswith("Written"):
        shown, printed = (re.sub(r" in [\d.]+ s$", "", line) for line in (shown, printed))
    if NUMBER.sub("#", shown).split() != NUMBER.sub("#", printed).split():
        return False
    pairs = zip(map(float, NUMBER.findall(shown)), map(float, NUMBER.findall(printed)))
    # Of probabilities as small as those, the order of magnitude counts.
    return all(abs(a - b) <= 0.02 * abs(a) or max(abs(a), abs(b)) < 1e-7 for a, b in pairs)


def launch_vehicle(folder):
    """launch.npz of docs/modes.md. The modules of the zoo have names of modules here, so another process makes it."""
    program = ("import sys; from conditions import Condition; from run import make_data; from truth import truth_of; "
               "c = Condition(); make_data('launch', c, truth_of('launch_vehicle', c), sys.argv[1], nonlinear=False)")
    subprocess.run([sys.executable, "-c", program, folder / "launch.npz"], cwd=ROOT / "bench" / "zoo", check=True)


@pytest.mark.parametrize("page, least, prepare", [
    ("guide.md", 8, None), ("control.md", 3, None), ("deploy.md", 5, None), ("modes.md", 6, launch_vehicle)])
def test_pages(tokid, tmp_path, page, least, prepare):
    document = ROOT / "docs" / page
    text = updated = document.read_text()
    update = os.environ.get("TOKID_UPDATE_DOCS") == "1"
    commands = 0
    if prepare:
        prepare(tmp_path)
    for match, session in session_blocks(text):
        block = "```\n"
        for command, shown in session:
            commands += 1
            _, printed = run(tokid, command, tmp_path)
            block += f"$ {command}\n" + "".join(line + "\n" for line in printed)
            if not update:
                for before, now in zip_longest(shown, printed, fillvalue=""):
                    assert same(before, now), f"{command}\nshown:   {before}\nprinted: {now}"
        updated = updated.replace(match[0], block + "```")
    assert commands >= least
    if update:
        document.write_text(updated)
        pytest.skip(f"docs/{page} written anew")


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
    for document in [*(ROOT / "docs").glob("*.md"), ROOT / "CONTRIBUTING.md"]:
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
    ("explanations", "finding.hpp", "enum class Kind {", 11),
    ("findings", "finding.hpp", "enum class Kind {\n    // data", 90),
    ("conclusions", "conclusion.hpp", "enum class Reason {", 20)])
def test_kinds_that_documents_name(table, header, start, least):
    enumerators = (ROOT / "include/tokid" / header).read_text().split(start)[1].split("last =")[0]
    names = re.findall(r"^ +([a-z_]+),", enumerators, re.MULTILINE)
    text = (ROOT / "docs/formats.md").read_text().split(f"<!-- table: {table} -->")[1].split("<!-- end -->")[0]
    assert len(names) >= least
    assert re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE) == names


def test_equations_have_their_place():
    """The code cites no equation that the table lacks, and the table no place that does not cite it."""
    table = (ROOT / "docs/math.md").read_text().split("## Where each equation is")[1].split("\n## ")[0]
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
