# SPDX-License-Identifier: BSD-3-Clause
"""The observer of a model for samples that arrive step by step."""

from __future__ import annotations

from typing import Any, Optional

import numpy as np

from . import _arrays, _options, _tokid
from ._held import Held
from ._state_space import StateSpace
from ._typing import Array, ArrayLike
from .results import Observation


class Observer:
    """The observer of a model for samples that arrive step by step, with the results of `Model.predict`.

    `Model.observer` makes it. It begins at step 0. Inputs and outputs are those of the data: the nominal trajectory of
    the model is subtracted and added. A periodic model goes on after its last step.

    Examples
    --------
    >>> system = tokid.example_system("oscillator", steps=40)
    >>> data = tokid.example("oscillator", experiments=1, steps=40)
    >>> observer = system.observer()
    >>> for u, y in zip(data.u[0], data.y[0]):
    ...     seen = observer.step(u, y)
    >>> observer.k, seen.prediction.shape, bool(abs(seen.innovation).max() < 1e-10)
    (40, (2,), True)
    """

    __slots__ = ("_core", "_inputs", "_made", "_outputs", "__weakref__")
    _core: _tokid.OnlineObserver
    _made: tuple[Any, ...]  # the arguments of _of
    _inputs: int
    _outputs: int

    def __init__(self) -> None:
        raise TypeError("observers come from tokid.Model.observer")

    @classmethod
    def _of(
        cls,
        model: StateSpace,
        initial_state: str,
        initial_estimate: bool,
        samples_missing: bool,
        input_square: Optional[ArrayLike],
    ) -> Observer:
        self = cls.__new__(cls)
        self._inputs, self._outputs = model.inputs, model.outputs
        square = None if input_square is None else _arrays.shaped("input_square", input_square, (model.inputs,))
        self._made = (model, initial_state, initial_estimate, samples_missing, square)
        self._core = _tokid.OnlineObserver(
            model._core,
            _options.initial_state(initial_state),
            _options.switch("initial_estimate", initial_estimate),
            _options.switch("samples_missing", samples_missing),
            square,
        )
        return self

    k = Held[int]("The next step.")
    knows_state = Held[bool]("Is the state known? An unknown state is estimated from the samples of some steps.")
    state = Held[Array](
        "The state (n,) at step k, predicted from the samples before step k. NaN where it is not known."
    )

    def step(self, u: ArrayLike, y: ArrayLike) -> Observation:
        """Advance from step k to step k+1.

        Parameters
        ----------
        u, y : array_like, shapes (r,), (m,)
            Inputs and outputs of step k. NaN or a mask marks a missing sample.

        Returns
        -------
        Observation
            The one-step prediction, the innovation and its normalised square.

        Raises
        ------
        ValueError
            For a wrong number of samples, an infinite sample, or a step after the end of the model. The observer then
            remains as it was.
        """
        seen: Observation = self._core.step(_sample("u", u, self._inputs), _sample("y", y, self._outputs))
        return seen

    def predict(self, u: ArrayLike) -> Array:
        """Predict the outputs of the next steps from their inputs.

        Parameters
        ----------
        u : array_like, shape (H, r)
            Inputs of the steps k to k+H-1.

        Returns
        -------
        y : ndarray, shape (H, m)
            Outputs of the same steps, predicted from the samples before step k. NaN where the state is not known.
        """
        return self._core.predict(_arrays.shaped("u", u, (None, self._inputs), "H, r"))

    def reset(self) -> None:
        """Go back to step 0."""
        self._core.reset()

    def __reduce__(self) -> tuple[Any, ...]:
        return _running, (self._made, self._core.saved())

    def __repr__(self) -> str:
        return f"<tokid.Observer: step {self.k}, state {'known' if self.knows_state else 'not known'}>"


def _running(made: tuple[Any, ...], saved: bytes) -> Observer:
    """The observer of these arguments after the run that was saved: what copies and pickles are made of."""
    observer = Observer._of(*made)
    observer._core.restore(saved)
    return observer


def _sample(name: str, values: ArrayLike, size: int) -> Any:
    array = np.atleast_1d(_arrays.numbers(name, values))
    if array.shape != (size,):
        raise ValueError(f"{name}: shape {np.shape(values)} found, ({size},) needed")
    return array
