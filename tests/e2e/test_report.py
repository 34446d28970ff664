# SPDX-License-Identifier: BSD-3-Clause
"""tokid report and identify --report: the page as a file. What it looks like is tested in a browser (tests/browser)."""

import html
import json
import re

import numpy as np
import pytest
from support import fit, load, predict, simulate


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
        np.testing.assert_allclose(np.array(experiment["y"]).T, measured[n], **six_digits)


NOISY = ["--steps", 40, "--process-noise", 0.05, "--measurement-noise", 0.1]


@pytest.fixture(scope="module")
def noisy_model(tokid, tmp_path_factory):
    folder = tmp_path_factory.mktemp("noisy")
    tokid("example", "oscillator", "-o", folder / "data.npz", "--experiments", 60, *NOISY)
    tokid("identify", folder / "data.npz", "-o", folder / "model.npz", "--states", 4)
    return folder / "model.npz"


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_page_and_validate_tell_one_number_of_each_test(tokid, noisy_model, tmp_path, seed):
    tokid("example", "oscillator", "-o", tmp_path / "fresh.npz", "--experiments", 200, "--seed", seed, *NOISY)
    verdict = tokid("report", noisy_model, tmp_path / "fresh.npz", "-o", tmp_path / "page.html").stdout
    page = html.unescape((tmp_path / "page.html").read_text(encoding="utf-8")).replace("\xa0", " ").replace("\u2060", "")
    told = tokid("validate", noisy_model, tmp_path / "fresh.npz", "--verbose").stdout
    told, verdict = (re.sub(r"\n {15}(?! |- |Simulation)", " ", text) for text in (told, verdict))
    found = tokid.json("validate", noisy_model, tmp_path / "fresh.npz")
    conclusions = found["conclusions"]
    assert data_of(tmp_path / "page.html")["conclusions"] == conclusions
    for row, key, p in (("Innovations", "nis", "nis_p"), ("Whiteness", "whiteness", "whiteness_p"),
                        ("Inputs", "independence", "independence_p"), ("Gains", "gains", None),
                        ("Feedback", "feedback", "feedback_p")):
        text = re.search(rf"^{row} +(.*)$", told, re.M).group(1)
        assert text in page
        if p is not None:
            shown = re.search(r"p = ([\d.e-]+)|p < 0.0001", text)
            # three digits
            assert float(shown.group(1)) == pytest.approx(found[p], rel=5.1e-3) if shown.group(1) else found[p] < 1e-4
        assert (text in verdict) == (conclusions[key]["result"] == "against")
    reasons = re.findall(r"^ +- ", verdict, re.M)
    silent = "No check of this page speaks against the model" in page
    assert silent == (not reasons and not {"against", "negligible"} & {c["result"] for c in conclusions.values()})


def test_fits_of_a_page_begin_at_a_step(tokid, tmp_path):
    files = [tmp_path / name for name in ("data.npz", "fresh.npz")]
    for seed, file in enumerate(files):
        tokid("example", "oscillator", "-o", file, "--experiments", 40, "--steps", 40, "--seed", 3 + seed,
              "--measurement-noise", 0.05)
    model, page = tmp_path / "model.npz", tmp_path / "page.html"
    tokid("identify", files[0], "-o", model, "--lags", 2, "--states", 4, "--no-refine")
    with np.load(files[1]) as file:
        arrays = {name: file[name] for name in file.files}
    arrays["y"][:, :3] += 10
    np.savez(files[1], **arrays)
    summary = {}
    for begin in (0, 12):
        found = tokid.json("report", model, files[1], "-o", page, "--from", begin)
        summary[begin] = tokid.json("validate", model, files[1], "--from", begin)["verdict"]
        assert summary[begin].items() <= found.items()
        assert ("The fits begin at step 12." in page.read_text()) == (begin == 12)
    assert summary[0] != summary[12]


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


@pytest.fixture(scope="module")
def plotted(tokid, tmp_path_factory):
    """Noisy experiments, the arrays of a model of theirs, and the page's data on others."""
    folder = tmp_path_factory.mktemp("plotted")
    noise = ["--steps", 30, "--process-noise", 0.05, "--measurement-noise", 0.1]
    tokid("example", "oscillator", "-o", folder / "data.npz", "--experiments", 60, *noise)
    tokid("example", "oscillator", "-o", folder / "fresh.npz", "--experiments", 25, "--seed", 2, *noise)
    tokid("identify", folder / "data.npz", "-o", folder / "model.npz", "--method", "tvera")
    tokid("report", folder / "model.npz", folder / "fresh.npz", "-o", folder / "page.html")
    return load(folder / "model.npz"), load(folder / "fresh.npz"), data_of(folder / "page.html")


def number(values):
    return np.array(values, float)  # null becomes NaN


# Rounding to six digits changes a number by at most 5e-6 of it. The rest is for rounding errors of both sides.
six_digits = {"rtol": 5.1e-6, "atol": 1e-12}
eps = np.finfo(float).eps


def test_plotted_singular_values_are_those_of_the_model(plotted):
    model, _, page = plotted
    sigma = page["sigma"]
    assert sigma["begin"] == model["k_begin"] and sigma["stride"] == 1
    assert sigma["order"] == model["state_dim"][:-1].tolist()
    largest = max(np.nanmax(model["singular_values"]), np.abs(model["D"]).max())
    assert sigma["rounding"] == pytest.approx(100 * np.log10(largest * 1e-12), abs=0.5)
    assert len(sigma["log"]) == len(model["singular_values"])
    for column, values in zip(sigma["log"], model["singular_values"]):
        values = values[~np.isnan(values)]
        # Whole hundredths: half of one, and rounding errors of numbers up to 1700.
        np.testing.assert_allclose(column, 100 * np.log10(np.maximum(values, largest * 1e-17)), atol=0.5 + 1e-11)


def test_plotted_steps_are_those_of_the_model(plotted):
    model, _, page = plotted
    steps = page["per_step"]
    assert steps["x"] == list(range(30)) and steps["stretch"] == 1
    np.testing.assert_allclose(number(steps["condition"]), model["condition"], **six_digits)
    assert steps["rank"] == model["rank"].tolist()
    assert steps["lags"] == model["lags"].tolist()
    assert steps["states"] == model["state_dim"][:-1].tolist()
    assert steps["unknowns"] == (2 + 4 * model["lags"]).tolist()  # r + p (r + m)


def test_plotted_whiteness_is_that_of_the_innovations(plotted):
    model, data, page = plotted
    innovations = data["y"] - predict(model, data["u"], data["y"])
    experiments, steps, outputs = innovations.shape
    found = page["whiteness"]
    lags = len(found["bound"])
    assert lags >= 5 and len(found["correlation"]) == outputs
    centred = innovations - innovations.mean(axis=0)
    centred /= np.linalg.norm(centred, axis=0)
    for lag in range(1, lags + 1):
        mean = (centred[:, lag:] * centred[:, :-lag]).sum(axis=0).mean(axis=0)
        np.testing.assert_allclose([found["correlation"][j][lag - 1] for j in range(outputs)], mean, **six_digits)
        np.testing.assert_allclose(found["bound"][lag - 1], 2.5758293 / np.sqrt((experiments - 1) * (steps - lag)), **six_digits)


def reference_frame(model):
    """S_k of x' = S x with S_k = O_s⁺ O_k, s the first step of full dimension; steps that reach the end have none."""
    n = model["state_dim"]
    m = model["C"].shape[1]
    begin, rows = int(np.argmax(n)), max(model["lags"].max(), -(-n.max() // m))

    def observability(k):
        block, product = [], np.eye(model["A"].shape[1])
        for i in range(k, k + rows):
            block.append(model["C"][i] @ product)
            product = model["A"][i] @ product
        return np.concatenate(block)
    inverse = np.linalg.pinv(observability(begin))
    return {k: inverse @ observability(k) for k in range(begin, len(n) - rows) if n[k] == n[begin]}


def test_plotted_gains_and_eigenvalues_are_those_in_the_reference_frame(plotted):
    model, _, page = plotted
    assert page["poles"]["frame"] == page["gain"]["frame"] == "reference"
    S = reference_frame(model)
    steps = [k for k in S if k + 1 in S]
    assert len(steps) > 15
    gain = number(page["gain"]["values"]).reshape(page["gain"]["rows"], page["gain"]["cols"], -1)
    # The frames multiply rounding errors of the matrices by the condition numbers of both transformations.
    rounding = 100 * eps * max(np.linalg.cond(S[k]) * np.linalg.cond(S[k + 1]) for k in steps)
    assert rounding < 1e-7
    assert page["gain"]["x"] == page["poles"]["k"] == steps and page["poles"]["stride"] == 1
    for i, k in enumerate(steps):
        G = S[k + 1] @ model["G"][k]
        np.testing.assert_allclose(gain[..., i], G, rtol=5.1e-6, atol=rounding * np.abs(G).max())
        inverse = np.linalg.inv(S[k])
        for name, matrix in (("open", model["A"][k]), ("closed", model["A"][k] + model["G"][k] @ model["C"][k])):
            found = number(page["poles"][name][i]).reshape(-1, 2) @ [1, 1j]
            expected = np.linalg.eigvals(S[k + 1] @ matrix @ inverse)
            for value in expected:  # each has its own among those found, whatever their order
                nearest = np.argmin(abs(found - value))
                assert abs(found[nearest] - value) < 5.1e-6 * abs(expected).max()
                found = np.delete(found, nearest)
            assert found.size == 0


def test_plotted_A_is_that_of_the_model_turned_to_vary_slowly(plotted):
    model, _, page = plotted
    n = model["state_dim"]
    A = number(page["A"]["values"]).reshape(page["A"]["rows"], page["A"]["cols"], -1)
    assert page["A"]["x"] == list(range(30)) and A.shape[:2] == (n.max(), n.max())
    smooth, raw = [], []
    for k in range(30):
        assert np.isnan(A[n[k + 1]:, :, k]).all() and np.isnan(A[:, n[k]:, k]).all()
        found, given = A[:n[k + 1], :n[k], k], model["A"][k][:n[k + 1], :n[k]]
        # Rotations of the states before and after a step, which belong to the next and the last step as well.
        for before in ([], [k - 1]) if k else ([],):
            for i in before:
                found, given = found @ A[:n[k], :n[i], i], given @ model["A"][i][:n[k], :n[i]]
            if found.size:
                # Each of up to two factors has six digits. Singular values change by at most the norm of the error.
                norms = [np.linalg.norm(np.nan_to_num(A[..., i])) for i in (k, *before)]
                np.testing.assert_allclose(np.linalg.svd(found, compute_uv=False), np.linalg.svd(given, compute_uv=False),
                                           rtol=0, atol=5.1e-6 * len(norms) * np.prod(norms))
        if k and n[k - 1] == n[k] == n[k + 1] == n.max():
            smooth.append(np.linalg.norm(A[..., k] - A[..., k - 1]))
            raw.append(np.linalg.norm(model["A"][k] - model["A"][k - 1]))
    assert np.median(smooth) < 0.5 * np.median(raw)


@pytest.mark.parametrize("known, first, caption", [
    (("condition", "rank", "lags"), [17, 9], "the worst conditioned first"),
    (("rank", "lags"), [21, 12], "those first whose rank lacks most"),
    (("rank",), [0, 1], "those of lowest rank first")])
def test_table_of_steps_says_how_it_was_chosen(tokid, oscillator, tmp_path, known, first, caption):
    model, page = load(oscillator / "model.npz"), tmp_path / "page.html"
    unknowns = 2 + 4 * model["lags"]
    model["rank"] = unknowns.copy()
    model["rank"][[12, 21]] -= [1, 3]
    model["condition"] = np.linspace(1, 2, 40)
    model["condition"][[9, 17]] = 1e5, 1e6
    model["condition"][[3, 30]] = np.nan
    for name in {"condition", "rank", "lags"} - set(known):
        del model[name]
    np.savez(tmp_path / "model.npz", **model)
    tokid("report", tmp_path / "model.npz", oscillator / "fresh.npz", "-o", page)
    table = re.search(f"<caption>10 of 40 steps, {caption}</caption>(.*?)</table>", page.read_text(), re.S).group(1)
    steps = [int(k) for k in re.findall(r'<th scope="row" class="n">(\d+)</th>', table)]
    assert len(steps) == 10 and steps[:2] == first
    assert not {3, 30} & set(steps) or "condition" not in known


def table_of(page, caption):
    """The rows of a table, as lists of texts."""
    found = re.search(f"<caption[^>]*>{caption}</caption>(.*?)</table>", page.read_text(encoding="utf-8"), re.S).group(1)
    rows = re.findall(r"<tr[^>]*>(.*?)</tr>", found, re.S)[1:]
    return [[html.unescape(cell) for cell in re.findall(r"<t[hd][^>]*>(.*?)</t[hd]>", row)] for row in rows]


def test_checks_decide_the_verdict(tokid, oscillator, tmp_path):
    """Good data, and data with a constant output, few experiments and another sample time: the table and the JSON have
    the checks, and the worst of them is the status."""
    with np.load(oscillator / "fresh.npz") as file:
        arrays = {key: file[key] for key in file.files}
    arrays["y"] = arrays["y"].copy()
    arrays["y"][..., 1] = 7.0
    arrays["dt"] = 0.2
    arrays["u"], arrays["y"] = arrays["u"][:2], arrays["y"][:2]
    np.savez(tmp_path / "bad.npz", **arrays)
    for data, status, failed in ((oscillator / "fresh.npz", "good", set()),
                                 (tmp_path / "bad.npz", "don't trust",
                                  {"outputs", "one_step_fit", "error_peaks", "experiments", "rank", "channels",
                                   "whiteness", "gains", "nis"})):
        page = tmp_path / "page.html"
        printed = tokid("report", oscillator / "model.npz", data, "-o", page).stdout
        checks = data_of(page)["checks"]
        assert {check["name"] for check in checks if check["result"] not in ("good", None)} == failed
        severity = ["good", "look closer", "don't trust"]
        worst = max((check["result"] for check in checks if check["result"]), key=severity.index)
        assert re.search(r"^Verdict +(.*)$", printed, re.M).group(1) == worst
        assert worst == status
        words = {"good": "✓\xa0passed", "look closer": "!\xa0look closer", "don't trust": "✗\xa0don’t trust",
                 None: "–\xa0not tested"}
        shown = table_of(page, "Checks of the verdict")
        assert sorted(row[:2] for row in shown) == sorted([c["subject"], words[c["result"]]] for c in checks)
        ranks = [["✗", "!", "✓", "–"].index(row[1][0]) for row in shown]
        assert ranks == sorted(ranks)
        # The figures are those of the data.
        found = {check["name"]: check["found"] for check in checks}
        assert found["experiments"] == str(len(np.load(data)["u"]))
        assert found["missing"] == "none"
        # The numbers alone decide, and say the same.
        for check in checks:
            assert (check["result"] is None) == (check["untested"] is not None)
            if check["result"] is not None:
                assert passes(check) == (check["result"] == "good"), check["name"]
        figures = {check["name"]: check["figures"][0] for check in checks if check["figures"]}
        assert figures["experiments"] == {"name": "count", "values": [len(np.load(data)["u"])], "rule": "at least", "bound": 3,
                                          "kept": len(np.load(data)["u"]) >= 3}
        assert figures["one_step_fit"]["bound"] == figures["one_step_fit"]["distrust"] == 50
        # The page has all reasons, and the JSON of `report` and `validate` the same verdict and checks.
        verdict, told = data_of(page)["verdict"], tokid.json("report", oscillator / "model.npz", data, "-o", page)
        reasons = [reason["text"] for check in checks for reason in check["reasons"]]
        assert sorted(verdict["reasons"]) == sorted(reasons) == sorted(told["reasons"])
        assert told["checks"] == checks and {key: told[key] for key in verdict} == verdict
        validated = tokid.json("validate", oscillator / "model.npz", data)["verdict"]
        assert validated.pop("checks") == checks and validated == verdict
        # The JSON has the findings of the page, each once.
        assert told["findings"] == data_of(page)["findings"]
        assert len(set(told["warnings"])) == len(told["warnings"])



def passes(check):
    """Whether the figures of a check keep their bounds."""
    def kept(figure):
        known = [value for value in figure["values"] if value is not None]
        keeps = {"at least": lambda v: v >= figure["bound"], "at most": lambda v: v <= figure["bound"],
                 "below": lambda v: v < figure["bound"]}[figure["rule"]]
        assert figure["kept"] == (bool(known) and all(map(keeps, known)))
        return figure["kept"]
    return (any if check["one_suffices"] else all)(map(kept, check["figures"]))


def test_all_experiments_are_shown_the_worst_first(tokid, oscillator, tmp_path):
    model = load(oscillator / "model.npz")
    tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--experiments", 2600, "--steps", 40, "--seed", 4,
          "--measurement-noise", 0.02)
    arrays = load(tmp_path / "data.npz")
    arrays["y"][1234] *= -1  # a swapped plug
    np.savez(tmp_path / "data.npz", **arrays)
    page = tmp_path / "page.html"
    tokid("report", oscillator / "model.npz", tmp_path / "data.npz", "-o", page)
    found = data_of(page)["experiments"]
    y = arrays["y"]
    spread = np.sqrt(((y - y.mean(axis=(0, 1))) ** 2).mean(axis=(0, 1)))
    def rms(computed):
        return np.sqrt((((y - computed) / spread) ** 2).mean(axis=(1, 2)))
    simulation, one_step = rms(simulate(model, arrays["u"])), rms(predict(model, arrays["u"], y))
    # tokid takes the upper one of two middle values as median.
    limits = [max(0.05, 10 * np.sort(errors)[1300]) for errors in (simulation, one_step)]
    excess = np.maximum(simulation / limits[0], one_step / limits[1])
    order = np.argsort(-excess, kind="stable")
    assert found["x"] == [*range(1, 1001), *range(1001, 2601, 2)]
    rows = np.array(found["row"])
    np.testing.assert_array_equal(rows, order[np.array(found["x"]) - 1])
    for key, expected in (("simulation_error", simulation), ("one_step_error", one_step), ("excess", excess)):
        np.testing.assert_allclose(found[key], expected[rows], **six_digits)
    assert set(found["simulation_samples"]) == set(found["one_step_samples"]) == {80}
    assert rows[0] == 1234 and found["outlying"] == [True] + [False] * (len(rows) - 1)
    np.testing.assert_allclose([found["simulation_limit"], found["one_step_limit"]], limits, **six_digits)
    shown = table_of(page, "RMS errors relative to the spread of the outputs")
    assert len(shown) >= 12 and shown[0][0] == "Experiment 1234" and "outlying error" in shown[0][-1]
    # Three digits.
    np.testing.assert_allclose([float(cell) for cell in shown[0][1:4]],
                               [simulation[1234], one_step[1234], excess[1234]], rtol=5.1e-3)
    assert page.stat().st_size < 1_500_000


def test_page_and_validate_have_the_same_errors_of_experiments(tokid, tmp_path):
    """In the same order, with copies left out, also where predictions decide."""
    noise = ["--steps", 40, "--process-noise", 0.05, "--measurement-noise", 0.1]
    tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--experiments", 40, *noise)
    tokid("example", "oscillator", "-o", tmp_path / "fresh.npz", "--experiments", 20, "--seed", 2, *noise)
    tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--states", 4, "--no-refine")
    arrays = load(tmp_path / "fresh.npz")
    arrays["y"][7] *= -1
    arrays["y"][11, 20:, 1] = np.nan
    for key in "uy":
        arrays[key] = np.concatenate((arrays[key], arrays[key][[3, 7]]))
    np.savez(tmp_path / "fresh.npz", **arrays)
    tokid("report", tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", tmp_path / "page.html")
    page, found = data_of(tmp_path / "page.html")["experiments"], tokid.json(
        "validate", tmp_path / "model.npz", tmp_path / "fresh.npz")
    listed = found["worst_experiments_first"]
    assert page["row"] == [one["experiment"] for one in listed] and sorted(page["row"]) == list(range(20))
    assert page["outlying"] == [one["outlying"] for one in listed] == [True] + [False] * 19 and page["row"][0] == 7
    for key in ("simulation_error", "one_step_error", "excess"):
        np.testing.assert_allclose(page[key], [one[key] for one in listed], **six_digits)
    for kind in ("simulation", "one_step"):
        assert page[f"{kind}_samples"] == [sum(one[f"{kind}_samples"]) for one in listed]
        np.testing.assert_allclose(page[f"{kind}_limit"], found["experiment_limits"][kind], **six_digits)
    assert page["one_step_samples"][page["row"].index(11)] == 60


def test_page_of_an_identification_has_its_candidates(tokid, tmp_path):
    tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--experiments", 30, "--steps", 25,
          "--process-noise", 0.05, "--measurement-noise", 0.1)
    page = tmp_path / "page.html"
    found = tokid.json("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--report", page)
    trials = table_of(page, "Candidates of lag order and λ")
    errors = [float(row[2].removesuffix(" %")) for row in trials]
    assert len(trials) > 3 and errors == sorted(errors)
    chosen = [row for row in trials if row[3] == "chosen"]
    assert [row[0] for row in chosen] == [str(found["lags"])]
    assert errors[trials.index(chosen[0])] <= 1.02 * errors[0]
    states = table_of(page, "Candidates of the number of states")
    assert [int(row[0]) for row in states] == sorted({int(row[0]) for row in states}) and len(states) > 2
    best = next(row for row in states if row[-1] == "chosen")
    above = [float(row[-2].removesuffix(" %")) for row in states]
    assert min(above) >= 0 and above[states.index(best)] <= 2 and max(above) > above[states.index(best)]
    refined = table_of(page, "Candidates of the refinement by EM")
    assert sum(row[-1] == "chosen" for row in refined) <= 1 and len(refined) > 1
    # A model's file does not have them, and its page says so.
    tokid("report", tmp_path / "model.npz", tmp_path / "data.npz", "-o", tmp_path / "later.html")
    later = (tmp_path / "later.html").read_text(encoding="utf-8")
    assert "Candidates of" not in later and "on the page that tokid identify --report writes" in html.unescape(later)
    # Without noise, the rank decides.
    tokid("example", "oscillator", "-o", tmp_path / "exact.npz", "--experiments", 30, "--steps", 40)
    tokid("identify", tmp_path / "exact.npz", "-o", tmp_path / "model.npz", "--report", page)
    orders = table_of(page, "Candidates of the lag order")
    assert sum(row[2] == "chosen" for row in orders) == 1


def test_plotted_correlation_with_the_inputs(plotted):
    """The mean over the steps of the correlations over the experiments, for each output and input."""
    model, data, page = plotted
    found = page["input_correlation"]
    innovations = data["y"] - predict(model, data["u"], data["y"])
    def unit(values):
        values = values - values.mean(axis=0)
        return values / np.linalg.norm(values, axis=0)
    e, u = unit(innovations), unit(data["u"])
    experiments, steps, outputs = e.shape
    lags = len(found["inputs"][0]["bound"])
    assert found["first"] == -5 and lags == 11 and len(found["inputs"]) == u.shape[2]
    for i, values in enumerate(found["inputs"]):
        for at, lag in enumerate(range(-5, 6)):
            k = np.arange(max(0, lag), min(steps, steps + lag))
            for j in range(outputs):
                expected = (e[:, k, j] * u[:, k - lag, i]).sum(axis=0).mean()
                np.testing.assert_allclose(values["correlation"][j][at], expected, **six_digits)
            np.testing.assert_allclose(values["bound"][at], 2.5758293 / np.sqrt((experiments - 1) * len(k)), **six_digits)


def test_wrong_feedthrough_shows_at_lag_0_of_its_input(tokid, tmp_path):
    noise = ["--steps", 30, "--measurement-noise", 0.1]
    tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--experiments", 60, *noise)
    tokid("example", "oscillator", "-o", tmp_path / "fresh.npz", "--experiments", 60, "--seed", 5, *noise)
    tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--no-refine")
    model = load(tmp_path / "model.npz")
    def excess():
        tokid("report", tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", tmp_path / "page.html")
        found = data_of(tmp_path / "page.html")["input_correlation"]["inputs"]
        return np.array([[np.abs(values) / np.array(one["bound"]) for values in one["correlation"]] for one in found])
    before = excess()  # input, output, lag from -5 on
    model["D"][:, 1, 0] += 0.2 * np.abs(model["D"]).max() + 0.1
    np.savez(tmp_path / "model.npz", **model)
    after = excess()
    assert after[0, 1, 5] > 3 and np.argmax(after) == np.ravel_multi_index((0, 1, 5), after.shape)
    assert (before > 1).mean() < 0.05 and (after[1] > 1).mean() < 0.05


def response(model, start, length, pulse):
    """Outputs (length, output, input) after an input at one step, or from one step on."""
    begin, inputs = int(model["k_begin"]), model["B"].shape[2]
    x, y = np.zeros((model["A"].shape[2], inputs)), []
    for k in range(start - begin, start - begin + length):
        acts = k == start - begin or not pulse
        y.append(model["C"][k] @ x + acts * model["D"][k])
        x = model["A"][k] @ x + acts * model["B"][k]
    return np.array(y)


def test_plotted_responses_are_those_of_the_model(plotted):
    model, _, page = plotted
    found = page["responses"]
    assert found["length"] == 15 and found["starts"][0] == model["k_begin"] and found["starts"][-1] == 15
    assert len(found["starts"]) == 7 and found["bands"] is None
    for kind in ("pulse", "step"):
        for start, pairs in zip(found["starts"], found[kind]):
            expected = response(model, start, 15, kind == "pulse").transpose(2, 1, 0).reshape(-1, 15)  # input, output
            # Each value is a sum of products of up to 15 steps and 4 states: rounding errors of the largest terms.
            np.testing.assert_allclose(number(pairs), expected, rtol=5.1e-6, atol=60 * eps * np.abs(expected).max())


@pytest.mark.parametrize("slow", [True, False])
def test_plotted_modes_are_those_of_the_tool(tokid, tmp_path, slow):
    """Of a slow system, whose modes are valid, and of the oscillator, where they are not."""
    if slow:
        rng = np.random.default_rng(5)
        A = np.array([[0.97, 0.2, 0.0], [-0.2, 0.97, 0.0], [0.0, 0.0, 0.9]]) * 0.99
        B, C, x = rng.standard_normal((3, 2)), rng.standard_normal((2, 3)), np.zeros((16, 3))
        u, y = rng.standard_normal((16, 60, 2)), np.zeros((16, 60, 2))
        for k in range(60):
            y[:, k] = x @ C.T + 0.01 * rng.standard_normal((16, 2))
            x = x @ A.T + u[:, k] @ B.T
        np.savez(tmp_path / "data.npz", u=u, y=y, dt=0.05, initial_state="zero")
        options = ["--states", 3, "--lags", 4, "--no-refine"]
    else:
        tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--experiments", 30, "--steps", 50,
              "--measurement-noise", 0.01)
        options = ["--states", 4, "--lags", 4, "--no-refine"]
    tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", *options)
    tokid("report", tmp_path / "model.npz", tmp_path / "data.npz", "-o", tmp_path / "page.html")
    shown, found = data_of(tmp_path / "page.html")["modes"], tokid.json("modes", tmp_path / "model.npz")
    valid, leads = np.array(found["valid"]), ~(number(found["poles_imag"]) < 0)
    assert shown["stretch"] == 1 and shown["x"] == list(range(found["begin"], found["begin"] + len(valid)))
    assert [mode["mode"] - 1 for mode in shown["modes"]] == list(np.flatnonzero(leads.any(axis=0)))
    assert valid.any() == slow
    pole = number(found["poles_real"]) + 1j * number(found["poles_imag"])
    for mode in shown["modes"]:
        i = mode["mode"] - 1
        for name, expected in (("frequency", abs(pole[:, i])), ("damping", -pole[:, i].real / abs(pole[:, i]))):
            for key, there in ((name, valid[:, i]), (f"other_{name}", ~valid[:, i])):
                # Numbers of the page have six digits.
                np.testing.assert_allclose(number(mode[key]), np.where(there & leads[:, i], expected, np.nan), rtol=5.1e-6)


def test_bands_of_the_responses(tokid, tmp_path):
    """They hold the truth about as often as stated, and surround the responses of the model."""
    noise = ["--steps", 24, "--measurement-noise", 0.1]
    tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--experiments", 40, *noise)
    tokid("example", "oscillator", "-o", tmp_path / "fresh.npz", "--experiments", 5, "--seed", 2, *noise)
    # Without noise, a model has the responses of the system.
    tokid("example", "oscillator", "-o", tmp_path / "exact.npz", "--experiments", 40, "--steps", 24)
    tokid("identify", tmp_path / "exact.npz", "-o", tmp_path / "truth.npz")
    tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--no-refine")
    page = tmp_path / "page.html"
    tokid("report", tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", page, "--bands", tmp_path / "data.npz")
    found, truth = data_of(page)["responses"], load(tmp_path / "truth.npz")
    assert found["bands"]["level"] == 0.95
    for kind in ("pulse", "step"):
        value = number(found[kind])
        lower, upper = (number(found["bands"][f"{kind}_{side}"]) for side in ("lower", "upper"))
        assert value.shape == lower.shape == upper.shape and (lower <= value).all() and (value <= upper).all()
        expected = np.array([response(truth, start, found["length"], kind == "pulse").transpose(2, 1, 0).reshape(4, -1)
                             for start in found["starts"]])
        held = ((lower <= expected) & (expected <= upper)).mean()
        # The responses of a pair of channels from one start on depend on each other: 4 pairs and 7 starts count like 28
        # independent ones. Of these, 6 or more lie outside 95 % bands with a chance of 0.2 %: 22 of 28 are about 0.8.
        assert 0.8 < held < 1
    assert "probability (pointwise)" in page.read_text(encoding="utf-8")
    tokid("report", tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", page)
    assert "no confidence bands" in page.read_text(encoding="utf-8")
    result = tokid("report", tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", page, "--bands",
                   tmp_path / "fresh.npz", status=2)
    assert "fresh.npz" in result.stderr and result.stderr.count("\n") == 1


def test_frozen_frequency_response(tokid, tmp_path):
    """Of a constant system it is C (zI - A)^-1 B + D. Where the system turns fast, the page says why it has none."""
    steps, dt, k = 40, 0.1, np.arange(40)
    turn = np.array([[0.9, 0.3], [-0.3, 0.9]])
    fast = np.array([[[0.9, 0.4 * (-1) ** i], [-0.4 * (-1) ** i, 0.5]] for i in k])
    B, C, D = np.array([[1.0], [0.5]]), np.array([[1.0, 0.2]]), np.array([[0.1]])
    u = np.random.default_rng(1).standard_normal((6, steps, 1))
    for name, A in (("constant", np.tile(turn, (steps, 1, 1))), ("fast", fast)):
        model = {"A": A, "B": np.tile(B, (steps, 1, 1)), "C": np.tile(C, (steps, 1, 1)), "D": np.tile(D, (steps, 1, 1)),
                 "G": np.zeros((steps, 2, 1)), "k_begin": 0, "dt": dt, "initial_state": "zero",
                 "frame": "raw", "state_dim": np.full(steps + 1, 2)}
        np.savez(tmp_path / "model.npz", **model)
        np.savez(tmp_path / "data.npz", u=u, y=simulate(model, u), dt=dt, initial_state="zero")
        tokid("report", tmp_path / "model.npz", tmp_path / "data.npz", "-o", tmp_path / "page.html")
        text, found = (tmp_path / "page.html").read_text(encoding="utf-8"), data_of(tmp_path / "page.html")["frozen"]
        if name == "fast":
            assert found is None and "would mean little" in text and "plot-magnitude" not in text
            continue
        frequencies = np.array(found["frequencies"])
        np.testing.assert_allclose(frequencies[-1], np.pi / dt, **six_digits)
        assert len(found["steps"]) > 3
        expected = np.array([(C @ np.linalg.solve(np.exp(1j * w * dt) * np.eye(2) - turn, B) + D)[0, 0]
                             for w in frequencies])
        for magnitude, phase in zip(found["magnitude"], found["phase"]):
            response = np.array(magnitude[0]) * np.exp(1j * np.deg2rad(phase[0]))
            # Six digits of magnitude and frequency, and phases up to 180 degrees with an error of 5e-4 degrees. The
            # response changes by up to 1/(2ζ) times the relative change of the frequency.
            np.testing.assert_allclose(response, expected, rtol=1e-4)
            assert np.abs(np.diff(phase[0])).max() < 180
        # Chosen steps; those without valid modes are named.
        page = tmp_path / "page.html"
        tokid("report", tmp_path / "model.npz", tmp_path / "data.npz", "-o", page, "--at", "20,0,9,20")
        chosen = data_of(page)
        assert chosen["responses"]["starts"] == [0, 9, 20] and chosen["frozen"]["steps"] == [9, 20]
        assert "Not shown: step 0, where a mode is not valid" in page.read_text(encoding="utf-8")
        tokid("report", tmp_path / "model.npz", tmp_path / "data.npz", "-o", page, "--at", 0)
        assert data_of(page)["frozen"] is None and "Not shown: step 0" in page.read_text(encoding="utf-8")


@pytest.mark.parametrize("at, complaint", [
    ("40", "at: step 40 found, 0 to 39 needed"),
    ("3,,4", "steps separated by commas needed"), ("-1", "steps separated by commas needed"),
    (",".join(map(str, range(25))), "at: 25 steps found, 24 or fewer needed")])
def test_steps_of_responses_are_checked(tokid, oscillator, tmp_path, at, complaint):
    result = tokid("report", oscillator / "model.npz", oscillator / "fresh.npz", "-o", tmp_path / "page.html", "--at", at,
                   status=2)
    assert complaint in result.stderr and not (tmp_path / "page.html").exists()


def slow_system(folder, tokid):
    """Data of a constant system with noise, and the frequency response (F, m, r) of that system."""
    A = np.array([[0.97, 0.2, 0.0], [-0.2, 0.97, 0.0], [0.0, 0.0, 0.9]]) * 0.99
    rng = np.random.default_rng(5)
    B, C = rng.standard_normal((3, 2)), rng.standard_normal((2, 3))
    for name, seed in (("data", 1), ("fresh", 2)):
        rng = np.random.default_rng(seed)
        u, x, y = rng.standard_normal((16, 60, 2)), np.zeros((16, 3)), np.zeros((16, 60, 2))
        for k in range(60):
            y[:, k] = x @ C.T + 0.1 * rng.standard_normal((16, 2))
            x = x @ A.T + u[:, k] @ B.T
        np.savez(folder / f"{name}.npz", u=u, y=y, dt=0.05, initial_state="zero")
    for name, states in (("model", 3), ("other", 2)):
        tokid("identify", folder / "data.npz", "-o", folder / f"{name}.npz", "--states", states, "--no-refine",
              "--smoothing", "inf")
    return lambda w: np.array([C @ np.linalg.solve(np.exp(1j * f * 0.05) * np.eye(3) - A, B) for f in w])


def test_bands_of_frozen_responses(tokid, tmp_path):
    """They hold the truth about as often as stated, and surround the response of the model. Other models have theirs."""
    truth = slow_system(tmp_path, tokid)
    page = tmp_path / "page.html"
    tokid("report", tmp_path / "model.npz", tmp_path / "fresh.npz", "-o", page, "--bands", tmp_path / "data.npz",
          "--compare", tmp_path / "other.npz", "--at", "10,30")
    found = data_of(page)["frozen"]
    assert found["steps"] == data_of(page)["responses"]["starts"] == [10, 30] and found["bands"]["level"] == 0.95
    expected = truth(found["frequencies"]).transpose(2, 1, 0).reshape(4, -1)  # input, output
    held = []
    for key, right in (("magnitude", abs(expected)), ("phase", np.rad2deg(np.angle(expected)))):
        value = number(found[key])
        lower, upper = (number(found["bands"][f"{key}_{side}"]) for side in ("lower", "upper"))
        assert value.shape == lower.shape == upper.shape == (2, 4, 60)
        assert (lower <= value).all() and (value <= upper).all()
        if key == "magnitude":
            assert (lower > 0).all()
        else:
            right = value + (right - value + 180) % 360 - 180  # the turn that is nearest to the model's
        held.append((lower <= right) & (right <= upper))
    # The responses of one model at all frequencies depend on each other: 60 points have about as many independent ones
    # as the model has coefficients of a pair, 6. Of 24, fewer than 17 lie within 95 % bands with a chance of 2e-5.
    assert np.mean(held) > 17 / 24
    # The other model, whose phase begins near that of the model.
    other = found["others"][0]
    modes = tokid.json("modes", tmp_path / "other.npz")
    assert np.array(modes["valid"]).all() and len(found["others"]) == 1
    assert number(other["magnitude"]).shape == number(other["phase"]).shape == (2, 4, 60)
    assert np.abs(number(other["phase"])[..., 0] - number(found["phase"])[..., 0]).max() <= 180 + 1e-3
    shown = data_of(page)["modes"]["others"]
    frequencies = np.hypot(number(modes["poles_real"]), number(modes["poles_imag"]))
    assert len(shown) == 1
    np.testing.assert_allclose([mode["frequency"][0] for mode in shown[0]],
                               frequencies[0][number(modes["poles_imag"])[0] >= 0], rtol=5.1e-6)


def test_modes_of_periodic_models_are_drawn_at_all_steps(tokid, tmp_path):
    slow_system(tmp_path, tokid)
    tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "varying.npz", "--states", 3, "--lags", 4,
          "--no-refine", "--smoothing", 100)
    page = tmp_path / "page.html"
    tokid("report", tmp_path / "varying.npz", tmp_path / "fresh.npz", "-o", page, "--compare", tmp_path / "model.npz",
          tmp_path / "varying.npz")
    own = data_of(page)["modes"]
    periodic, itself = own["others"]
    modes = tokid.json("modes", tmp_path / "model.npz")  # of a period of one step
    imaginary = number(modes["poles_imag"])
    leads = (imaginary >= 0) & np.array(modes["valid"])
    frequencies = np.hypot(number(modes["poles_real"]), imaginary)[leads]
    assert imaginary.shape[0] == 1 and len(periodic) == len(frequencies) > 0
    for mode, frequency in zip(periodic, frequencies):
        expected = np.full(len(own["x"]), frequency)
        np.testing.assert_allclose(number(mode["frequency"]), expected, rtol=5.1e-6)  # six digits
    assert len(own["x"]) > 30
    # The model beside itself has the same curves.
    assert [mode["frequency"] for mode in itself] == [mode["frequency"] for mode in own["modes"]
                                                      if any(value is not None for value in mode["frequency"])]


def test_models_are_compared_over_the_same_samples(tokid, oscillator, tmp_path):
    """A model that begins later, and one with another number of states."""
    noise = ["--steps", 40, "--process-noise", 0.05, "--measurement-noise", 0.1]
    tokid("example", "oscillator", "-o", tmp_path / "data.npz", "--experiments", 40, *noise)
    tokid("example", "oscillator", "-o", tmp_path / "fresh.npz", "--experiments", 9, "--seed", 2, *noise)
    for name, states in (("a.npz", 4), ("b <i>.npz", 2)):
        tokid("identify", tmp_path / "data.npz", "-o", tmp_path / name, "--states", states, "--lags", 4,
              "--smoothing", 1, "--no-refine")
    late = load(tmp_path / "a.npz")
    np.savez(tmp_path / "late.npz", k_begin=6, initial_state="zero", dt=late["dt"], state_dim=late["state_dim"][6:],
             **{key: late[key][6:] for key in "ABCDG"})
    page = tmp_path / "page.html"
    tokid("report", tmp_path / "a.npz", tmp_path / "fresh.npz", "-o", page, "--horizon", 3, "--compare",
          tmp_path / "b <i>.npz", tmp_path / "late.npz")
    data, found = load(tmp_path / "fresh.npz"), data_of(page)
    assert found["models"] == ["a.npz", "b <i>.npz", "late.npz"] and "<i>" not in page.read_text().split("<script")[0]
    shown = table_of(page, "Fits of all models")
    assert [row[1] for row in shown] == found["models"] * 2
    from_step = int(re.search(r"Fits from step (\d+) on", page.read_text()).group(1))
    assert from_step >= 6
    tested = data["y"][:, from_step:]
    for name, rows in (("a.npz", shown[::3]), ("b <i>.npz", shown[1::3])):
        model = load(tmp_path / name)
        for column, computed in ((2, simulate(model, data["u"])), (3, predict(model, data["u"], data["y"])),
                                 (4, predict(model, data["u"], data["y"], 3))):
            expected = fit(tested, computed[:, from_step:])
            # The table cuts percentages after one digit.
            np.testing.assert_allclose([float(row[column].split()[0].replace("−", "-")) for row in rows], expected, atol=0.11)
    for j in range(2):
        best = [row[5] for row in shown[3 * j:3 * j + 3]]
        simulated = [float(row[2].split()[0].replace("−", "-")) for row in shown[3 * j:3 * j + 3]]
        assert simulated[best.index("best simulation")] == max(simulated)
    # The curves of the others lie beside those of the model.
    other = load(tmp_path / "b <i>.npz")
    simulated = simulate(other, data["u"])
    for experiment in found["traces"]["experiments"]:
        np.testing.assert_allclose(number(experiment["others"][0]).T, simulated[experiment["row"]], **six_digits)
    responses = found["responses"]
    expected = response(other, responses["starts"][2], responses["length"], True).transpose(2, 1, 0).reshape(4, -1)
    np.testing.assert_allclose(number(responses["others"][0]["pulse"][2]), expected, **six_digits)
    # What was seen in an identification is said.
    tokid("report", tmp_path / "a.npz", tmp_path / "data.npz", "-o", page, "--compare", oscillator / "model.npz")
    assert [row[2] for row in table_of(page, "Models")] == ["those of its identification",
                                                            "not recognised as those of its identification"]
    # Other channels
    tokid("example", "rotating-tube", "-o", tmp_path / "tube.npz", "--experiments", 12, "--steps", 40)
    tokid("identify", tmp_path / "tube.npz", "-o", tmp_path / "tube-model.npz", "--no-refine")
    result = tokid("report", tmp_path / "a.npz", tmp_path / "fresh.npz", "-o", page, "--compare",
                   tmp_path / "tube-model.npz", status=2)
    assert "tube-model.npz" in result.stderr and "inputs" in result.stderr


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
