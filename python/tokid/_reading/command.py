# SPDX-License-Identifier: BSD-3-Clause
"""python -m tokid import IN... OUT: tables and logs of other programs → a file of tokid."""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from typing import Any, NoReturn

from .recording import DATES, METHODS
from .sources import extension


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(2, f"tokid import: error: {message}\n")


def _names(text: str) -> list[str]:
    return [name.strip() for name in text.split(",")]


_OPTIONS: dict[str, tuple[str, dict[str, Any]]] = {
    "inputs": ("A,B", {"type": _names, "help": "columns that are inputs; by default those whose names begin with u"}),
    "outputs": ("C,D", {"type": _names, "help": "columns that are outputs; by default those whose names begin with y"}),
    "time": ("NAME", {"help": "the column of the times. It may state the unit: 'timestamp [us]'"}),
    "experiment-column": ("NAME", {"help": "the column that names the experiments"}),
    "missing": ("WORD", {"action": "append", "help": "a word for missing samples; give the option once for each word"}),
    "dates": ("ORDER", {"choices": list(DATES), "help": "order of the numbers in dates such as 03/04/2026"}),
    "dt": ("SECONDS", {"type": float, "help": "sample time, to whose steps times are moved"}),
    "trigger": ("CONDITION", {"help": "condition at which an experiment begins, such as 'valve > 0.5'"}),
    "before": ("STEPS", {"type": int, "help": "steps that are kept before the trigger"}),
    "resample": ("SECONDS", {"type": float, "help": "sample time of a common grid"}),
    "resample-method": ("METHOD", {"choices": list(METHODS), "help": "linear (default), previous or mean"}),
    "held": ("A,B", {"type": _names, "help": "channels that hold their value between two samples"}),
    "longest-gap": ("STEPS", {"type": int, "help": "longest gap that resampling fills"}),
    "initial-state": ("STATE", {"choices": ["zero", "unknown"], "help": "state of every experiment at step 0"}),
}


def main(arguments: Sequence[str], read: Callable[..., Any]) -> int:
    """Run the command, which reads by `tokid.read`. Return 0, or 2 for an error of the user."""
    parser = _Parser(prog="tokid import", allow_abbrev=False, description="Read tables and logs of other programs, and save them as one "
                                                      "ensemble.")
    parser.add_argument("sources", metavar="IN", nargs="+", help="file, folder or pattern; each file is an experiment")
    parser.add_argument("out", metavar="OUT", help="the .npz, .h5, .mat or .csv to write")
    parser.add_argument("--outputs-required", action="store_true", help="refuse a source without outputs")
    for name, (metavar, rest) in _OPTIONS.items():
        parser.add_argument(f"--{name}", metavar=metavar, **rest)
    words = list(arguments)
    for n in (n for n, word in enumerate(words[:-1]) if word == "--missing"):
        words[n : n + 2] = [f"--missing={words[n + 1]}", ""]  # the word may begin with a minus
    parsed = parser.parse_args([word for word in words if word])
    given = {name: value for name, value in vars(parsed).items() if value not in (None, False)}
    sources, out = given.pop("sources"), given.pop("out")
    try:
        if extension(out) not in (".npz", ".h5", ".hdf5", ".mat", ".csv"):
            raise ValueError(f"OUT: '{out}' found, a name that ends with .npz, .h5, .mat or .csv needed")
        if extension(out) == ".csv" and os.path.exists(out):
            raise ValueError(f"OUT: '{out}' exists and may be a recording, so it was not replaced. Choose another name")
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            data = read(sources, **given)
        for remark in told:
            print(f"note: {remark.message}", file=sys.stderr)
        data.save(out)
        dt = f"dt = {data.dt:g} s" if data.dt_stated else "no sample time"
        print(f"{out}: {data.experiments} experiments of {data.steps} steps, {dt}", flush=True)
    except (ValueError, OSError, ImportError) as error:
        print(f"tokid import: error: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0
