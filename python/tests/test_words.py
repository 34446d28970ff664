# SPDX-License-Identifier: BSD-3-Clause
"""Messages of the library have the words of Python."""

import re
from pathlib import Path

import numpy as np
import pytest

import tokid
from tokid import _tokid

WORDS = {
    "no feedthrough (--no-feedthrough). If not, that there is (--feedthrough)":
        "no feedthrough (feedthrough=False). If not, that there is (feedthrough=True)",
    "state channels: --inputs 'A,B' --outputs 'C,D'": "state channels: inputs=['A', 'B'], outputs=['C', 'D']",
    "needs --time-invariant or --period P": "needs period='invariant' or period=P",
    "use --weighting one-step or many-steps": "use weighting='one-step' or 'many-steps'",
    "Try --method subspace or --lags": "Try method='subspace' or lags",
    "Delete them, or identify with --block all": "Delete them, or call tokid.identify",
    "column 'a--b' found": "column 'a--b' found",
    "--lags": "lags",
    "of another program: tokid import 'a b.csv' data.npz": "of another program: tokid.read('a b.csv')",
    "State --method subspace.": "State method='subspace'.",
    "a state file of identify --state found; only tokid update reads state files":
        "a state file of tokid.identify(keep_state=True) found; only tokid.UpdateState.load reads state files",
    **{text: text for text in ["run--lags.csv: no such file", "test--feedthrough.npz: no such file",
                               "--lags.csv: no such file", "runs/--lags/a.csv: no such file",
                               "--lags/a.csv: no such file", "my --lags-2.csv: no such file", "column 'u--lags' found"]},
}


@pytest.mark.parametrize("text", WORDS)
def test_messages_have_the_words_of_python(text):
    assert _tokid.in_python(text) == WORDS[text]


def test_errors_have_the_words_of_python(noisy, tmp_path):
    with pytest.raises(ValueError, match="needs period='invariant' or period=P to pool steps"):
        tokid.identify(noisy, weighting="projection")
    (tmp_path / "data.csv").write_text("a,b\n1,2\n3,4\n")
    with pytest.raises(tokid.IoError, match=r"inputs=\['A', 'B'\], outputs=\['C', 'D'\]"):
        tokid.load(tmp_path / "data.csv")


def test_no_message_of_the_library_keeps_an_option_of_the_tool():
    """Pages of a report have the words of the tool, whoever makes them."""
    texts = set()
    for path in (Path(__file__).resolve().parents[2] / "src").rglob("*.cpp"):
        if path.parent.name == "report":
            continue
        source = re.sub(r'"\s*\n\s*"', "", path.read_text(encoding="utf-8"))  # literals of several lines
        texts |= set(re.findall(r'"([^"\n]*--[a-z][^"\n]*)"', source))
    assert len(texts) > 10
    kept = {text for text in texts if re.search(r"--[a-z]", _tokid.in_python(text.replace("{}", "x")))}
    assert kept == set()


def test_findings_and_warnings_have_the_words_of_python():
    """A controller that uses the output of the same step."""
    rng = np.random.default_rng(1)
    u, y, x = np.empty((60, 50, 1)), np.empty((60, 50, 1)), np.zeros((60, 2))
    for k in range(50):
        y[:, k, 0] = x[:, 0] + 0.1 * rng.standard_normal(60)
        u[:, k, 0] = rng.standard_normal(60) - 2.0 * y[:, k, 0]
        x = x @ np.array([[1.0, -0.3 - 0.01 * k], [0.1, 0.9]]) + u[:, k] * [0.0, 0.3]
        x += 0.05 * rng.standard_normal((60, 2))
    with pytest.warns(tokid.TokidWarning, match=r"no feedthrough \(feedthrough=False\)"):
        model = tokid.identify(u, y, dt=0.1, states=2, lags=2, refine=False)
    assert any("(feedthrough=True)" in text for text in model.warnings)
    tokid.identify(u, y, dt=0.1, states=2, lags=2, refine=False, feedthrough=False)  # what the message says
