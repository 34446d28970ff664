# SPDX-License-Identifier: BSD-3-Clause
"""Ensembles: repeated experiments of the same system."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any, Optional, Union

import numpy as np

from . import _arrays, _dataframe, _dataset, _options, _reading, _samples, _tokid
from ._channels import Channels
from ._errors import reading, warn, writing
from ._held import Held
from ._samples import DESCRIPTION, core_of, describe, description, new_core, sizes, taken_for_one, with_remark
from ._summary import Summary
from ._typing import Array, ArrayLike, IndexArray, PathLike

if TYPE_CHECKING:
    import pandas  # type: ignore[import-not-found, import-untyped, unused-ignore]
    import xarray  # type: ignore[import-not-found, unused-ignore]
    from typing_extensions import Self


class Ensemble(Channels):
    """N repeated experiments of T steps with r inputs and m outputs, and their names, units and other information.

    Parameters
    ----------
    u : array_like, shape (N, T, r), or (T, r) for one experiment, or a list of N arrays
        Inputs. NaN marks a missing sample, and so does the mask of a masked array. Arrays of any strides and any type
        of real numbers are read directly. The samples are copied once, into the layout of the library. A list of
        arrays (T_n, r) has experiments of different lengths: T is the largest one, and `length` is set.
    y : array_like, shape (N, T, m), or (T, m) for one experiment, or a list of N arrays, optional
        Outputs. Without them, the ensemble contains only inputs, for simulations.
    dt : float, optional
        Sample time [s]. Without it, dt is 1, and a `TokidWarning` reports this.
    length : array_like of int, shape (N,), optional
        Number of valid samples of each experiment, from 0 to T. Later samples are ignored.
    free_y : array_like, shape (Nf, Tf, m), optional
        Free responses: outputs of experiments without input, from unknown initial states that are not zero. They have
        the same time origin as the other experiments.
    initial_state : {"zero", "unknown"}, optional
        State of every experiment at step 0. None: not stated.
    input_names, output_names : sequence of str, optional
        Names of the channels; by default u1 … ur and y1 … ym.
    input_units, output_units : sequence of str, optional
        Units of the channels.
    experiment_names : sequence of str or numbers, shape (N,), optional
        Names of the experiments, all different, for messages, plots and tables; by default their rows.

    Raises
    ------
    ValueError
        If shapes do not agree, values are not real numbers, or values are infinite. The message says what was found and
        what is needed.

    See Also
    --------
    Ensemble.empty : makes an ensemble whose samples are written in place, without a copy.

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
        core, single = core_of(u, y, dt, length)
        self._core = core
        describe(core, **description(locals()))
        core.check(False)
        warn(with_remark(core.remarks(), core, taken_for_one(core) if single else ""))

    @classmethod
    def _of(cls, core: _tokid.Ensemble) -> Self:
        self = cls.__new__(cls)
        self._core = core
        return self

    @classmethod
    def _with_warnings(cls, core: _tokid.Ensemble) -> Self:
        """An ensemble from the data of a user. Its warnings are issued here, once."""
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
        """Make an ensemble of the given size with every sample missing (NaN). Samples are then written to `u` and `y`.

        Samples that are written in place are never copied. The other parameters are those of the constructor.

        Examples
        --------
        >>> data = Ensemble.empty(50, 80, 2, 1, dt=0.01)
        >>> data.u[...] = 0.0
        >>> data.y[3, :, 0] = 1.0  # one experiment
        """
        shape = {"experiments": experiments, "steps": steps, "inputs": inputs, "outputs": outputs}
        core = new_core(*(_options.integer(name, size, 0) for name, size in shape.items()), dt=dt)
        describe(core, **description(locals()))
        return cls._with_warnings(core)

    @classmethod
    def load(
        cls,
        path: Union[PathLike, Sequence[PathLike]],
        *,
        inputs: Union[str, Sequence[str]] = (),
        outputs: Union[str, Sequence[str]] = (),
        outputs_required: bool = False,
    ) -> Self:
        """Read an ensemble from .npz, .h5, .mat or .csv, or from many .csv files with an experiment each.

        `tokid.read` reads tables and logs of other programs.

        Parameters
        ----------
        path : path, or sequence of paths
            The file; its extension determines the format. A folder is all .csv files in it, a pattern such as
            ``"runs/*.csv"`` all files that match. The files are sorted by name, run2 before run10, and name the
            experiments.
        inputs, outputs : str or sequence of str, optional
            Columns of a .csv that are inputs and outputs; by default those whose names begin with u and y.
        outputs_required : bool, default False
            Refuse a file without outputs.

        Raises
        ------
        IoError
            If the file can't be read or contains something else. It is an OSError.

        Warns
        -----
        TokidWarning
            If the file states no sample time, so that dt is 1 s; if columns are not used; if rows were taken as
            successive steps; if the last line may be incomplete; if a .csv has changed since tokid wrote it; if axes
            look swapped.
        """
        options = _samples.read_options(inputs, outputs, outputs_required)
        if isinstance(path, (str, bytes, os.PathLike)) or not isinstance(path, Iterable):
            paths = [path]
        else:
            paths = list(path)
        with ExitStack() as stack:
            files = [stack.enter_context(reading(one)) for one in paths]
            core = _tokid.load_ensemble(files, options)
        return cls._with_warnings(core)

    def save(self, path: PathLike, *, mat73: bool = False) -> None:
        """Write the ensemble to .npz, .h5, .mat or .csv. The file appears as a whole or not at all.

        Parameters
        ----------
        path : path
            The file; its extension determines the format.
        mat73 : bool, default False
            Write a .mat of MATLAB version 7.3. Arrays larger than 2 GiB need it.
        """
        with writing(path) as file:
            _tokid.save_ensemble(self._ready(), file, _options.switch("mat73", mat73))

    experiments = Held[int]("Number of experiments N.")
    steps = Held[int]("Number of steps T.")
    u = Held[Array](
        "Inputs (N, T, r), a writable view with contiguous experiments.", lambda core, _: core.u(), writable=True
    )
    y = Held[Array](
        "Outputs (N, T, m), a writable view with contiguous experiments.", lambda core, _: core.y(), writable=True
    )
    free_y = Held[Optional[Array]]("Free responses (Nf, Tf, m), as a writable view, or None.", writable=True)
    dt = Held[float]("Sample time [s].")
    dt_stated = Held[bool]("Whether the user or the data stated `dt`. Otherwise it is 1.")
    length = Held[Optional[IndexArray]](
        "Number of valid samples (N,) of each experiment, or None if all have T.",
        lambda core, _: np.asarray(core.length, dtype=np.int64) if core.length else None,
    )
    experiment_names = Held[list[str]](
        "Names (N) of the experiments; without names, their rows.", lambda core, _: _samples.experiment_names(core)
    )
    initial_state = Held[Optional[str]]('States at step 0: "zero", "unknown", or None if not stated.')

    time = Held[Array](
        "Times (T,) of the steps, from 0 [s].", lambda core, _: np.arange(core.steps, dtype=np.float64) * core.dt
    )

    @property
    def missing(self) -> int:
        """Number of missing samples within the lengths of the experiments."""
        return self._ready().missing()

    @property
    def fingerprint(self) -> str:
        """Hash of all samples, 16 hexadecimal digits. Different ensembles have different fingerprints."""
        return self._ready().fingerprint()

    def summary(self) -> Summary:
        """Summarise each channel, inputs first: numbers of samples and missing samples, mean, std, min and max.

        Returns
        -------
        dict of str to ChannelSummary
            By the names of the channels. It is shown as a table.
        """
        names = self.input_names + self.output_names
        core = self._ready()
        return Summary({name: core.channel_summary(c) for c, name in enumerate(names)})

    def _ready(self) -> _tokid.Ensemble:
        """The core without samples after the lengths of the experiments, which a user may have written there."""
        self._core.clear_beyond_lengths()
        return self._core

    def __len__(self) -> int:
        return self.experiments

    def __getitem__(self, rows: Union[int, slice, ArrayLike]) -> Self:
        """Return one experiment by its number, or several as in `subset`, as an ensemble."""
        if isinstance(rows, (int, np.integer)) and not isinstance(rows, bool):
            if not -self.experiments <= rows < self.experiments:
                raise IndexError(f"experiment {rows} found, one of {self.experiments} needed")
            rows = [int(rows)]
        return self.subset(rows)

    def __iter__(self) -> Iterator[Self]:
        return (self.subset([n]) for n in range(self.experiments))

    def __array__(self, dtype: Any = None, copy: Optional[bool] = None) -> np.ndarray[Any, Any]:
        # NumPy would otherwise treat an ensemble as an endless sequence of sequences.
        raise TypeError("an Ensemble found, an array needed: use its arrays u (N, T, r) and y (N, T, m)")

    def __repr__(self) -> str:
        names = f"; experiments {_shortened(self._core.experiment_names)}" if self._core.experiment_names else ""
        return f"<{'tokid.' if type(self) is Ensemble else ''}{type(self).__name__}: {sizes(self)}{names}>"

    # Parts

    def subset(self, rows: Union[slice, ArrayLike]) -> Self:
        """Return the experiments of a slice, of row numbers, or of a mask, with all other information.

        Negative numbers count from the end. The samples are copied. The experiments keep their names. Experiments
        without names get their row numbers as names. If a row is chosen twice, the experiments have no names.

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
            found = f"an array of {chosen.dtype} and shape {chosen.shape}"
            raise ValueError(f"rows: {found} found, row numbers (any,) needed")
        numbers = [int(n) for n in chosen]
        for n in numbers:
            if not -self.experiments <= n < self.experiments:
                raise ValueError(f"rows: {n} found, numbers from {-self.experiments} to {self.experiments - 1} needed")
        return self._of(self._ready().subset([n % self.experiments for n in numbers]))

    def split(self, fraction: float, *, period: int = 0) -> tuple[Self, Self]:
        """Split the experiments into training data and held-out data, which are spread evenly over the ensemble.

        Parameters
        ----------
        fraction : float
            Share of the experiments to hold out, between 0 and 1.
        period : int, default 0
            Period of the system. The end of a single record of a periodic system is held out.

        Returns
        -------
        training, held_out : Ensemble
        """
        share = _options.real("fraction", fraction, 0.0, 1.0)
        training, held_out = self._ready().split(share, _options.period(period))
        return self._of(training), self._of(held_out)

    def stretch(self, begin: int, end: int) -> Self:
        """Return the steps begin … end-1 of every experiment as an ensemble, without free responses."""
        first = _options.integer("begin", begin, 0, self.steps - 1)
        return self._of(self._ready().stretch(first, _options.integer("end", end, first + 1, self.steps)))

    def cut(self, length: int) -> Self:
        """Return consecutive stretches of the given length as experiments, without an incomplete last stretch."""
        return self._of(self._ready().cut(_options.integer("length", length, 1, self.steps)))

    def nominal(self) -> tuple[Array, Array]:
        """Return the mean motion over the experiments: inputs (T, r) and outputs (T, m)."""
        u, y = self._ready().nominal()
        return u, y

    def departures(self) -> Self:
        """Return the departures of the experiments from their mean motion."""
        return self._of(self._ready().departures())

    # Objects of other packages

    @classmethod
    def from_dataframe(
        cls,
        data: Union[pandas.DataFrame, Mapping[Any, pandas.DataFrame], Sequence[pandas.DataFrame]],
        *,
        inputs: Union[str, Sequence[Any], None] = None,
        outputs: Union[str, Sequence[Any], None] = None,
        dt: Optional[float] = None,
        length: Optional[ArrayLike] = None,
        free_y: Optional[ArrayLike] = None,
        initial_state: Optional[str] = None,
        input_units: Optional[Sequence[str]] = None,
        output_units: Optional[Sequence[str]] = None,
        outputs_required: bool = False,
        **recorded: Any,
    ) -> Self:
        """Make an ensemble from a tidy `pandas.DataFrame`, or from several, by the rules of .csv files.

        Parameters
        ----------
        data : pandas.DataFrame
            A row for each experiment and step, in any order. Missing rows, NaN, None and "NA" are missing samples. A
            warning names the columns that are not used.

            The column ``experiment`` names the experiments. Numbers are sorted, texts keep the order of their first
            appearance. Without this column there is one experiment.

            The column ``time`` (numbers [s], dates or time differences) or ``k`` (whole numbers) determines the step.
            Without both, the rows of an experiment are its steps. The columns may be levels of the index. An index of dates, of time differences,
            or of floats without a name is ``time``.

            A dict or a list of tables has an experiment in each of them, as a folder of .csv files has. The keys of the
            dict name the experiments.
        inputs, outputs : str or sequence, optional
            Columns that are inputs and outputs; by default all columns whose names begin with u and y, such as ``uid``
            and ``year``.
        dt : float, optional
            Sample time [s]; by default the spacing of ``time``, else 1.
        length, free_y, initial_state, input_units, output_units
            As in the constructor.
        outputs_required : bool, default False
            Reject a table without outputs.
        **recorded
            The options ``time``, ``experiment_column``, ``missing``, ``dates``, ``trigger``, ``before``, ``resample``,
            ``resample_method``, ``held`` and ``longest_gap`` of `read`.

        Returns
        -------
        Ensemble

        Raises
        ------
        ValueError
            If the table is wrong. The message names the column and the row, counted from 0. An index of unknown
            meaning, such as texts, is an error. Without ``experiment`` and times, so is an index with repeated labels.

        Notes
        -----
        `to_dataframe` stores in ``data.attrs["tokid"]`` what a table has no place for: dt, names, units, lengths and
        initial states. This method uses these values if they still agree with the rows and columns.
        """
        described = description(locals())
        columns: dict[str, Any] = {"inputs": inputs, "outputs": outputs, "outputs_required": outputs_required, "dt": dt}
        if recorded or _reading.is_several(data):
            core = _reading.read(data, {**columns, **recorded}, described)
        else:
            core = _dataframe.from_dataframe(data, **columns, **described)
        return cls._with_warnings(core)

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
        inputs: Union[str, Sequence[Any], None] = None,
        outputs: Union[str, Sequence[Any], None] = None,
        **recorded: Any,
    ) -> Self:
        """Make an ensemble from an `xarray.Dataset` with the names that `to_xarray` uses, or from recorded variables.

        Parameters
        ----------
        data : xarray.Dataset
            The variables ``u`` and ``y`` with the dimensions ``k`` or ``time``, ``experiment``, and ``input`` or
            ``output``, in any order. Without ``experiment`` there is one experiment, without ``input`` or ``output``
            one channel.

            The coordinate ``time`` (numbers [s], dates or time differences), else ``k`` (whole numbers), determines the
            steps. Steps without an entry are missing samples. The other values are taken from where `to_xarray` stores
            them: names of experiments and channels, units, lengths, free responses and initial states.

            A dataset with a variable for each channel, whose names are in `inputs` and `outputs`, is read like a .csv
            with a column for each variable and each coordinate. So is a dict or a list of datasets, with an experiment
            in each.
        dt : float, optional
            Sample time [s]; by default the spacing of ``time``, else the attribute dt, else 1.
        length, free_y, initial_state, input_names, output_names, input_units, output_units, experiment_names
            As in the constructor. They replace the values of the dataset.
        outputs_required : bool, default False
            Reject a dataset without outputs.
        inputs, outputs : str or sequence, optional
            Variables that are inputs and outputs, where each channel is a variable.
        **recorded
            The options ``time``, ``experiment_column``, ``missing``, ``dates``, ``trigger``, ``before``, ``resample``,
            ``resample_method``, ``held`` and ``longest_gap`` of `read`, where each channel is a variable.

        Returns
        -------
        Ensemble
            An ensemble with a copy of the samples. As in `stretch`, data that begin after step 0 have unknown initial
            states and no free responses.

        Raises
        ------
        ValueError
            If the dataset is wrong. The message names the variable or coordinate.
        """
        described = description(locals())
        samples: dict[str, Any] = {"outputs_required": outputs_required, "dt": dt}
        if recorded or inputs or outputs or _reading.is_several(data):
            core = _reading.read(data, {"inputs": inputs, "outputs": outputs, **samples, **recorded}, described)
        else:
            core = _dataset.from_xarray(data, **samples, **described)
        return cls._with_warnings(core)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return the ensemble as a tidy `pandas.DataFrame`: ``experiment``, ``time`` [s] and a column for each channel.

        The table is that of the .csv file. Rows without any sample are left out, except in the first experiment and at
        the first step.
        """
        table: pandas.DataFrame = _dataframe.to_dataframe(self._ready())
        return table

    def to_xarray(self) -> xarray.Dataset:
        """Return the samples as an `xarray.Dataset` with the coordinates experiment, k, time, input and output.

        The samples are views of those of the ensemble. See `interop.ensemble_to_xarray`.
        """
        dataset: xarray.Dataset = _dataset.of_ensemble(self._ready())
        return dataset

    # Copies, also in other processes

    def __reduce__(self) -> tuple[Any, ...]:
        state = {name: getattr(self._core, name) for name in ("dt", "dt_stated", "reader_remarks", *DESCRIPTION)}
        return _restored, (np.asarray(self.u), np.asarray(self.y), state, type(self))


def _shortened(names: Sequence[str]) -> str:
    """The first three names and the last one, with long names cut."""
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
