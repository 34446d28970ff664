# SPDX-License-Identifier: BSD-3-Clause
"""Updates with later experiments."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any, Optional, Union

from . import _experiments, _options, _tokid
from ._ensemble import Ensemble
from ._errors import reading
from ._lock import FileLock
from ._model import Model, UpdateState, identified
from ._progress import listener
from ._typing import ArrayLike, PathLike, Progress
from .results import Additions


def update(
    state: Union[UpdateState, FileLock, PathLike],
    u: Union[ArrayLike, Ensemble, PathLike, Sequence[PathLike]],
    y: Optional[ArrayLike] = None,
    *,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    wait: float = 60.0,
    threads: int = 1,
    progress: Progress = False,
) -> Model:
    """Add later experiments to an update state, and identify the model of all experiments.

    Experiments that the state already has are not added again. A warning and `updated.added.known` name them.

    Parameters
    ----------
    state : UpdateState, path or FileLock
        The state of the previous experiments. An `UpdateState` does not change; a file is replaced after success. A
        path is locked during the call, so that concurrent updates wait for each other.
    u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble, DataFrame or Dataset
        New experiments; or as `u` the path of a file, or several paths. One file at a time is in memory.
    inputs, outputs : sequence of str, optional
        Columns of .csv files that are inputs and outputs.
    wait : float, default 60.0
        Time to wait for another update of the same file [s].
    threads, progress
        As in `tokid.identify`.

    Returns
    -------
    Model
        The model of all experiments, as from `tokid.identify` with the same choices and without EM. Its `updated` has
        the fit of the previous model to the new experiments. Its `state` contains all experiments.

    Raises
    ------
    ValueError
        If the new experiments do not fit the state. The message names the difference.
    IoError
        If another update has the file for longer than `wait`.
    """
    if not isinstance(state, (UpdateState, FileLock)):
        with FileLock(state, wait=wait) as held:
            return update(held, u, y, inputs=inputs, outputs=outputs, threads=threads, progress=progress)
    count = _options.threads(threads)
    if isinstance(state, FileLock):
        state._held()  # fails before the work starts
    core = state._core.copy() if isinstance(state, UpdateState) else UpdateState.load(state)._core
    files = _paths(u)
    if files is not None and y is not None:
        raise ValueError("y: found beside files, which have the outputs already")
    for path in files or []:  # a missing file fails before the work starts
        with reading(path) as name:
            _tokid.is_model(name)
    with listener(progress, "update") as listening:
        before = core.identify(threads=count, listener=None)[0]
        if files is None:
            added: Additions = core.add(before, _experiments.to_add(core, u, y), threads=count, listener=listening)
        else:
            with ExitStack() as stack:
                names = [stack.enter_context(reading(path)) for path in files]
                added = core.add_files(
                    before, names, inputs=list(inputs), outputs=list(outputs), threads=count, listener=listening
                )
        model = identified(core, added, count, None)
    if not isinstance(state, UpdateState):
        UpdateState._of(core).save(state)
    return model


def _paths(u: Any) -> Optional[list[Any]]:
    """The paths, if `u` is a path or a list of paths."""
    if isinstance(u, (str, os.PathLike)):
        return [u]
    if isinstance(u, (list, tuple)) and u and all(isinstance(path, (str, os.PathLike)) for path in u):
        return list(u)
    return None
