# SPDX-License-Identifier: BSD-3-Clause
"""What the tool prints: short reports that end with a verdict and a next step, in lines of at most 100 columns."""

import json
import re
import shlex
from functools import lru_cache

import numpy as np
import pytest

COLUMNS = 100
STEPS = 30


@pytest.fixture(scope="module")
def folder(tokid, tmp_path_factory):
    """Noisy experiments, few and many, and their models. Relative names keep the lines independent of the machine."""
    path = tmp_path_factory.mktemp("printed")
    noise = ["--steps", STEPS, "--measurement-noise", 0.1, "--process-noise", 0.01]
    for name, count, seed in [("few", 8, 1), ("data", 60, 2), ("fresh", 20, 3)]:
        tokid("example", "oscillator", "-o", path / f"{name}.npz", "--experiments", count, "--seed", seed, *noise)
    values = dict(np.load(path / "few.npz"))
    np.savez(path / "equal.npz", **{**values, "u": values["u"][:, :, [0, 0]]})  # inputs that no experiment separates
    tokid("identify", "data.npz", "-o", "model.npz", "--quiet", cwd=path)
    return path


@pytest.fixture(scope="module")
def printed(tokid, folder):
    """Runs a call in the folder once, whichever tests look at what it printed."""
    once = lru_cache(None)(lambda *call: tokid(*call, cwd=folder))
    return lambda *call: once(*map(str, call))


def rows(text):
    """Label → text of a report. Lines without a label continue the row before."""
    found = {}
    for line in text.splitlines():
        label = line[:15].strip()
        if label:
            last = label
            found[last] = line[15:]
        else:
            found[last] += "\n" + line[15:]
    return found


def next_command(text):
    """The words of the command that a report ends with."""
    return shlex.split(re.search(r"tokid (.*)", rows(text)["Next"].replace("\\\n", ""), re.DOTALL)[0])[1:]


def assert_narrow(text):
    for line in text.splitlines():
        assert len(line) <= COLUMNS, line


def commands_of(tokid):
    """Without `import`, which is of the Python package."""
    found = re.findall(r"^  ([a-z]+) ", tokid("--help").stdout.split("Commands:")[1], re.MULTILINE)
    return [name for name in found if name != "import"]


def test_help_has_narrow_lines(tokid):
    commands = commands_of(tokid)
    assert len(commands) >= 17
    for command in [[], *([name] for name in commands)]:
        assert_narrow(tokid(*command, "--help").stdout)


CALLS = {
    "identify": ["identify", "data.npz", "-o", "other.npz"],
    "identify few": ["identify", "few.npz", "-o", "of-few.npz"],
    "identify equal inputs": ["identify", "equal.npz", "-o", "of-equal.npz"],
    "identify held out": ["identify", "data.npz", "-o", "held-out.npz", "--hold-out", 0.2],
    "validate": ["validate", "model.npz", "fresh.npz", "--horizon", 5],
    "cross-validate": ["validate", "model.npz", "few.npz", "--cross-validate", 2],
    "info of data": ["info", "data.npz"],
    "info of a model": ["info", "model.npz"],
    "refine": ["refine", "model.npz", "data.npz", "-o", "refined.npz", "--iterations", 2],
    "plan": ["plan", "--model", "model.npz", "-o", "inputs.npz", "--kind", "orthogonal"],
    "report": ["report", "model.npz", "fresh.npz", "-o", "page.html"],
}


@pytest.mark.parametrize("call", CALLS.values(), ids=CALLS)
def test_reports_have_narrow_lines(printed, call):
    for more in [[], ["--verbose"]] if call[0] != "report" else [[]]:
        result = printed(*call, *more)
        assert result.stdout.count("\n") > 2
        assert_narrow(result.stdout)


def test_long_names_and_many_outputs_have_narrow_lines(tokid, tmp_path):
    rng = np.random.default_rng(1)
    outputs = [f"temperature of the wall behind the second burner, upper side, position {i}" for i in range(5)]
    u = rng.standard_normal((30, 12, 1))
    y = np.cumsum(u, axis=1) @ np.ones((1, 5)) + 0.1 * rng.standard_normal((30, 12, 5))
    np.savez(tmp_path / "wide.npz", u=u, y=y, dt=0.1, initial_state="zero", output_names=outputs, input_names=["q" * 70])
    for call in (["info", "wide.npz"], ["identify", "wide.npz", "-o", "m.npz", "--verbose"], ["info", "m.npz"],
                 ["validate", "m.npz", "wide.npz", "--verbose"]):
        result = tokid(*call, cwd=tmp_path)
        assert_narrow(result.stdout)
    # The last call: the ends of shortened names still tell them apart.
    table = result.stdout.split("\nFit ")[1].splitlines()[1:6]
    assert len({line[15:55] for line in table}) == 5 and all("…" in line and "position" in line for line in table)


@pytest.mark.parametrize("call", [CALLS["identify"], CALLS["identify few"], CALLS["identify held out"],
                                  ["validate", "model.npz", "fresh.npz"],
                                  ["validate", "model.npz", "data.npz"],
                                  CALLS["refine"],
                                  ["refine", "model.npz", "data.npz", "-o", "refined.npz", "--iterations", 300]])
def test_the_next_command_can_be_taken(tokid, folder, printed, call):
    words = next_command(printed(*call).stdout)
    assert words[0] in ("identify", "plan", "validate", "report", "confidence", "refine")
    tokid(*words, cwd=folder)


def test_the_next_step_keeps_the_options_of_the_call(tokid, folder):
    call = ["identify", "data.npz", "-o", "other.npz", "--states", 4, "--no-refine", "--smoothing", "infinity",
            "--output-weights", "1,2.5", "--period", 1]
    words = next_command(tokid(*call, cwd=folder).stdout)
    assert words[0] == "identify"
    for name, value in [("--states", "4"), ("--smoothing", "infinity"), ("--output-weights", "1.0,2.5"),
                        ("--hold-out", "0.2")]:
        assert words[words.index(name) + 1] == value
    assert "--no-refine" in words


@pytest.fixture(scope="module")
def recordings(tokid, tmp_path_factory):
    """Two .csv of the system of `folder`. The names of files and channels need quotation marks."""
    path = tmp_path_factory.mktemp("recordings")
    for name, seed in [("run 1", 2), ("run 2", 3)]:
        tokid("example", "oscillator", "-o", path / "data.npz", "--experiments", 30, "--seed", seed, "--steps", 40,
              "--measurement-noise", 0.1, "--process-noise", 0.01)
        with np.load(path / "data.npz") as file:
            samples = np.concatenate([file["u"], file["y"]], axis=2)
        lines = ["experiment,time,u$1,u2,a&m,b"]
        for n, experiment in enumerate(samples.tolist()):
            for k, row in enumerate(experiment):
                lines.append(",".join([str(n), repr(0.1 * k), *map(repr, row)]))
        (path / f"{name}.csv").write_text("\n".join(lines) + "\n")
    return path


READING = {"--inputs": "u$1,u2", "--outputs": "a&m,b"}
READ = [word for pair in READING.items() for word in pair]


def test_next_commands_read_the_same_data(tokid, recordings):
    """Each command is the one that the report before it names."""
    data = ["run 1.csv", "run 2.csv"]

    def after(*call):
        words = next_command(tokid(*call, cwd=recordings).stdout)
        assert {option: words[words.index(option) + 1] for option in READING} == READING
        return words

    once_more = after("identify", *data, "-o", "model.npz", "--states", 4, "--no-refine", *READ)
    assert once_more[:3] == ["identify", *data] and "--hold-out" in once_more
    # The model has seen these data.
    assert after("validate", "model.npz", *data, *READ)[:3] == ["validate", "model.npz", "fresh.csv"]
    bounds = after(*once_more)
    assert bounds[:4] == ["confidence", "model.npz", *data]
    tokid(*bounds, "--replicates", 2, cwd=recordings)
    page = after("validate", "model.npz", *data, *READ)
    assert page[:4] == ["report", "model.npz", *data]
    tokid(*page, cwd=recordings)


def test_report_and_confidence_take_many_files(tokid, recordings):
    data = ["run 1.csv", "run 2.csv"]
    tokid("identify", *data, "-o", "other.npz", "--states", 4, "--no-refine", *READ, "--quiet", cwd=recordings)
    for call in (["report", "other.npz", *data, "-o", "page.html"],
                 ["confidence", "other.npz", *data, "-o", "bounds.npz", "--replicates", 2]):
        found = tokid(*call, *READ, "--json", cwd=recordings).stdout
        assert call[0] == "report" or json.loads(found)["data"] == data
    message = tokid("confidence", "other.npz", *data, "-o", data[1], *READ, cwd=recordings, status=2).stderr
    assert data[1] in message


def test_one_verdict(tokid, folder, printed):
    """identify, validate and report give the same verdict on the same data, and the page shows it."""
    said = rows(tokid("identify", "data.npz", "-o", "other.npz", "--hold-out", 0.2, "--report", "own.html", "--verbose",
                      cwd=folder).stdout)["Verdict"]
    assert said == rows(printed(*CALLS["identify held out"], "--verbose").stdout)["Verdict"]
    assert said == rows(tokid("report", "other.npz", "data.npz", "-o", "page.html", cwd=folder).stdout)["Verdict"]
    assert said == rows(tokid("validate", "other.npz", "data.npz", "--verbose", cwd=folder).stdout)["Verdict"]
    status, *sentences = said.split("\n")
    assert status in ("good", "look closer", "don't trust") and sentences
    page = (folder / "own.html").read_text().replace("&#8288;", "").replace("&nbsp;", " ")
    assert " ".join(sentences).split(". ")[0] in page


def test_more_experiments_are_next_where_they_are_few(printed):
    text = printed(*CALLS["identify few"]).stdout
    assert rows(text)["Verdict"].startswith("look closer. ")
    assert next_command(text)[0] == "plan"


def test_verbose_has_the_details(printed):
    call = CALLS["identify"]
    brief, verbose = printed(*call).stdout, printed(*call, "--verbose").stdout
    assert 2 * len(brief.splitlines()) <= len(verbose.splitlines())
    assert [*rows(brief)][-3:] == ["Written", "Verdict", "Next"]
    assert {"Lag order", "States", "Smoothing", "Refinement", "Fit"} <= set(rows(brief))
    assert "chosen" in verbose and "chosen" not in brief
    assert "Feedthrough" in rows(verbose) and "Initial state" in rows(verbose)


def test_warnings_do_not_depend_on_verbosity(printed):
    call = CALLS["identify equal inputs"]
    said = [printed(*call, *more).stderr for more in ([], ["--verbose"], ["--quiet"])]
    assert said[0].startswith("tokid: warning: ") and said[0] == said[1] == said[2]


def test_each_message_is_one_line_where_no_terminal_reads_it(printed):
    call = CALLS["identify equal inputs"]
    said = printed(*call).stderr.splitlines()
    warnings = json.loads(printed(*call, "--json").stdout)["warnings"]
    assert said == [f"tokid: warning: {text}" for text in warnings] and any(len(line) > 100 for line in said)


@pytest.mark.parametrize(("motion", "options", "reference"), [
    (0, [], None),
    (5 * np.sin(np.arange(STEPS) / 4), ["--nominal", "mean"], "0 % is as good as the nominal trajectory of the model"),
    (5, ["--period", 1, "--nominal", "mean"], "0 % is as good as the constant nominal outputs of the model"),
])
def test_fits_state_their_reference(tokid, folder, tmp_path, motion, options, reference):
    with np.load(folder / "data.npz") as file:
        arrays = {name: file[name] for name in file.files}
    arrays["y"] = arrays["y"] + np.broadcast_to(motion, STEPS)[:, None]
    np.savez(tmp_path / "moved.npz", **arrays)
    tokid("identify", "moved.npz", "-o", "m.npz", "--lags", 2, "--states", 4, "--no-refine", *options, cwd=tmp_path)
    fits = rows(tokid("validate", "m.npz", "moved.npz", cwd=tmp_path).stdout)["Fit"].splitlines()
    assert len(fits) == 3 + (reference is not None)
    assert reference is None or fits[-1] == reference


def test_no_json_for_people(tokid, folder):
    tokid("identify", "data.npz", "-o", "options.npz", "--states", 4, "--hold-out", 0.25, "--outliers", "drop",
          "--report", "options.html", cwd=folder)
    found = rows(tokid("info", "options.npz", cwd=folder).stdout)
    assert unwrap(found["Options"]) == "states 4, hold out 0.25, outliers drop; the others at their defaults"
    assert found["Identified"] == "from 45 experiments"
    assert "lambda" in found["Chosen"] and "EM" in found["Refined"]
    assert not set('{}[]"') & set("".join(found.values()))
    page = (folder / "options.html").read_text()
    setup = re.search(r'<section id="setup".*?</section>', page, re.DOTALL)[0]
    assert "states 4, hold out 0.25, outliers drop" in setup
    assert "{" not in setup and "&quot;" not in setup


def unwrap(text):
    return " ".join(text.split())


def test_numbers_have_three_digits(printed):
    """Apart from whole numbers, and fits that would be rounded to 100 %."""
    for call in CALLS.values():
        text = printed(*call).stdout
        for number in re.findall(r"(?<![\w.·])\d+\.\d+(?![\w.])", re.sub(r"(99\.9\d*| in [\d.]+ s)", "", text)):
            assert len(number.replace(".", "").lstrip("0")) <= 3, f"{call}: {number}"
