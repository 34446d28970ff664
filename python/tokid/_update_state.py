# SPDX-License-Identifier: BSD-3-Clause
"""Update states, to which later experiments can be added."""

from __future__ import annotations

import os
import tempfile
from typing import Any, Optional

from . import _options, _tokid
from ._errors import reading, warn, writing
from ._held import Held
from ._lock import FileLock
from ._model import Model, Origin
from ._progress import listener
from ._samples import plural
from ._typing import PathLike, Progress
from .results import Additions, Updated


class UpdateState:
    """An update state: the factors of the regressions of all experiments so far, and the choices from the first ones.

    `tokid.identify` with ``keep_state=True`` makes it: `Model.state`. Apart from a digest of 16 bytes for each
    experiment, its size does not depend on the number of experiments.
    """

    __slots__ = ("_core", "__weakref__")
    _core: _tokid.UpdateState

    experiments = Held[int]("Number of experiments N so far.")
    steps = Held[int]("Number of steps T.")
    inputs = Held[int]("Number of inputs r.")
    outputs = Held[int]("Number of outputs m.")
    lags = Held[int]("Lag order p.")

    def __init__(self) -> None:
        raise TypeError("states come from tokid.identify(..., keep_state=True) or tokid.UpdateState.load")

    @classmethod
    def _of(cls, core: _tokid.UpdateState) -> UpdateState:
        self = cls.__new__(cls)
        self._core = core
        return self

    @classmethod
    def load(cls, path: PathLike) -> UpdateState:
        """Read a state from .h5, .npz or .mat.

        Raises
        ------
        IoError
            If the file can't be read or contains something else. It is an OSError.
        """
        with reading(path) as file:
            return cls._of(_tokid.load_update_state(file))

    def save(self, path: PathLike) -> None:
        """Write the state to .h5, .npz or .mat. The file appears as a whole or not at all.

        Parameters
        ----------
        path : path or FileLock
            The file, or the lock under which it was read. With a lock, the call fails if a program without the lock has
            replaced the file in the meantime.
        """
        with writing(path) as file:
            if isinstance(path, FileLock):
                self._core.save_held(path._held())
            else:
                self._core.save(file)

    def identify(self, *, threads: int = 1, progress: Progress = False) -> Model:
        """Identify a model of all experiments so far, with the choices from the first ones and without EM.

        Parameters
        ----------
        threads, progress
            As in `tokid.identify`.

        Returns
        -------
        Model
            Its `updated` contains the results.
        """
        with listener(progress, "identify") as listening:
            return identified(self._core, None, _options.threads(threads), listening)

    # Copies, also in other processes. A state does not change, so that a copy is the state itself

    def __copy__(self) -> UpdateState:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> UpdateState:
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        with tempfile.TemporaryDirectory() as directory:
            file = os.path.join(directory, "state.npz")
            self._core.save(file)
            with open(file, "rb") as stream:
                return _restored_state, (stream.read(),)

    def __repr__(self) -> str:
        core = self._core
        return (
            f"<tokid.UpdateState: {plural(core.experiments, 'experiment')} of {plural(core.steps, 'step')}, "
            f"r = {plural(core.inputs, 'input')}, m = {plural(core.outputs, 'output')}, lag order {core.lags}>"
        )


def _restored_state(content: bytes) -> UpdateState:
    with tempfile.TemporaryDirectory() as directory:
        file = os.path.join(directory, "state.npz")
        with open(file, "wb") as stream:
            stream.write(content)
        return UpdateState._of(_tokid.load_update_state(file))


def identified(core: _tokid.UpdateState, added: Optional[Additions], threads: int, listening: Any) -> Model:
    """Identify the model of all experiments of a state. `added` describes the experiments of an update."""
    model, experiments, condition, deficient, findings = core.identify(threads=threads, listener=listening)
    if added is not None:
        findings = added.findings + findings
    found = Updated(experiments, condition, deficient, added, findings)
    warn(found.warnings)
    return Model._of(model, Origin(findings, updated=found, state=UpdateState._of(core)))
