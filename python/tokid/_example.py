# SPDX-License-Identifier: BSD-3-Clause
"""Example systems with known matrices, experiments on them, and the example of the paper, recomputed."""

from __future__ import annotations

import json
from typing import Optional

from . import _options, _tokid
from ._ensemble import Ensemble
from ._errors import warn
from ._model import Model
from ._progress import listener
from ._typing import PathLike, Progress
from .results import Paper

_SYSTEMS = {"oscillator": _tokid.oscillator, "rotating-tube": _tokid.rotating_tube}


def example_system(
    name: str = "oscillator",
    *,
    steps: int = 100,
    dt: Optional[float] = None,
    process_noise: float = 0.0,
    measurement_noise: float = 0.0,
) -> Model:
    """Make an example system with known matrices.

    Parameters
    ----------
    name : {"oscillator", "rotating-tube"}
        "oscillator": the system of the paper, with four states, two inputs and two outputs. "rotating-tube": a point
        mass on a spring in a rotating tube, with two states, one input and one output.
    steps : int, default 100
        Number of steps.
    dt : float, optional
        Sample time [s]; by default 0.05 for the oscillator, 0.1 for the tube.
    process_noise, measurement_noise : float, default 0.0
        Standard deviations of the noise on each state and each output. If one is positive, the model has the noise
        covariances and a Kalman filter as observer. Its predictions of `example` with the same noise are optimal.

    Returns
    -------
    Model
    """
    system = _system(name, steps, dt)
    process = _options.real("process_noise", process_noise, 0.0)
    measurement = _options.real("measurement_noise", measurement_noise, 0.0)
    if process > 0 or measurement > 0:
        system = _tokid.with_noise(system, process, measurement)
    return Model._of(system)


def example(
    name: str = "oscillator",
    *,
    experiments: int = 50,
    steps: int = 100,
    seed: int = 1,
    dt: Optional[float] = None,
    process_noise: float = 0.0,
    measurement_noise: float = 0.0,
    free_responses: int = 0,
    initial_state: str = "zero",
    inputs: Optional[Ensemble] = None,
) -> Ensemble:
    """Simulate experiments. The same seed gives the same experiments on every machine.

    Parameters
    ----------
    name : {"oscillator", "rotating-tube"}
        System, as in `example_system`.
    experiments : int, default 50
        Number of experiments N.
    steps : int, default 100
        Number of steps T.
    seed : int, default 1
        Seed of the random numbers.
    dt : float, optional
        Sample time [s].
    process_noise, measurement_noise : float, default 0.0
        Standard deviations of the noise on each state and each output.
    free_responses : int, default 0
        Number of free responses.
    initial_state : {"zero", "unknown"}
        States at step 0. "unknown": independent unit Gaussian states.
    inputs : Ensemble, optional
        Inputs of the experiments, for example those of a plan. They replace `experiments` and `steps`. Without them,
        inputs are unit Gaussian.

    Returns
    -------
    Ensemble
    """
    noise = (
        _options.integer("seed", seed, 0, 2**64 - 1),
        _options.real("process_noise", process_noise, 0.0),
        _options.real("measurement_noise", measurement_noise, 0.0),
        _options.integer("free_responses", free_responses, 0, 1_000_000),
        _options.known_initial_state(initial_state),
    )
    if inputs is None:
        count = _options.integer("experiments", experiments, 1, 1_000_000)
        return Ensemble._of(_tokid.experiments(_system(name, steps, dt), count, None, *noise))
    if not isinstance(inputs, Ensemble):
        raise TypeError(f"inputs: {type(inputs).__name__} found, a tokid.Ensemble needed")
    system = _system(name, inputs.steps, dt)
    return Ensemble._of(_tokid.experiments(system, inputs.experiments, inputs._ready(), *noise))


def _system(name: str, steps: int, dt: Optional[float]) -> _tokid.Model:
    make = _options.choice("name", name, _SYSTEMS)
    count = _options.integer("steps", steps, 1, 1_000_000)
    return make(count) if dt is None else make(count, _options.real("dt", dt, 5e-324))


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
