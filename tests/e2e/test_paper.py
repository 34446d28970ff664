# SPDX-License-Identifier: BSD-3-Clause
"""tokid paper: every figure and every printed number, in files that stand alone."""

import html
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest


@pytest.fixture(scope="module")
def paper(tokid, tmp_path_factory):
    folder = tmp_path_factory.mktemp("paper") / "new" / "folder"
    return folder, tokid("paper", "-o", folder).stdout


def test_says_what_agrees(paper):
    _, text = paper
    assert "98 of 98 printed numbers agree" in text
    assert "0.4371621" in text


def test_files(paper):
    folder, _ = paper
    assert {path.name for path in folder.iterdir()} == {"paper.html", "paper.json"}


def test_numbers(paper):
    folder, _ = paper
    data = json.loads((folder / "paper.json").read_text())
    assert [figure["id"] for figure in data["figures"]] == [f"figure-{i}" for i in range(1, 8)] + [
        "kalman-error", "kalman-gain"]
    for figure in data["figures"]:
        assert figure["caption"] and figure["title"]
        for panel in figure["panels"]:
            for series in panel["series"]:
                assert len(series["x"]) == len(series["y"]) > 0
                assert series["mark"] in (("dot", "ring") if panel["complex_plane"] else ("line", "dashed"))
                assert series["colour"] in range(8)

    entries = [n for n in data["appendix_b"] if re.fullmatch(r"Ā3[567]\[\d,\d\]", n["quantity"])]
    assert len(entries) == 48
    assert all(abs(n["printed"][0] - n["computed"][0]) <= 1e-4 for n in entries)
    eigenvalues = sorted(n["computed"][0] for n in data["appendix_b"]
                         if n["quantity"].startswith("λ") and abs(n["printed"][0]) > 1e-3)
    assert [f"{value:.5g}" for value in eigenvalues] == [
        "-0.14861", "-0.097074", "-0.048167", "0.048661", "0.31545", "0.43716"]
    products = [n for n in data["appendix_b"] if n["equation"] in ("(82)", "(83)")]
    assert len(products) == 32
    assert all(abs(n["computed"][0]) < 1e-11 for n in products)

    def worst(figure, series):
        return max(value for value in data["figures"][figure - 1]["panels"][0]["series"][series]["y"] if value is not None)

    assert worst(2, 0) <= 1e-10  # direct Markov parameters, minimum number of experiments
    assert worst(3, 0) < worst(2, 0) and worst(3, 1) < worst(2, 1)
    opened, observer = (s["y"] for s in data["figures"][5]["panels"][1]["series"])
    assert max(observer[6:]) <= 1e-10 * observer[0]  # 2p + p = 6
    assert min(opened) > 0.1

    cells = {(cell["lags"], cell["experiments"]): cell for cell in data["kalman_study"]["cells"]}
    assert {(p, n) for p in (2, 3, 5, 8, 10) for n in (50, 200, 2000, None)} <= set(cells)
    assert (20, None) in cells and (20, 50) not in cells  # 82 unknowns
    assert cells[10, 2000]["error"] <= 1.04
    assert cells[10, None]["gain"] < cells[5, None]["gain"] < cells[2, None]["gain"]
    excess = data["figures"][7]["panels"][0]["series"]
    assert [series["name"] for series in excess] == ["N = 50", "N = 200", "N = 2000", "N → ∞"]
    for count, series in zip((50, 200, 2000, None), excess):
        assert [1 + y for y in series["y"]] == pytest.approx([cells[p, count]["error"] for p in series["x"]])


def test_captions_tell_the_truth(paper):
    """The numbers in the captions are those of the data."""
    folder, _ = paper
    data = json.loads((folder / "paper.json").read_text())
    captions = [figure["caption"] for figure in data["figures"]]
    curves = [[np.array([np.nan if v is None else v for v in s["y"]]) for panel in figure["panels"] for s in panel["series"]]
              for figure in data["figures"]]
    real, imaginary = ([np.array(s[axis]) for s in data["figures"][0]["panels"][0]["series"]] for axis in "xy")
    plant, observer = (np.hypot(x, y) for x, y in zip(real, imaginary))
    assert f"from {plant.min():.2f} to {plant.max():.2f}" in captions[0]
    assert f"up to {observer.max():.2f} in modulus" in captions[0]
    assert np.sum(observer < 1e-8) == len(observer) // 2  # two of four are zero
    for number in (2, 3):
        direct, recursive = (f"{np.nanmax(c):.1e} at most" for c in curves[number - 1])
        assert direct in captions[number - 1] and recursive in captions[number - 1]
    for number in (4, 5):
        assert f"At most {max(np.abs(c).max() for c in curves[number - 1]):.1e}" in captions[number - 1]
    first, gone = map(int, re.search(r"first (\d+) steps .* at step (\d+),", captions[5]).groups())
    assert gone == first + 2
    norms = curves[5][-1]
    assert norms[gone:].max() < 1e-10 < norms[gone - 1]
    # The axes of figures 2 and 3 are the same, so that they can be compared.
    axes = [data["figures"][number - 1]["panels"][0]["y_range"] for number in (2, 3)]
    assert axes[0] == axes[1] == [min(np.nanmin(c[c > 0]) for i in (1, 2) for c in curves[i]),
                                  max(np.nanmax(c) for i in (1, 2) for c in curves[i])]


def test_page_stands_alone(paper):
    folder, _ = paper
    page = (folder / "paper.html").read_text()
    problems = []

    class Checker(HTMLParser):
        def handle_starttag(self, tag, attributes):
            for name, value in attributes:
                if name in ("src", "srcset", "action") or name == "href" and not re.match("#|data:,$", value):
                    problems.append((tag, name, value))

    Checker().feed(page)
    assert not problems
    assert "url(" not in page and "@import" not in page
    embedded = re.search(r'<script type="application/json" id="report-data">(.*?)</script>', page, re.DOTALL)[1]
    data = json.loads((folder / "paper.json").read_text())
    assert json.loads(embedded) == data
    captions = [html.unescape(text) for text in re.findall(r"<figcaption><b>.*?</b> (.*?)</figcaption>", page)]
    assert sorted(captions) == sorted(figure["caption"] for figure in data["figures"])
    for figure in data["figures"]:
        assert f'id="{figure["id"]}"' in page
        assert all(f'id="plot-{figure["id"]}-{i + 1}"' in page for i in range(len(figure["panels"])))
    # The table of the Kalman study.
    assert all(f"<td class=\"n\">{cell['error']:.3f} ({cell['gain']:.2f})</td>" in page
               for cell in data["kalman_study"]["cells"])


def test_same_numbers_whatever_the_threads(tokid, tmp_path, paper):
    tokid("paper", "-o", tmp_path, "--threads", 3)
    assert (tmp_path / "paper.json").read_bytes() == (paper[0] / "paper.json").read_bytes()


@pytest.mark.parametrize("make, options, words", [
    (lambda path: path.write_text("x"), [], "a file found, a directory needed"),
    (lambda path: None, ["--seed", "-1"], "--seed"),
    (lambda path: None, ["--threads", "many"], "--threads"),
])
def test_wrong_calls(tokid, tmp_path, make, options, words):
    target = tmp_path / "paper"
    make(target)
    result = tokid("paper", "-o", target, *options, status=2)
    assert words in result.stderr and len(result.stderr.splitlines()) == 1
    assert not target.is_dir()


def test_directory_is_required(tokid):
    assert "--output" in tokid("paper", status=2).stderr
