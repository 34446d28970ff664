# SPDX-License-Identifier: BSD-3-Clause
"""Experiments that come later."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any, Optional, Union

from . import _dataframe, _dataset, _options, _tokid
from ._ensemble import Ensemble, core_of, plural
from ._errors import reading, warn, writing
from ._lock import FileLock
from ._model import Model
from ._progress import listener
from ._typing import ArrayLike, PathLike, Progress
from .results import Additions, Updated


class UpdateState:
    """What is kept of all experiments so far: the factors of the regressions, and the choices made from the first ones.

    `tokid.identify` with ``keep_state=True`` makes one, `Model.state`. Beside 16 bytes for each
    experiment, by which it is known again, its size does not depend on their number.
    """

    __slots__ = ("_core", "__weakref__")
    _core: _tokid.UpdateState

    def __init__(self) -> None:
        raise TypeError("states come from tokid.identify(..., keep_state=True) or tokid.UpdateState.load")

    @classmethod
    def _of(cls, core: _tokid.UpdateState) -> UpdateState:
        self = cls.__new__(cls)
        self._core = core
        return self

    @classmethod
    def load(cls, path: PathLike) -> UpdateState:
        """Reads a state from .h5, .npz or .mat.

        Raises
        ------
        IoError
            For a file that can't be read or holds something else; an OSError.
        """
        with reading(path) as file:
            return cls._of(_tokid.load_update_state(file))

    def save(self, path: PathLike) -> None:
        """Writes the state to .h5, .npz or .mat, whole or not at all.

        Parameters
        ----------
        path : path or FileLock
            With the lock of a file that was read under it, the file is refused where a program without the lock has
            replaced it meanwhile.
        """
        with writing(path) as file:
            if isinstance(path, FileLock):
                self._core.save_held(path._held())
            else:
                self._core.save(file)

    @property
    def experiments(self) -> int:
        """Number of experiments N so far."""
        return self._core.experiments

    @property
    def steps(self) -> int:
        """Number of steps T."""
        return self._core.steps

    @property
    def inputs(self) -> int:
        """Number of inputs r."""
        return self._core.inputs

    @property
    def outputs(self) -> int:
        """Number of outputs m."""
        return self._core.outputs

    @property
    def lags(self) -> int:
        """Lag order p."""
        return self._core.lags

    def identify(self, *, threads: int = 1, progress: Progress = False) -> Model:
        """The model of all experiments so far, with the choices made from the first ones and without EM.

        Parameters
        ----------
        threads, progress
            As of `tokid.identify`.

        Returns
        -------
        Model
            Its `updated` tells what was found out.
        """
        with listener(progress, "identify") as listening:
            return _identified(self._core, None, _options.threads(threads), listening)

    # Copies, also in other processes; nothing changes a state, so that a copy is the state itself

    def __copy__(self) -> UpdateState:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> UpdateState:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        with tempfile.TemporaryDirectory() as directory:
            file = os.path.join(directory, "state.npz")
            self._core.save(file)
            with open(file, "rb") as stream:
                return _restored, (stream.read(),)

    def __repr__(self) -> str:
        core = self._core
        return (
            f"<tokid.UpdateState: {plural(core.experiments, 'experiment')} of {plural(core.steps, 'step')}, "
            f"r = {plural(core.inputs, 'input')}, m = {plural(core.outputs, 'output')}, lag order {core.lags}>"
        )


def _restored(content: bytes) -> UpdateState:
    with tempfile.TemporaryDirectory() as directory:
        file = os.path.join(directory, "state.npz")
        with open(file, "wb") as stream:
            stream.write(content)
        return UpdateState._of(_tokid.load_update_state(file))


def _identified(core: _tokid.UpdateState, added: Optional[Additions], threads: int, listening: Any) -> Model:
    model, experiments, condition, deficient, warnings = core.identify(threads=threads, listener=listening)
    if added is not None:
        warnings = added.warnings + warnings
    found = Updated(experiments, condition, deficient, added, warnings)
    warn(warnings)
    return Model._of(model, warnings, updated=found, state=UpdateState._of(core))


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
            added: Additions = core.add(before, _experiments(core, u, y), threads=count, listener=listening)
        else:
            with ExitStack() as stack:
                names = [stack.enter_context(reading(path)) for path in files]
                added = core.add_files(
                    before, names, inputs=list(inputs), outputs=list(outputs), threads=count, listener=listening
                )
        model = _identified(core, added, count, None)
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


def _experiments(core: _tokid.UpdateState, u: Any, y: Any) -> _tokid.Ensemble:
    if isinstance(u, Ensemble):
        if y is not None:
            raise ValueError("y: found beside an Ensemble, which has the outputs already")
        return u._ready()
    if _dataframe.is_dataframe(u):
        if y is not None:
            raise ValueError("y: found beside a DataFrame, which has the outputs already")
        return _dataframe.from_dataframe(u, dt=core.dt, outputs_required=True)
    if _dataset.is_dataset(u):
        if y is not None:
            raise ValueError("y: found beside a Dataset, which has the outputs already")
        return _dataset.from_xarray(u, dt=core.dt, outputs_required=True)
    if y is None:
        raise ValueError(f"y: none found, outputs (N, T, {core.outputs}) needed")
    return core_of(u, y, core.dt)[0]
