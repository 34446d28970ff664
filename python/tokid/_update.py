# SPDX-License-Identifier: BSD-3-Clause
"""Experiments that come later."""

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
    """Adds experiments to those that a state was kept of.

    Experiments that the state has already are not added again; a warning and `updated.added.known` name them.

    Parameters
    ----------
    state : UpdateState, path or FileLock
        That of the experiments before, which is not changed; but a file gets the new experiments, once all has worked.
        A path is locked until then, so that concurrent updates follow each other.
    u, y : array_like, shapes (N, T, r), (N, T, m), or Ensemble, DataFrame or Dataset
        New experiments; or the paths of files of them, of which one at a time is in memory.
    inputs, outputs : sequence of str, optional
        Columns of .csv files that are inputs and outputs.
    wait : float, optional
        Seconds to wait for another update of the same file.
    threads, progress
        As of `tokid.identify`.

    Returns
    -------
    Model
        Of all experiments: that of `tokid.identify` with the same choices and without EM. Its `updated` tells how well
        the model before did on the new experiments, and its `state` is the one to go on with.

    Raises
    ------
    ValueError
        Names what differs from the experiments before.
    IoError
        Where another update has the file for longer than `wait`.
    """
    if isinstance(state, (UpdateState, FileLock)):
        return _updated(state, u, y, inputs, outputs, threads, progress)
    with FileLock(state, wait=wait) as held:
        return _updated(held, u, y, inputs, outputs, threads, progress)


def _updated(
    state: Union[UpdateState, FileLock],
    u: Any,
    y: Optional[ArrayLike],
    inputs: Sequence[str],
    outputs: Sequence[str],
    threads: int,
    progress: Progress,
) -> Model:
    count = _options.threads(threads)
    if isinstance(state, FileLock):
        state._held()  # before the work
    core = state._core.copy() if isinstance(state, UpdateState) else UpdateState.load(state)._core
    files = _paths(u)
    if files is not None and y is not None:
        raise ValueError("y: found beside files, which have the outputs already")
    for path in files or []:  # before the work: is it there?
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
    """The files that were given, if there are any."""
    if isinstance(u, (str, os.PathLike)):
        return [u]
    if isinstance(u, (list, tuple)) and u and all(isinstance(path, (str, os.PathLike)) for path in u):
        return list(u)
    return None
