# SPDX-License-Identifier: BSD-3-Clause
"""Results in a terminal and in a notebook."""

import copy
import pickle
import re

import numpy as np
import pytest

import tokid
from tokid import _display

pytestmark = pytest.mark.filterwarnings("ignore::tokid.TokidWarning")

NAMED = {"output_names": ["angle", "rate"], "input_names": ["left", "right"]}


@pytest.fixture(scope="module")
def named(noisy):
    return tokid.Ensemble(noisy.u, noisy.y, dt=noisy.dt, initial_state="zero", **NAMED)


@pytest.fixture(scope="module")
def held_out(named):
    return tokid.identify(named, hold_out=0.25, states=4, lags=4, refine=False)


def cells(text):
    """The columns of the rows that begin with the name of an output."""
    return {row[0]: row[1:] for row in (re.split(r"\s{2,}", line.strip()) for line in text.splitlines())
            if row[0] in NAMED["output_names"]}


@pytest.mark.parametrize("fit, shown", [(100.0, "100 %"), (99.99999, "99.99999 %"), (99.97, "99.97 %"), (97.19, "97.1 %"),
                                        (-0.04, "−0.1 %"), (-146.0, "−146.0 %"), (-2000.0, "below −999 %"),
                                        (np.nan, "–"), (-np.inf, "–")])
def test_fits_are_rounded_down(fit, shown):
    assert _display.percent(fit) == shown


def test_fits_are_those_of_the_tool(tool, held_out, named, tmp_path):
    held_out.save(tmp_path / "model.npz")
    named.save(tmp_path / "data.npz")
    printed = tool("validate", tmp_path / "model.npz", tmp_path / "data.npz", "--horizon", 5, "--verbose")
    fits = printed[printed.index("Fit  "):printed.index("Compared")]
    shown = repr(held_out.validate(named, horizon=5))
    rows = cells(fits.replace("Fit  ", "     "))
    assert list(rows) == NAMED["output_names"]
    for name, row in rows.items():
        assert cells(shown)[name] == row
    titles = r"output +simulation +one step +5 steps$"
    assert re.search(titles, fits, re.M) and re.search(titles, shown, re.M)
    assert "5 steps" not in repr(held_out.validate(named))
    for label in ("Innovations", "Whiteness", "Gains", "Feedback"):
        beginning = re.search(rf"^{label}\s+(\S+ \S+ \S+)", printed, re.M)[1]
        assert re.search(rf"^  {label}\s+{re.escape(beginning)}", shown, re.M), label


def test_the_verdict_is_that_of_the_tool(tool, held_out, named, tmp_path):
    named.save(tmp_path / "data.npz")
    found = tool("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--hold-out", 0.25, "--states", 4,
                 "--lags", 4, "--no-refine", "--json")["verdict"]
    verdict = held_out.identification.verdict
    assert (verdict.trust, verdict.summary, verdict.reasons) == (found["trust"], found["summary"], found["reasons"])
    assert "on 10 held-out experiments" in verdict.summary
    assert [check.name for check in verdict.checks] == [check["name"] for check in found["checks"]]


def test_a_verdict_on_training_data_and_on_a_page(named, tmp_path):
    options = {"states": 4, "lags": 4, "refine": False}
    plain = tokid.identify(named, **options)
    assert "that the model was identified from" in plain.identification.verdict.summary
    paged = tokid.identify(named, **options, report=tmp_path / "page.html")
    assert repr(paged.identification.verdict) == repr(plain.identification.verdict)
    # A model alone does not know the cross-validation of its identification.
    assert "In cross-validation" in plain.identification.verdict.summary
    assert plain.report(named).reasons == plain.identification.verdict.reasons
    for same in (pickle.loads(pickle.dumps(plain)), copy.deepcopy(plain)):
        assert repr(same.identification.verdict) == repr(plain.identification.verdict)


def test_a_bad_model_has_reasons(named):
    rng = np.random.default_rng(0)
    model = tokid.identify(named.u, rng.normal(size=named.y.shape), dt=0.05, hold_out=0.25, states=2, lags=2, refine=False)
    verdict = model.identification.verdict
    assert verdict.trust == "don't trust" and verdict.reasons
    shown = repr(model.identification)
    assert "Verdict        don't trust" in shown and f"- {verdict.reasons[0][:30]}" in shown
    assert "don&#x27;t trust" in model._repr_html_()


@pytest.mark.parametrize("result", ["validation", "identification", "verdict", "cross-validation"])
def test_results_are_short(result, held_out, named):
    found = {
        "validation": lambda: held_out.validate(named, horizon=5),
        "identification": lambda: held_out.identification,
        "verdict": lambda: held_out.report(named),
        "cross-validation": lambda: tokid.cross_validate(named, folds=4, states=4, lags=4, refine=False),
    }[result]()
    shown, page = repr(found), found._repr_html_()
    assert shown.startswith(f"tokid.{type(found).__name__}\n") and 3 <= shown.count("\n") <= 30
    assert max(map(len, shown.splitlines())) <= 100
    assert page.startswith("<table><caption>tokid.") and page.count("<table>") == page.count("</table>")
    if result != "verdict":
        assert list(cells(shown)) == NAMED["output_names"] and "<td>angle</td>" in page
        assert all(cell.endswith(" %") for row in cells(shown).values() for cell in row)
    if result == "validation":
        assert "5 steps" in shown and len(cells(shown)["rate"]) == 3
    if result == "cross-validation":
        assert "K = 4, n = 4 in all folds; p = 4 in all folds" in shown and "±" in cells(shown)["rate"][0]
        model = held_out.cross_validate(named, folds=4)
        assert model.output_names == NAMED["output_names"]


def test_cross_validations_are_those_of_the_tool(tool, held_out, named, tmp_path):
    held_out.save(tmp_path / "model.npz")
    named.save(tmp_path / "data.npz")
    printed = tool("validate", tmp_path / "model.npz", tmp_path / "data.npz", "--horizon", 5, "--cross-validate", 4)
    folds = printed[printed.index("Folds  "):]
    shown = repr(held_out.cross_validate(named, folds=4, horizon=5))
    words = re.search(r"^Folds +(.*)$", folds, re.M)[1]
    assert words == "K = 4, n = 4 in all folds; p = 4 in all folds" and words in shown
    assert list(cells(folds)) == NAMED["output_names"] and "5 steps" in shown
    assert {name: row[:3] for name, row in cells(folds).items()} == cells(shown)


def test_large_spreads_are_whole_numbers():
    fits = tokid.results.Fit(fit=np.array([-250.0, 90.0]), rmse=np.ones(2), samples=9)
    table = tokid.results._fits(["a", "b"], {"one step": fits}, {"one step": np.array([1234.5, 0.123])})
    assert table[1:] == [["a", "−250.0 ± 1234 %"], ["b", "90.0 ± 0.12 %"]]


def test_a_single_record_holds_out_steps(noisy):
    """The last steps are held out of one experiment, and experiments of several."""
    options = {"dt": noisy.dt, "period": "invariant", "hold_out": 0.25, "lags": 2, "states": 4, "refine": False}
    model = tokid.identify(np.concatenate(noisy.u), np.concatenate(noisy.y), **options)
    assert re.search(r"^  Fit +on data held out$", repr(model.identification), re.M)
    model = tokid.identify(noisy.u, noisy.y, **options)
    found = model.identification
    assert (found.experiments, found.held_out_experiments) == (len(noisy.u) - round(len(noisy.u) / 4), round(len(noisy.u) / 4))
    assert re.search(rf"^  Fit +on {found.held_out_experiments} experiments held out$", repr(found), re.M)


def test_other_results_have_a_field_in_each_line(held_out):
    found = held_out.identification
    assert repr(found.validation.simulation).startswith("Fit(fit=[")
    scores = repr(found.order_scores)
    assert scores.startswith("tokid.OrderScores\n") and re.search(r"^  horizons\s+\[1, 5\]$", scores, re.M)
    assert "<th>horizons</th><td>[1, 5]</td>" in found.order_scores._repr_html_()


def test_findings_are_single_lines(named):
    with pytest.warns(tokid.TokidWarning, match="sample time"):
        model = tokid.identify(named.u, named.y, states=4, lags=4, refine=False)
    (found,) = [finding for finding in model.findings if "sample time" in finding.text]
    assert repr(found) == f"<Finding {found.kind}, note: {found.text}>"
    assert found.text in found._repr_html_()


def test_summaries_are_tables(named):
    summary = named.summary()
    assert isinstance(summary, dict) and list(summary) == NAMED["input_names"] + NAMED["output_names"]
    assert summary["angle"].std == pytest.approx(named.y[..., 0].std()) and summary["angle"].samples == 1200
    title, head, *rows = repr(summary).splitlines()
    assert head.split() == ["channel", "samples", "missing", "mean", "std", "min", "max"]
    assert rows[2].split() == ["angle", "1200", "0"] + [f"{value:.3g}" for value in (
        named.y[..., 0].mean(), named.y[..., 0].std(), named.y[..., 0].min(), named.y[..., 0].max())]
    assert "<td>angle</td><td>1200</td>" in summary._repr_html_()
    assert repr(summary["angle"]).startswith("ChannelSummary(samples=1200, missing=0, mean=")
    assert pickle.loads(pickle.dumps(summary)) == summary


def test_texts_of_users_are_escaped(named):
    data = tokid.Ensemble(named.u, named.y, dt=0.05, output_names=["<b>", "&"])
    assert "<td>&lt;b&gt;</td>" in data.summary()._repr_html_()
