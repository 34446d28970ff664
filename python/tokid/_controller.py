# SPDX-License-Identifier: BSD-3-Clause
"""Controllers of the departures from the nominal trajectory: LQR and LQG."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from typing import Any, Optional

import numpy as np

from . import _arrays, _options, _tokid
from ._bytes import bytes_of, from_bytes
from ._ensemble import Ensemble
from ._errors import reading, writing
from ._held import Held
from ._state_space import StateSpace
from ._typing import Array, ArrayLike, PathLike
from .results import ClosedLoop, ExpectedCost


class Controller:
    """A linear law of control for the steps k = begin ... end-1::

        u[k] = u_nominal[k] + feedforward[k] - K[k] x[k] - L[k] (u[k-1] - u_nominal[k-1])

    x[k] is the state that the observer of the model predicts from the outputs up to step k-1. `Model.lqr` makes
    controllers. Arrays begin with step `begin`.
    """

    __slots__ = ("_core", "_model", "__weakref__")
    _core: _tokid.Lqr
    _model: StateSpace

    def __init__(self) -> None:
        raise TypeError("controllers come from tokid.Model.lqr")

    @classmethod
    def _of(cls, core: _tokid.Lqr, model: StateSpace) -> Controller:
        self = cls.__new__(cls)
        self._core = core
        self._model = model
        return self

    @classmethod
    def load(cls, path: PathLike, model: StateSpace) -> Controller:
        """Read a controller from .npz, .h5 or .mat.

        Parameters
        ----------
        path : path
            The file.
        model : Model
            The model with the observer of the loop.

        Raises
        ------
        IoError
            If the file can't be read or contains something else. It is an OSError.
        """
        if not isinstance(model, StateSpace):
            raise ValueError(f"model: {type(model).__name__} found, a tokid.Model needed")
        with reading(path) as file:
            return cls._of(_tokid.load_controller(file), model)

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Write the controller to .npz, .h5 or .mat. The file appears as a whole or not at all.

        It also stores the cost that LQG predicts with `model`, if this model has noise and the cost is finite.

        Parameters
        ----------
        path : path
            The file; its extension determines the format.
        mat73 : bool, default False
            Write a .mat of MATLAB version 7.3.
        """
        with writing(path) as file:
            self._core.save(self._model._core, file, _options.switch("mat73", mat73))

    @property
    def model(self) -> StateSpace:
        """The model that the controller was designed on."""
        return self._model

    begin = Held[int]("First step.")
    end = Held[int]("Step after the last one.")
    K = Held[Sequence[Array]]("Gains of the state, S arrays (r, n).")
    L = Held[Sequence[Array]]("Gains of the last input, S arrays (r, r); empty without input-rate weights.")
    feedforward = Held[Array]("Inputs (S, r) beside the feedback; zero without references.")
    u_nominal = Held[Array]("Nominal inputs (S, r) of the model.")
    y_nominal = Held[Array]("Nominal outputs (S, m) of the model.")
    cost_to_go = Held[Sequence[Array]](
        "S+1 matrices P: x[k]' P[k] x[k] is the smallest cost from step k on, if the state is known and the references "
        "are zero. With input-rate weights, x[k] is followed by the last input. Empty if the controller was read from "
        "a file."
    )

    def input(self, k: int, state: ArrayLike, last_input: Optional[ArrayLike] = None) -> Array:
        """Return the input (r,) of step k.

        Parameters
        ----------
        k : int
            The step.
        state : array_like, shape (n,)
            The state that the observer predicts from the outputs up to step k-1.
        last_input : array_like, shape (r,), optional
            The input of step k-1, needed with input-rate weights. Before the first step of the controller, inputs count
            as nominal.
        """
        if last_input is None:
            if len(self.L) > 0 and k > self.begin:
                raise ValueError("last_input: nothing found, the input of the step before needed, as rates have weights")
            last_input = np.zeros(self.u_nominal.shape[1])
        return self._core.input(
            _options.integer("k", k, 0),
            _arrays.shaped("state", state, (None,), "n"),
            _arrays.shaped("last_input", last_input, (None,), "r"),
        )

    def expected_cost(self, truth: Optional[StateSpace] = None, *, model: Optional[StateSpace] = None) -> ExpectedCost:
        """Return the exact expectation of the cost, with the observer in the loop.

        Parameters
        ----------
        truth : Model, optional
            The system that is controlled, with its noise: `Q` and `R`, else `innovation_cov` with `G`, else none. By
            default the model of the controller; the result is then the cost that LQG predicts.
        model : Model, optional
            The model whose observer is used, by default that of the controller.

        Returns
        -------
        ExpectedCost
        """
        observed, true = self._loop(truth, model)
        cost: ExpectedCost = self._core.expected_cost(observed._core, true._core)
        return cost

    def simulate(
        self,
        truth: Optional[StateSpace] = None,
        *,
        model: Optional[StateSpace] = None,
        experiments: int = 1,
        seed: int = 1,
        noise: bool = True,
        u_min: Optional[ArrayLike] = None,
        u_max: Optional[ArrayLike] = None,
        x0: Optional[ArrayLike] = None,
    ) -> ClosedLoop:
        """Simulate the closed loop with the observer.

        Parameters
        ----------
        truth, model : Model, optional
            As in `expected_cost`.
        experiments : int, default 1
            Number of experiments N.
        seed : int, default 1
            Seed of the noise.
        noise : bool, default True
            False: no noise.
        u_min, u_max : array_like, shape (r,) or a number, optional
            Limits of the inputs.
        x0 : array_like, shape (N, n) or (n,), optional
            Initial states of the true system. By default they are random with `x0_mean` and `x0_cov` of the truth if
            these are unknown and known in distribution, else zero.

        Returns
        -------
        ClosedLoop
            Inputs and measured outputs from step 0 on, and the cost of each experiment.
        """
        observed, true = self._loop(truth, model)
        count = _options.integer("experiments", experiments, 1)
        data, cost = self._core.simulate(
            observed._core,
            true._core,
            count,
            _options.integer("seed", seed, 0, 2**64 - 1),
            _options.switch("noise", noise),
            None if u_min is None else _arrays.limits("u_min", u_min, (true.inputs,)),
            None if u_max is None else _arrays.limits("u_max", u_max, (true.inputs,)),
            None if x0 is None else _arrays.states("x0", x0, count, true._core.state_dim[0]),
        )
        return ClosedLoop(Ensemble._of(data), cost)

    def _loop(self, truth: Optional[StateSpace], model: Optional[StateSpace]) -> tuple[StateSpace, StateSpace]:
        for name, given in (("truth", truth), ("model", model)):
            if given is not None and not isinstance(given, StateSpace):
                raise ValueError(f"{name}: {type(given).__name__} found, a tokid.Model needed")
        return model or self._model, truth or self._model

    # A controller does not change, so that a copy is the controller itself, beside a copy of its model

    def __copy__(self) -> Controller:
        return self

    def __deepcopy__(self, memo: dict[int, Any]) -> Controller:
        return Controller._of(self._core, copy.deepcopy(self._model, memo))

    def __reduce__(self) -> tuple[Any, ...]:
        content = bytes_of(lambda file: self._core.save(self._model._core, file, False))
        return _restored, (content, self.cost_to_go, self._model)

    def __repr__(self) -> str:
        return f"<tokid.Controller: steps {self.begin} to {self.end - 1}, r = {self.u_nominal.shape[1]}>"


def _restored(content: bytes, cost_to_go: Sequence[Array], model: StateSpace) -> Controller:
    core = from_bytes(_tokid.load_controller, content)
    core.set_cost_to_go(list(cost_to_go))  # no part of the file
    return Controller._of(core, model)
