# SPDX-License-Identifier: BSD-3-Clause
"""tokid report and identify --report: the page as a file. What it looks like is tested in a browser (tests/browser)."""

import json
import re

import numpy as np
import pytest


def data_of(page):
    text = page.read_text(encoding="utf-8")
    return json.loads(re.search(r'<script type="application/json" id="report-data">(.*?)</script>', text, re.S).group(1))


def summary_of(page):
    text = re.search(r'<p class="summary">(.*?)</p>', page.read_text(encoding="utf-8"), re.S).group(1)
    return text.replace("&#8288;", "").replace("&nbsp;", " ")


def test_report_says_what_validate_says(tokid, oscillator, tmp_path):
    page = tmp_path / "page.html"
    result = tokid("report", oscillator / "model.npz", oscillator / "fresh.npz", "-o", page)
    found = tokid.json("validate", oscillator / "model.npz", oscillator / "fresh.npz")
    assert min(found["simulation_fit"]) > 99.9999
    assert summary_of(page) in result.stdout
    assert summary_of(page).startswith("Simulation fit 100 % on 7 experiments given")
    assert "good" in result.stdout
    with np.load(oscillator / "fresh.npz") as file:
        measured = file["y"]
    for n, experiment in enumerate(data_of(page)["traces"]["experiments"]):
        np.testing.assert_allclose(np.array(experiment["y"]).T, measured[n], rtol=5.1e-6)  # six digits


def test_identify_reports_on_what_it_held_out(tokid, oscillator, tmp_path):
    page, later = tmp_path / "page.html", tmp_path / "later.HTM"
    tokid("identify", oscillator / "data.npz", "-o", tmp_path / "model.npz", "--hold-out", 0.2, "--report", page)
    assert "on 12 held-out experiments" in summary_of(page)
    # The same data given to the model afterwards: the report finds out which of them it had not seen.
    tokid("report", tmp_path / "model.npz", oscillator / "data.npz", "-o", later)
    assert summary_of(later) == summary_of(page)
    assert data_of(later) == data_of(page)


def test_identify_on_all_data_says_so(tokid, oscillator, tmp_path):
    page = tmp_path / "page.html"
    found = tokid.json("identify", oscillator / "data.npz", "-o", tmp_path / "model.npz", "--report", page)
    assert found["evaluated_on"] == "training"
    assert "60 experiments that the model was identified from" in summary_of(page)


def test_same_call_same_page(tokid, oscillator, tmp_path):
    for name in ("a.html", "b.html"):
        tokid("report", oscillator / "model.npz", oscillator / "fresh.npz", "-o", tmp_path / name)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


@pytest.mark.parametrize("output, complaint", [
    ("page.pdf", "extension '.pdf' found, one of .html, .htm needed to write a page"),
    ("missing/page.html", "does not exist"),
])
def test_a_page_that_cannot_be_written_is_told_before_the_work(tokid, oscillator, tmp_path, output, complaint):
    model = tmp_path / "model.npz"
    for call in (["report", oscillator / "model.npz", oscillator / "fresh.npz", "-o", tmp_path / output],
                 ["identify", oscillator / "data.npz", "-o", model, "--report", tmp_path / output]):
        result = tokid(*call, status=2)
        assert complaint in result.stderr and result.stderr.count("\n") == 1
    assert not model.exists()


def test_data_of_another_system_are_refused(tokid, oscillator, tmp_path):
    other, page = tmp_path / "other.npz", tmp_path / "page.html"
    tokid("example", "rotating-tube", "-o", other, "--experiments", 5, "--steps", 40)
    result = tokid("report", oscillator / "model.npz", other, "-o", page, status=2)
    assert str(other) in result.stderr and "inputs: 1 found, the model has 2" in result.stderr
    result = tokid("report", oscillator / "fresh.npz", other, "-o", page, status=2)
    assert "an ensemble found, a model" in result.stderr
    assert not page.exists()
