# SPDX-License-Identifier: BSD-3-Clause
"""Repeated experiments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np

from . import _arrays, _dataframe, _dataset, _options, _samples, _tokid
from ._channels import Channels
from ._errors import reading, warn, writing
from ._samples import core_of, describe, sizes, taken_for_one, with_remark
from ._typing import Array, ArrayLike, PathLike

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import xarray  # type: ignore[import-not-found, unused-ignore]
    from typing_extensions import Self


class Ensemble(Channels):
    """N repeated experiments of T steps with r inputs and m outputs, their names, units and what is known of them.

    Parameters
    ----------
    u : array_like, shape (N, T, r), or (T, r) for one experiment
        Inputs. NaN marks a missing sample, and so does the mask of a masked array. Any strides and any type of real
        numbers are read straight from the array; the samples are laid out anew in one pass, as the library needs them.
    y : array_like, shape (N, T, m), or (T, m) for one experiment, optional
        Outputs; without them the ensemble holds inputs alone, as for simulations.
    dt : float, optional
        Sample time [s]. Without it 1 is taken, and a `TokidWarning` says so.
    length : array_like of int, shape (N,), optional
        Valid samples of each experiment, from 0 to T; the rest is ignored.
    free_y : array_like, shape (Nf, Tf, m), optional
        Outputs of experiments without input from unknown non-zero initial states, on the time origin of the others.
    initial_state : {"zero", "unknown"}, optional
        What is known of the state of every experiment at step 0; None: nothing is stated.
    input_names, output_names : sequence of str, optional
        Names of the channels, by default u1 … ur and y1 … ym.
    input_units, output_units : sequence of str, optional
        Their units.
    experiment_names : sequence of str or numbers, shape (N,), optional
        Names of the experiments, all different, by which messages, plots and tables call them; by default their rows.

    Raises
    ------
    ValueError
        For shapes that do not go together, values that are no real numbers, and infinite ones; names what was found
        and what is needed.

    See Also
    --------
    Ensemble.empty : to write samples in place, without any copy.

    Examples
    --------
    >>> import numpy as np, tokid
    >>> rng = np.random.default_rng(1)
    >>> data = tokid.Ensemble(rng.normal(size=(50, 80, 2)), rng.normal(size=(50, 80, 1)), dt=0.01)
    >>> data
    <tokid.Ensemble: N = 50 experiments, T = 80 steps, r = 2 inputs, m = 1 output, dt = 0.01 s>
    """

    _core: _tokid.Ensemble
    __slots__ = ("_core", "__weakref__")

    def __init__(
        self,
        u: Optional[ArrayLike],
        y: Optional[ArrayLike] = None,
        *,
        dt: Optional[float] = None,
        length: Optional[ArrayLike] = None,
        free_y: Optional[ArrayLike] = None,
        initial_state: Optional[str] = None,
        input_names: Optional[Sequence[str]] = None,
        output_names: Optional[Sequence[str]] = None,
        input_units: Optional[Sequence[str]] = None,
        output_units: Optional[Sequence[str]] = None,
        experiment_names: Optional[Iterable[Any]] = None,
    ) -> None:
        core, single = core_of(u, y, dt)
        self._core = core
        describe(
            core, length, free_y, initial_state, input_names, output_names, input_units, output_units, experiment_names
        )
        core.check(False)
        warn(with_remark(core.remarks(), core, taken_for_one(core) if single else ""))

    @classmethod
    def _of(cls, core: _tokid.Ensemble) -> Self:
        self = cls.__new__(cls)
        self._core = core
        return self

    @classmethod
    def _told(cls, core: _tokid.Ensemble) -> Self:
        """One that was made from what a user has: what is worth a word of it is issued here, and nowhere else."""
        warn(core.remarks())
        return cls._of(core)

    @classmethod
    def empty(
        cls,
        experiments: int,
        steps: int,
        inputs: int,
        outputs: int,
        *,
        dt: Optional[float] = None,
        length: Optional[ArrayLike] = None,
        free_y: Optional[ArrayLike] = None,
        initial_state: Optional[str] = None,
        input_names: Optional[Sequence[str]] = None,
        output_names: Optional[Sequence[str]] = None,
        input_units: Optional[Sequence[str]] = None,
        output_units: Optional[Sequence[str]] = None,
        experiment_names: Optional[Iterable[Any]] = None,
    ) -> Self:
        """An ensemble of the given size in which every sample is missing (NaN), to be written through `u` and `y`.

        Written in place, samples are never copied. The other parameters are those of the constructor.

        Examples
        --------
        >>> data = Ensemble.empty(50, 80, 2, 1, dt=0.01)
        >>> data.u[...] = 0.0
        >>> data.y[3, :, 0] = 1.0  # one experiment
        """
        size = [
            _options.integer(name, value, 0)
            for name, value in zip(
                ("experiments", "steps", "inputs", "outputs"), (experiments, steps, inputs, outputs)
            )
        ]
        core = _tokid.Ensemble(size[0], size[1], size[2], size[3], 1.0 if dt is None else float(dt))
        core.dt_stated = dt is not None
        describe(
            core, length, free_y, initial_state, input_names, output_names, input_units, output_units, experiment_names
        )
        return cls._told(core)

    @classmethod
    def load(
        cls,
        path: PathLike,
        *,
        inputs: Sequence[str] = (),
        outputs: Sequence[str] = (),
        outputs_required: bool = False,
    ) -> Self:
        """Reads an ensemble from .npz, .h5, .mat or .csv.

        Parameters
        ----------
        path : path
            The file; its extension says the format.
        inputs, outputs : sequence of str, optional
            Columns of a .csv that are inputs and outputs; by default those whose names begin with u and y.
        outputs_required : bool, default False
            Refuse a file without outputs.

        Raises
        ------
        IoError
            For a file that can't be read or holds something else; an OSError.

        Warns
        -----
        TokidWarning
            Where the file states no sample time, so that dt is 1 s; of columns that are not used; of rows that were
            taken as successive steps; of a last line that may have been cut; of a .csv that has been changed since
            tokid wrote it; of axes that look swapped.
        """
        with reading(path) as file:
            core = _tokid.load_ensemble(file, list(inputs), list(outputs), bool(outputs_required))
        return cls._told(core)

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Writes the ensemble to .npz, .h5, .mat or .csv, whole or not at all.

        Parameters
        ----------
        path : path
            The file; its extension says the format.
        mat73 : bool, default False
            Write a .mat of MATLAB version 7.3, which arrays beyond 2 GiB need.
        """
        with writing(path) as file:
            _tokid.save_ensemble(self._ready(), file, bool(mat73))

    # Sizes and samples

    @property
    def experiments(self) -> int:
        """Number of experiments N."""
        return self._core.experiments

    @property
    def steps(self) -> int:
        """Number of steps T."""
        return self._core.steps

    @property
    def u(self) -> Array:
        """Inputs (N, T, r): a writable view of the samples, of which the experiments lie next to each other."""
        return self._core.u()

    @property
    def y(self) -> Array:
        """Outputs (N, T, m): a writable view of the samples, of which the experiments lie next to each other."""
        return self._core.y()

    @property
    def free_y(self) -> Optional[Array]:
        """Free responses (Nf, Tf, m) as a writable view, or None."""
        return self._core.free_y

    @property
    def dt(self) -> float:
        """Sample time [s]."""
        return self._core.dt

    @property
    def dt_stated(self) -> bool:
        """Whether somebody stated `dt`; else it is 1."""
        return self._core.dt_stated

    @property
    def time(self) -> Array:
        """Times (T,) of the steps [s], from 0 on."""
        return np.arange(self.steps, dtype=np.float64) * self.dt

    @property
    def length(self) -> Optional[np.ndarray[Any, np.dtype[np.int64]]]:
        """Valid samples (N,) of each experiment, or None where all have T."""
        length = self._core.length
        return np.asarray(length, dtype=np.int64) if length else None

    @property
    def experiment_names(self) -> list[str]:
        """Names (N) of the experiments, their rows "0" … where none were given."""
        return _samples.experiment_names(self._core)

    @property
    def initial_state(self) -> Optional[str]:
        """What is known of the states at step 0: "zero", "unknown", or None where nothing is stated."""
        return self._core.initial_state

    @property
    def missing(self) -> int:
        """Number of samples that are missing within the lengths of the experiments."""
        return self._ready().missing()

    @property
    def fingerprint(self) -> str:
        """16 hexadecimal digits that tell the samples of this ensemble from those of any other."""
        return self._ready().fingerprint()

    def summary(self) -> dict[str, _tokid.ChannelSummary]:
        """For each channel, inputs first: number of samples, how many are missing, mean, std, min and max."""
        names = self.input_names + self.output_names
        core = self._ready()
        return {name: core.channel_summary(c) for c, name in enumerate(names)}

    def _ready(self) -> _tokid.Ensemble:
        """The samples as the library wants them: nothing behind the lengths, whatever was written there."""
        self._core.clear_beyond_lengths()
        return self._core

    def __len__(self) -> int:
        return self.experiments

    def __getitem__(self, rows: Union[int, slice, ArrayLike]) -> Self:
        """Experiments as an ensemble of their own: one by its number, or several as of `subset`."""
        if isinstance(rows, (int, np.integer)) and not isinstance(rows, bool):
            if not -self.experiments <= rows < self.experiments:
                raise IndexError(f"experiment {rows} found, one of {self.experiments} needed")
            rows = [int(rows)]
        return self.subset(rows)

    def __iter__(self) -> Iterator[Self]:
        return (self.subset([n]) for n in range(self.experiments))

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray[Any, Any]:
        # NumPy would take it for a sequence of sequences without end.
        raise TypeError("an Ensemble found, an array needed: it holds two, u (N, T, r) and y (N, T, m)")

    def __repr__(self) -> str:
        names = f"; experiments {_told(self._core.experiment_names)}" if self._core.experiment_names else ""
        return f"<{'tokid.' if type(self) is Ensemble else ''}{type(self).__name__}: {sizes(self)}{names}>"

    # Parts

    def subset(self, rows: Union[slice, ArrayLike]) -> Self:
        """The experiments of a slice, of the given row numbers, or for which a mask is true; all else is kept.

        Negative numbers count from the end. The samples are copied. The experiments keep their names; those without
        names get their row numbers as names. Where a row is chosen twice, the experiments of the subset have no names.

        Examples
        --------
        >>> data = tokid.example(experiments=10, steps=20)
        >>> len(data.subset([0, -1])), len(data.subset(slice(2, 8, 2))), len(data[3])
        (2, 3, 1)
        """
        if isinstance(rows, slice):
            rows = np.arange(self.experiments)[rows]
        chosen = np.asarray(rows)
        if chosen.dtype == np.bool_:
            _arrays.shaped("rows", chosen, (self.experiments,))
            chosen = np.flatnonzero(chosen)
        if chosen.ndim != 1 or (chosen.size and chosen.dtype.kind not in "iu"):
            raise ValueError(f"rows: an array of {chosen.dtype} and shape {chosen.shape} found, row numbers (any,) needed")
        numbers = [int(n) for n in chosen]
        for n in numbers:
            if not -self.experiments <= n < self.experiments:
                raise ValueError(f"rows: {n} found, numbers from {-self.experiments} to {self.experiments - 1} needed")
        return self._of(self._ready().subset([n % self.experiments for n in numbers]))

    def split(self, fraction: float, *, period: int = 0) -> tuple[Self, Self]:
        """Experiments for identification, and a share of them, evenly spread, for validation.

        Parameters
        ----------
        fraction : float
            Share of the experiments that are held out, between 0 and 1.
        period : int, default 0
            Of a single record of a system with a period of so many steps its end is held out.

        Returns
        -------
        training, held_out : Ensemble
        """
        share = _options.real("fraction", fraction, 0.0, 1.0)
        training, held_out = self._ready().split(share, _options.period(period))
        return self._of(training), self._of(held_out)

    def stretch(self, begin: int, end: int) -> Self:
        """The steps begin … end-1 of every experiment as an ensemble of its own. Free responses stay behind."""
        first = _options.integer("begin", begin, 0, self.steps - 1)
        return self._of(self._ready().stretch(first, _options.integer("end", end, first + 1, self.steps)))

    def cut(self, length: int) -> Self:
        """Consecutive stretches of the given length as experiments of their own, unfinished ones left out."""
        return self._of(self._ready().cut(_options.integer("length", length, 1, self.steps)))

    def nominal(self) -> tuple[Array, Array]:
        """The mean motion over the experiments: inputs (T, r) and outputs (T, m)."""
        u, y = self._ready().nominal()
        return u, y

    def departures(self) -> Self:
        """The experiments less their mean motion."""
        return self._of(self._ready().departures())

    # In the forms of other packages

    @classmethod
    def from_dataframe(
        cls,
        data: pandas.DataFrame,
        *,
        inputs: Optional[Sequence[Any]] = None,
        outputs: Optional[Sequence[Any]] = None,
        dt: Optional[float] = None,
        length: Optional[ArrayLike] = None,
        free_y: Optional[ArrayLike] = None,
        initial_state: Optional[str] = None,
        input_units: Optional[Sequence[str]] = None,
        output_units: Optional[Sequence[str]] = None,
        outputs_required: bool = False,
    ) -> Self:
        """An ensemble of a tidy `pandas.DataFrame`, by the rules of .csv files.

        Parameters
        ----------
        data : pandas.DataFrame
            A row for each experiment and step, in any order. ``experiment`` (numbers, which come in their order, or
            texts, which come as they first appear) names the experiments; where it is absent there is one. ``time``
            (numbers [s], dates or time differences), or ``k`` (whole numbers), holds the step, and where both are
            absent the rows of an experiment are its steps. They may be levels of the index, and an index of dates, of
            time differences, or of floats without a name is ``time``. Times may also be called
            ``t [s]``, ``time_ms`` and so on, as in .csv files. A warning names the other columns that are no channels,
            such as ``trial``.
            Absent rows, NaN, None and "NA" are missing samples.
        inputs, outputs : sequence, optional
            Columns that are inputs and outputs; by default all whose names begin with u and y, ``uid`` and ``year``
            not excepted.
        dt : float, optional
            Sample time [s]; by default the spacing of ``time``, else 1.
        length, free_y, initial_state, input_units, output_units
            As of the constructor.
        outputs_required : bool, default False
            Refuse a table without outputs.

        Returns
        -------
        Ensemble

        Raises
        ------
        ValueError
            Names the column and the row, which are counted from 0. So are refused an index whose meaning is not known,
            as of texts, and without ``experiment`` and times one whose labels repeat, as of records put together.

        Notes
        -----
        `to_dataframe` leaves what a table has no place for in ``data.attrs["tokid"]``: dt, names, units, lengths and
        what is known of the initial states. It is taken from there, as far as it still goes with the rows and columns.
        """
        core = _dataframe.from_dataframe(
            data,
            inputs=inputs,
            outputs=outputs,
            dt=dt,
            length=length,
            free_y=free_y,
            initial_state=initial_state,
            input_units=input_units,
            output_units=output_units,
            outputs_required=outputs_required,
        )
        return cls._told(core)

    @classmethod
    def from_xarray(
        cls,
        data: xarray.Dataset,
        *,
        dt: Optional[float] = None,
        length: Optional[ArrayLike] = None,
        free_y: Optional[ArrayLike] = None,
        initial_state: Optional[str] = None,
        input_names: Optional[Sequence[str]] = None,
        output_names: Optional[Sequence[str]] = None,
        input_units: Optional[Sequence[str]] = None,
        output_units: Optional[Sequence[str]] = None,
        experiment_names: Optional[Iterable[Any]] = None,
        outputs_required: bool = False,
    ) -> Self:
        """An ensemble of an `xarray.Dataset`, as `to_xarray` makes them.

        Parameters
        ----------
        data : xarray.Dataset
            The variables ``u`` and ``y`` along ``k`` or ``time``, ``experiment`` (one where it is absent) and ``input``
            or ``output`` (one channel where it is absent), in any order. The coordinate ``time`` (numbers [s], dates or
            time differences), else ``k`` (whole numbers), says which steps the entries are; absent ones are missing
            samples. Names of the experiments (the coordinate ``experiment``), names and units of the channels, lengths,
            free responses and what is known of the initial states are taken from where `to_xarray` has them.
        dt : float, optional
            Sample time [s]; by default the spacing of ``time``, else the attribute dt, else 1.
        length, free_y, initial_state, input_names, output_names, input_units, output_units, experiment_names
            As of the constructor, in the place of what the dataset holds.
        outputs_required : bool, default False
            Refuse a dataset without outputs.

        Returns
        -------
        Ensemble
            With the samples of the dataset copied. A stretch that begins later than step 0 has unknown initial states
            and no free responses, as of `stretch`.

        Raises
        ------
        ValueError
            Names the variable or coordinate.
        """
        core = _dataset.from_xarray(
            data,
            dt=dt,
            length=length,
            free_y=free_y,
            initial_state=initial_state,
            input_names=input_names,
            output_names=output_names,
            input_units=input_units,
            output_units=output_units,
            experiment_names=experiment_names,
            outputs_required=outputs_required,
        )
        return cls._told(core)

    def to_dataframe(self) -> pandas.DataFrame:
        """The ensemble as a tidy `pandas.DataFrame`: ``experiment``, ``time`` [s] and a column for each channel.

        The table is that of the .csv file. Rows in which everything is missing are left out, except in the first
        experiment and the first step.
        """
        table: pandas.DataFrame = _dataframe.to_dataframe(self._ready())
        return table

    def to_xarray(self) -> xarray.Dataset:
        """Samples as an `xarray.Dataset` with the coordinates experiment, k, time, input and output.

        They are views of those of the ensemble. See `interop.ensemble_to_xarray`.
        """
        dataset: xarray.Dataset = _dataset.of_ensemble(self._ready())
        return dataset

    # Copies, also in other processes

    def __reduce__(self) -> tuple[Any, ...]:
        state = {name: getattr(self._core, name) for name in _TOLD}
        return _restored, (np.asarray(self.u), np.asarray(self.y), state, type(self))


_TOLD = (
    "dt",
    "dt_stated",
    "reader_remarks",
    "length",
    "free_y",
    "initial_state",
    "input_names",
    "output_names",
    "input_units",
    "output_units",
    "experiment_names",
)


def _told(names: Sequence[str]) -> str:
    """The first names and the last, cut where they are long."""
    shown = [repr(name if len(name) <= 20 else name[:20] + "…") for name in (*names[:3], names[-1])]
    return ", ".join(shown[: len(names)]) if len(names) <= 4 else f"{', '.join(shown[:3])}, … {shown[3]}"


def _restored(u: Array, y: Array, state: dict[str, Any], cls: type[Ensemble] = Ensemble) -> Ensemble:
    core = _tokid.Ensemble(u.shape[0], u.shape[1], u.shape[2], y.shape[2], state["dt"], True)
    core.write_inputs(u)
    core.write_outputs(y)
    for name, value in state.items():
        if name != "free_y" or value is not None:
            setattr(core, name, value)
    return cls._of(core)
