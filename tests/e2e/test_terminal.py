# SPDX-License-Identifier: BSD-3-Clause
"""The tool among pipes and terminals: help, closed streams, the progress bar."""

import os
import pty
import re
import shlex
import shutil
import subprocess
import threading

import numpy as np
import pytest
from support import load

COMMANDS = ["identify", "validate", "simulate", "predict", "info", "plan", "example", "convert"]


def test_version(tokid):
    assert re.fullmatch(r"tokid \d+\.\d+\.\d+\n", tokid("--version").stdout)


def test_help_lists_the_commands(tokid):
    shown = tokid("--help").stdout
    for command in COMMANDS:
        assert re.search(rf"^  {command} +\w", shown, re.MULTILINE)


def test_a_bare_call_prints_the_help(tokid):
    assert tokid().stdout == tokid("--help").stdout


@pytest.mark.parametrize(("call", "meant"), [
    (["identfy", "data.npz"], "unknown command 'identfy'. Did you mean identify?"),
    (["identify", "data.npz", "-o", "m.npz", "--lag", "3"], "unknown option '--lag'. Did you mean --lags?"),
    (["identify", "data.npz", "-o", "m.npz", "--lag=3"], "unknown option '--lag'. Did you mean --lags?"),
    (["identify", "data.npz", "-o", "m.npz", "--order", "4"], "unknown option '--order'. Did you mean --states or --lags?"),
    (["identify", "data.npz", "-o", "m.npz", "--holdout", "0.2"], "unknown option '--holdout'. Did you mean --hold-out?"),
    (["identify", "data.npz", "-o", "m.npz", "--smoothign", "1"], "unknown option '--smoothign'. Did you mean --smoothing?"),
    (["validate", "m.npz", "data.npz", "--horizn", "5"], "unknown option '--horizn'. Did you mean --horizon?"),
    (["identify", "data.npz", "-o", "m.npz", "--state", "4"], "--states takes the number of states"),
])
def test_a_wrong_word_is_answered_with_the_right_one(tokid, call, meant):
    assert meant in tokid(*call, status=2).stderr


def test_no_word_is_suggested_where_none_is_alike(tokid):
    for call in (["frobnicate"], ["identify", "data.npz", "-o", "m.npz", "--xyz"], ["identify", "data.npz", "-z"]):
        message = tokid(*call, status=2).stderr
        assert "Did you mean" not in message and "--help" in message


@pytest.mark.parametrize("command", COMMANDS)
def test_the_example_of_the_help_runs(tokid, tmp_path, oscillator, command):
    shown = tokid(command, "--help").stdout
    example = re.search(r"Example:\n  tokid (.*)\n", shown).group(1)
    for name, source in (("data", "data"), ("fresh", "fresh"), ("inputs", "fresh"), ("model", "model")):
        shutil.copy(oscillator / f"{source}.npz", tmp_path / f"{name}.npz")
    for extension in (".csv", ".h5"):
        tokid("convert", tmp_path / "data.npz", tmp_path / f"data{extension}")
    assert tokid(*shlex.split(example), cwd=tmp_path).stderr == ""


def test_every_option_of_the_contract_is_in_the_help(tokid):
    for command, options in {
            "identify": "--states --lags --method --initial-state --frame --nominal --hold-out --threads --json --inputs "
                        "--outputs --reference-step --quiet --output",
            "validate": "--horizon --cross-validate --json --inputs --outputs",
            "plan": "--states --inputs --outputs --steps --lags --experiments --kind --amplitude --noise --model "
                    "--initial-state --nominal --dt --seed --threads --output --json",
            "simulate": "--output --inputs",
            "predict": "--output --horizon --inputs --outputs", "info": "--json",
            "example": "--output --experiments --steps --seed --process-noise --measurement-noise --free-responses "
                       "--initial-state", "convert": "--mat73"}.items():
        shown = tokid(command, "--help").stdout
        for option in options.split():
            assert re.search(rf"{option}\b", shown), f"{command} {option}"


def test_report_for_people(tokid, tmp_path, oscillator):
    shown = tokid("identify", oscillator / "data.npz", "-o", tmp_path / "model.npz", "--hold-out", 0.2,
                  "--verbose").stdout
    assert "60 experiments of 40 steps, 2 inputs, 2 outputs, dt = 0.05 s" in " ".join(shown.split())
    for text in ("no missing samples",
                 "48 experiments permit lag orders up to p = 11", "on 12 experiments held out", "as the data say",
                 str(tmp_path / "model.npz")):
        assert text in shown
    assert re.search(r"^ +2 .*chosen$", shown, re.MULTILINE)
    # The figures stand in columns.
    rows = [line for line in shown.splitlines() if line.endswith("%") and re.match(r" +y\d", line)]
    assert len(rows) == 2 and len({len(row) for row in rows}) == 1


def test_quiet(tokid, tmp_path, oscillator):
    result = tokid("identify", oscillator / "data.npz", "-o", tmp_path / "model.npz", "--quiet")
    assert result.stdout == "" and result.stderr == ""


def test_warnings_go_to_stderr(tokid, tmp_path, oscillator):
    data = load(oscillator / "data.npz")
    data["u"][:, :, 1] = 0.0
    np.savez(tmp_path / "data.npz", **data)
    for options in (["--json"], ["--quiet"], []):
        result = tokid("identify", tmp_path / "data.npz", "-o", tmp_path / "model.npz", "--lags", 2, "--no-refine", *options)
        lines = result.stderr.splitlines()
        assert lines and all(line.startswith("tokid: warning: ") for line in lines)
        assert any("u2" in line and "zero" in line for line in lines)


# Streams

def identify_command(tokid, oscillator, model):
    return [tokid.executable, "identify", str(oscillator / "data.npz"), "-o", str(model)]


@pytest.mark.parametrize("options", [[], ["--json"]])
def test_reader_that_goes_away(tokid, tmp_path, oscillator, options):
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "w") as stdout:
        result = subprocess.run([*identify_command(tokid, oscillator, tmp_path / "model.npz"), *options], stdout=stdout,
                                stderr=subprocess.PIPE, text=True, check=False)
    assert (result.returncode, result.stderr) == (0, "")
    assert "A" in load(tmp_path / "model.npz")


@pytest.mark.parametrize("streams", [[1], [2], [0, 1, 2]])
def test_closed_streams(tokid, tmp_path, oscillator, streams):
    # A file opened in place of a closed stream would receive what is printed.
    model = tmp_path / "model.npz"
    closing = " ".join(f"{fd}>&-" for fd in streams)
    result = subprocess.run(["sh", "-c", f'"$@" {closing}', "sh", *identify_command(tokid, oscillator, model)],
                            check=False, stdout=subprocess.DEVNULL)
    assert result.returncode == 0
    assert model.read_bytes() == (oscillator / "model.npz").read_bytes()


def test_full_device(tokid, oscillator):
    with open("/dev/full", "w", encoding="ascii") as stdout:
        result = subprocess.run([tokid.executable, "info", str(oscillator / "data.npz")], stdout=stdout,
                                stderr=subprocess.PIPE, text=True, check=False)
    assert result.returncode == 1
    assert result.stderr.startswith("tokid: standard output") and len(result.stderr.splitlines()) == 1


# Progress

@pytest.fixture(scope="module")
def long_work(tokid, tmp_path_factory):
    """Data that keep every machine busy for longer than the tenth of a second before the bar appears."""
    data = tmp_path_factory.mktemp("long") / "data.npz"
    tokid("example", "oscillator", "-o", data, "--experiments", 80, "--steps", 100, "--measurement-noise", 0.1)
    return data


def run_in_terminal(arguments):
    """Runs a program whose stderr alone is a terminal: exit status, stdout, what the terminal was sent."""
    terminal, end = pty.openpty()
    process = subprocess.Popen([str(a) for a in arguments], stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=end,
                               text=True)
    os.close(end)
    received = []

    def receive():
        try:
            while chunk := os.read(terminal, 4096):
                received.append(chunk)
        except OSError:  # how Linux says that the other end is closed
            pass

    reader = threading.Thread(target=receive)
    reader.start()
    stdout, _ = process.communicate()
    reader.join()
    os.close(terminal)
    return process.returncode, stdout, b"".join(received).decode()


def screen(text):
    """The lines that are left on a terminal."""
    lines, column = [[]], 0
    for c in text:
        if c == "\r":
            column = 0
        elif c == "\n":
            lines.append([])
            column = 0
        else:
            lines[-1][column:column + 1] = c
            column += 1
    return ["".join(line).rstrip() for line in lines]


IDENTIFY_LONG = ["--lags", 10, "--states", 4, "--no-refine"]


def test_progress_bar_in_a_terminal(tokid, tmp_path, long_work):
    status, stdout, shown = run_in_terminal([tokid.executable, "identify", long_work, "-o", tmp_path / "model.npz",
                                             *IDENTIFY_LONG])
    assert status == 0
    shares = [int(share) for share in re.findall(r"\[#*\.*\] +(\d+) %", shown)]
    assert shares and shares == sorted(shares) and shares[-1] <= 100
    assert "%" not in "".join(line for line in screen(shown) if "warning" not in line), "the bar was not erased"
    assert "Written" in stdout and "[#" not in stdout


def test_progress_names_stages_and_tells_of_the_first_model(tokid, tmp_path):
    data = tmp_path / "data.npz"
    tokid("example", "oscillator", "-o", data, "--experiments", 100, "--steps", 300, "--process-noise", 0.02,
          "--measurement-noise", 0.05)
    terminal, end = pty.openpty()
    with subprocess.Popen([tokid.executable, "identify", str(data), "-o", str(tmp_path / "model.npz")],
                          stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=end) as process:
        os.close(end)
        shown = b""
        try:
            while not re.search(rb"first model.*\n.*% +EM: ", shown, re.DOTALL):
                shown += os.read(terminal, 4096)
        finally:
            process.kill()
            os.close(terminal)
    shown = shown.decode()
    assert "choosing lags and lambda, " in shown and "choosing the number of states, " in shown
    (line,) = [line for line in screen(shown) if "first model" in line]
    assert re.fullmatch(r"first model, before EM: n = \d+ states, one-step fit y1 \d+\.\d %, y2 \d+\.\d %", line)
    assert not (tmp_path / "model.npz").exists()


def test_messages_are_broken_in_a_terminal(tokid, tmp_path):
    data = tmp_path / "data.npz"
    tokid("example", "oscillator", "-o", data, "--experiments", 8, "--steps", 20, "--measurement-noise", 0.1)
    call = ["identify", data, "-o", tmp_path / "model.npz", "--quiet"]
    said = tokid(*call).stderr
    assert any(len(line) > 100 for line in said.splitlines())
    status, _, shown = run_in_terminal([tokid.executable, *call])
    lines = shown.splitlines()
    assert status == 0 and all(len(line) <= 100 and line.startswith(("tokid: warning: ", "  ")) for line in lines)
    assert "\n".join(lines).replace("\n  ", " ") == said.rstrip("\n")


def test_no_progress_bar_elsewhere(tokid, tmp_path, long_work):
    result = tokid("identify", long_work, "-o", tmp_path / "model.npz", *IDENTIFY_LONG)
    assert "\r" not in result.stderr and "[#" not in result.stderr
    status, _, shown = run_in_terminal([tokid.executable, "identify", long_work, "-o", tmp_path / "model.npz", "--quiet",
                                        *IDENTIFY_LONG])
    assert status == 0 and "[#" not in shown
