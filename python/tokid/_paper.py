# SPDX-License-Identifier: BSD-3-Clause
"""The example of the paper, recomputed."""

from __future__ import annotations

import json
from typing import Optional

from . import _options, _tokid
from ._errors import warn
from ._progress import listener
from ._typing import PathLike, Progress
from .results import Paper


def paper(
    directory: Optional[PathLike] = None, *, seed: int = 1, threads: int = 1, progress: Progress = False
) -> Paper:
    """Recompute the figures and the printed numbers of the paper from experiments.

    Parameters
    ----------
    directory : path, optional
        Folder for paper.html and paper.json. Without it, no file is written.
    seed : int, default 1
        Seed of the experiments.
    threads, progress
        As in `tokid.identify`.

    Returns
    -------
    Paper
    """
    with listener(progress, "paper") as listening:
        printed, data = _tokid.paper(
            directory, _options.integer("seed", seed, 0, 2**64 - 1), _options.threads(threads), listening
        )
    result = Paper(printed, json.loads(data))
    warn(
        f"{n.equation} {n.quantity}: the paper prints {n.printed.real:.5g}, but {n.computed.real:.5g} was computed"
        for n in result.printed
        if not n.agrees
    )
    return result
