# SPDX-License-Identifier: BSD-3-Clause
"""Plans of experiments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Optional, Union

import numpy as np

from . import _arrays, _options, _tokid
from ._ensemble import Ensemble
from ._errors import warn
from ._model import Model
from ._progress import listener
from ._samples import one_or_more
from ._typing import Progress
from .results import Plan


def plan(
    model: Optional[Model] = None,
    *,
    states: Optional[int] = None,
    inputs: Optional[int] = None,
    outputs: Optional[int] = None,
    steps: Optional[int] = None,
    lags: Union[int, str] = "auto",
    experiments: Union[int, str] = "auto",
    kind: str = "auto",
    amplitude: Union[float, Sequence[float]] = 1.0,
    noise: Optional[tuple[float, float]] = None,
    initial_state: Optional[str] = None,
    nominal: bool = False,
    excess: float = 0.1,
    markov_error: float = 0.1,
    white_condition: float = 10.0,
    hold: Union[int, str] = "auto",
    iterations: int = 120,
    dt: Optional[float] = None,
    input_names: Optional[Sequence[str]] = None,
    input_units: Optional[Sequence[str]] = None,
    seed: int = 1,
    threads: int = 1,
    progress: Progress = False,
) -> Plan:
    """Recommend a number of experiments, and make inputs for them.

    Parameters
    ----------
    model : Model, optional
        A preliminary model. It gives the values that are not stated.
    states, inputs, outputs, steps : int
        n, r, m and T. They are needed without a model.
    lags : int or "auto"
        Lag order p. "auto": the smallest one, n/m rounded up.
    experiments : int or "auto"
        N. "auto": the recommended number.
    kind : {"auto", "orthogonal", "gaussian", "binary", "multisine", "optimised"}
        Kind of the inputs. "auto": optimised with a model, else orthogonal.
    amplitude : float or sequence of float, default 1.0
        Limit of |u|, for all inputs or for each one.
    noise : (float, float), optional
        Standard deviations of the noise on inputs and outputs, in the units of the channels.
    initial_state : {"zero", "unknown"}, optional
        States at step 0; by default those of the model, else zero.
    nominal : bool, default False
        True: a mean motion will be removed from the data.
    excess, markov_error, white_condition : float
        Limits that determine the recommended number. `excess`: relative increase of the one-step mean square error by
        estimated coefficients. `markov_error`: relative error of the Markov parameters. `white_condition`: condition
        number of a window of white columns.
    hold : int or "auto"
        Orthogonal inputs: number of steps between exchanges of unused directions.
    iterations : int, default 120
        Optimised inputs: iterations at each of three stages.
    dt : float, optional
        Sample time [s]; by default that of the model, else 1.
    input_names, input_units : sequence of str, optional
        Names and units of the inputs.
    seed : int, default 1
        Seed of the random numbers.
    threads, progress
        As in `tokid.identify`.

    Returns
    -------
    Plan
        A plan. Its `inputs` are an ensemble.

    Examples
    --------
    >>> plan = tokid.plan(states=4, inputs=2, outputs=2, steps=40, amplitude=0.5)
    >>> plan.experiments, plan.u.shape
    (15, (15, 40, 2))
    """
    if model is not None and not isinstance(model, Model):
        raise ValueError(f"model: {type(model).__name__} found, a tokid.Model needed")
    most = 1_000_000
    options = _tokid.PlanOptions()
    for name, value in (("states", states), ("inputs", inputs), ("outputs", outputs), ("steps", steps)):
        if value is not None:
            setattr(options, name, _options.integer(name, value, 1, most))
        elif model is None:
            raise ValueError(f"{name}: none found, a number needed without a model")
    options.lags = _options.count_or_auto("lags", lags)
    options.experiments = _options.count_or_auto("experiments", experiments)
    options.kind = _options.choice("kind", kind, {"auto": None, **_tokid.InputKind.__members__})
    limits = np.atleast_1d(_arrays.numbers("amplitude", amplitude)).ravel()
    options.amplitude = [_options.real("amplitude", float(a), 5e-324) for a in limits]
    if noise is not None:
        if len(noise) != 2:
            raise ValueError(f"noise: {noise!r} found, two standard deviations needed, such as (0.01, 0.1)")
        options.noise = (_options.real("noise", noise[0], 0.0), _options.real("noise", noise[1], 0.0))
    if initial_state is not None:
        options.initial_state = _options.known_initial_state(initial_state)
    options.nominal = _options.switch("nominal", nominal)
    options.excess = _options.real("excess", excess, 0.0)
    options.markov_error = _options.real("markov_error", markov_error, 0.0)
    options.white_condition = _options.real("white_condition", white_condition, 1.0)
    options.hold = _options.count_or_auto("hold", hold)
    options.iterations = _options.integer("iterations", iterations, 1, most)
    options.dt = 0.0 if dt is None else _options.real("dt", dt, 5e-324)
    options.input_names = one_or_more(input_names)
    options.input_units = one_or_more(input_units)
    options.seed = _options.integer("seed", seed, 0, 2**64 - 1)
    with listener(progress, "plan") as listening:
        made, fields = _tokid.plan(
            None if model is None else model._core, options, _options.threads(threads), listening
        )
    result = Plan(inputs=Ensemble._of(made), **fields)
    warn(result.warnings)
    return result
